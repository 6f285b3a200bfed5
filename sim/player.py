"""Which frame of a motion is shown now: in real time, paused, stepped, sought, over and over."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

REST = 1.0  # s between the end and the next beginning


class Player:
    """Plays `frames` frames, `fps` a second of `clock`, from the first on and over and over. For any thread."""

    def __init__(self, frames: int, fps: float, clock: Callable[[], float] = time.monotonic) -> None:
        self.frames, self.fps = frames, fps
        self._clock, self._lock = clock, threading.RLock()
        self._loop, self._running = True, True
        self._from, self._since = 0, clock()

    @property
    def frame(self) -> int:
        """The frame that is due."""
        with self._lock:
            return min(self._passed(), self.frames - 1)

    @property
    def running(self) -> bool:
        """Whether it plays: neither paused nor, without loop, at its end."""
        with self._lock:
            return self._running and (self._loop or self._passed() < self.frames - 1)

    @property
    def loop(self) -> bool:
        return self._loop

    @loop.setter
    def loop(self, value: bool) -> None:
        with self._lock:
            self.seek(self.frame)
            self._loop = value

    def toggle(self) -> None:
        """Pause, or go on; from the first frame where it is at its end."""
        with self._lock:
            running, frame = self.running, self.frame
            self._running = not running
            self.seek(0 if not running and frame == self.frames - 1 else frame)

    def seek(self, frame: int) -> None:
        """Go to `frame`, the first or last one outside, and on from there unless paused."""
        with self._lock:
            self._from, self._since = min(max(frame, 0), self.frames - 1), self._clock()

    def hold(self, frame: int) -> None:
        """Pause at `frame`, the first or last one outside."""
        with self._lock:
            self._running = False
            self.seek(frame)

    def step(self, frames: int) -> None:
        """Pause, `frames` further on, or back where negative."""
        with self._lock:
            self.hold(self.frame + frames)

    def _passed(self) -> int:
        if not self._running:
            return self._from
        passed = self._from + int((self._clock() - self._since) * self.fps + 1e-6)
        return passed % (self.frames + round(REST * self.fps)) if self._loop else passed
