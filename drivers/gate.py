"""Which frames a rig may follow: of this rig, checked, in order, on time. No sockets and no clock in here."""

from __future__ import annotations

from collections import Counter

from drivers.frame import Frame, FrameError, decode

NS = 1_000_000_000
MOST_EARLY_NS = 2 * NS
CREEP = 200e-6  # Two crystal clocks drift apart by less than 200 parts in a million.


class Gate:
    """Accepts or refuses messages and counts why.

    `rig_hash` of the frames to accept. `preview` accepts frames without a report and with torque limits: for what
    only draws. A frame may be `max_age_s` older than the freshest one seen; the clocks of the two machines need not
    agree, since the least delay ever seen is taken as none. A new stream takes over once the old one has been silent
    for `max_age_s`.
    """

    def __init__(self, rig_hash: int, *, preview: bool = False, max_age_s: float = 0.3) -> None:
        self._rig_hash = rig_hash
        self._preview = preview
        self._max_age_ns = int(max_age_s * NS)
        self._stream = -1
        self._seq = -1
        self._last_ns = 0
        self._offset_ns = 0
        self.accepted = 0
        self.gaps = 0
        self.refused: Counter[str] = Counter()
        self.last_error = ""

    def check(self, data: bytes, now_ns: int) -> Frame | None:
        """The frame in `data`, received at `now_ns`, or None where it is refused (see `refused`, `last_error`)."""
        try:
            frame = decode(data)
        except FrameError as error:
            self._refuse("damaged", str(error))
            return None
        offset = self._offset_with(frame, now_ns)
        objection = self._stranger(frame, now_ns) or self._untimely(frame, now_ns - offset)
        if objection:
            self._refuse(*objection)
            return None
        if frame.stream == self._stream:
            self.gaps += frame.seq - self._seq - 1
        self._stream, self._seq, self._last_ns, self._offset_ns = frame.stream, frame.seq, now_ns, offset
        self.accepted += 1
        return frame

    def sender_ns(self, now_ns: int) -> int:
        """The receiver's `now_ns` on the clock of the stream's sender."""
        return now_ns - self._offset_ns

    def _stranger(self, frame: Frame, now_ns: int) -> tuple[str, str] | None:
        if frame.rig_hash != self._rig_hash:
            return "rig", f"frame for rig {frame.rig_hash:016x}; this rig is {self._rig_hash:016x}"
        if not self._preview and not frame.checked:
            return "unchecked", "frame without the report_id of a passed report"
        if not self._preview and frame.torque is not None:
            return "torque", "frame asks for torque limits, which this rig's servos are not set up for"
        if frame.stream == self._stream and frame.seq <= self._seq:
            return "order", f"frame {frame.seq} after frame {self._seq}"
        if frame.stream != self._stream and self.accepted and now_ns - self._last_ns <= self._max_age_ns:
            return "stream", f"stream {frame.stream:08x} while {self._stream:08x} is still playing"
        return None

    def _untimely(self, frame: Frame, sender_ns: int) -> tuple[str, str] | None:
        last_due = frame.due_ns + (len(frame.pos) - 1) * frame.period_ns
        age = sender_ns - min(frame.capture_ns, last_due)
        if age > self._max_age_ns:
            return "stale", f"frame {frame.seq} is {age / NS:.3f} s old"
        if frame.due_ns - sender_ns > MOST_EARLY_NS:
            return "early", f"frame {frame.seq} is due in more than {MOST_EARLY_NS / NS:g} s"
        return None

    def _offset_with(self, frame: Frame, now_ns: int) -> int:
        """Our clock less the sender's: the least of all delays seen, let up by `CREEP` so that drift is followed."""
        delay = now_ns - frame.capture_ns
        if frame.stream != self._stream:
            return delay
        return min(delay, self._offset_ns + int(CREEP * (now_ns - self._last_ns)))

    def _refuse(self, why: str, message: str) -> None:
        self.refused[why] += 1
        self.last_error = message
