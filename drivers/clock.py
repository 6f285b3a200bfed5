"""Time, so that deadlines can be tested without waiting."""

from __future__ import annotations

import time
from typing import Protocol


class Ticker(Protocol):
    """A clock that only goes forward, in nanoseconds, and can be slept on."""

    def now_ns(self) -> int:
        """Nanoseconds since some fixed moment."""
        ...

    def sleep_until_ns(self, when_ns: int) -> None:
        """Return at `when_ns` or, where that is past, at once."""
        ...


class MonotonicClock:
    """The machine's CLOCK_MONOTONIC: never set back, shared by all processes of one machine."""

    def now_ns(self) -> int:
        """Nanoseconds of `time.monotonic_ns`."""
        return time.monotonic_ns()

    def sleep_until_ns(self, when_ns: int) -> None:
        """Sleep until `when_ns`."""
        left = when_ns - time.monotonic_ns()
        if left > 0:
            time.sleep(left * 1e-9)
