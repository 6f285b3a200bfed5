"""What a stream asks for at a moment: samples of several frames put in order, played late by as much as is wanted."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from drivers.bus import Array
from drivers.frame import Frame

NS = 1_000_000_000
MOST = 4096  # samples that wait


@dataclass(frozen=True, slots=True)
class _Sample:
    due_ns: int
    period_ns: int
    pos: Array
    vel: Array


class Buffer:
    """Plays `delay_s` s late: frames that come that much later than the fastest one are in time all the same, and
    what was lost in between is bridged.
    """

    def __init__(self, delay_s: float = 0.0) -> None:
        self._delay_ns = int(delay_s * NS)
        self._samples: deque[_Sample] = deque(maxlen=MOST)
        self._stream = -1

    def put(self, frame: Frame) -> None:
        """Take `frame`, which stands for all that was to come from its due time on."""
        if frame.stream != self._stream:
            self._samples.clear()
            self._stream = frame.stream
        while self._samples and self._samples[-1].due_ns >= frame.due_ns:
            self._samples.pop()
        for k in range(len(frame.pos)):
            due = frame.due_ns + k * frame.period_ns
            self._samples.append(_Sample(due, frame.period_ns, frame.pos[k].astype(float), frame.vel[k].astype(float)))

    def target_at(self, sender_ns: int) -> Array:
        """Joint angles (nj,) in rad to be at when it is `sender_ns` on the sender's clock; forgets what was before.

        Linear between samples; the first before it is due; past the last, on with its velocity for at most one period,
        since the next frame is on its way then. Raises IndexError before the first frame.
        """
        at = sender_ns - self._delay_ns
        while len(self._samples) > 1 and self._samples[1].due_ns <= at:
            self._samples.popleft()
        now = self._samples[0]
        since = max(0, at - now.due_ns)
        if len(self._samples) > 1:
            after = self._samples[1]
            return now.pos + (after.pos - now.pos) * (since / (after.due_ns - now.due_ns))
        return now.pos + now.vel * (min(since, now.period_ns) / NS)
