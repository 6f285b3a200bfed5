"""What a receiver does as frames come, stay away, or a stop arrives: a state machine without sockets or clock."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.frame import State
from drivers.messages import Mode

NS = 1_000_000_000


@dataclass(frozen=True)
class Patience:
    """Seconds without a fresh frame until the rig holds still, and until it goes to its safe pose for good."""

    hold_s: float = 0.3
    safe_s: float = 2.0


class Watchdog:
    """Mode of a receiver: waiting → following → hold → safe, and stopped from anywhere.

    "safe" and "stopped" latch: no frame leaves them, only `rearm`, which a person calls at the rig. Times are
    nanoseconds of any one clock that only goes forward.
    """

    def __init__(self, patience: Patience | None = None) -> None:
        self._patience = patience or Patience()
        self.rearm()

    def rearm(self) -> None:
        """Forget everything: wait for the first frame."""
        self.mode: Mode = "waiting"
        self.reason = ""
        self._fresh_ns = 0
        self._live_ns = 0

    def fresh(self, state: State, now_ns: int) -> None:
        """A valid, timely frame arrived that asks for `state`."""
        if self.mode in ("safe", "stopped"):
            return
        self._fresh_ns = now_ns
        if state == State.SAFE:
            self.mode, self.reason = "safe", "the sender asked for the safe pose"
        elif state == State.PLAY:
            self.mode, self.reason = "following", ""
            self._live_ns = now_ns
        elif self.mode != "waiting":
            self.mode = "hold"
            self.reason = "the sender asked to hold" if state == State.HOLD else "the stream ended"
            if state == State.HOLD:
                self._live_ns = now_ns

    def stop(self, reason: str) -> None:
        """A stop arrived: latch it."""
        if self.mode != "stopped":
            self.mode, self.reason = "stopped", f"stop: {reason}"

    def update(self, now_ns: int) -> Mode:
        """The mode at `now_ns`."""
        silent_s = (now_ns - self._fresh_ns) / NS
        if self.mode == "following" and silent_s > self._patience.hold_s:
            self.mode, self.reason = "hold", f"no fresh frame for {self._patience.hold_s:g} s"
        if self.mode == "hold" and (now_ns - self._live_ns) / NS > self._patience.safe_s:
            self.mode = "safe"
        return self.mode
