"""What ends a drive at once: a joint that is off its command, draws too much, or is too hot, for too long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.bus import Array, Reading

NS = 1_000_000_000


@dataclass(frozen=True)
class Ceilings:
    """At most, for each of n joints: `error` rad off its command, `current` A, `temperature` °C; all (n,)."""

    error: Array
    current: Array
    temperature: Array


class Trips:
    """Watches `joints`; a reading may be above a ceiling for `following_s` s (error) or `load_s` s (the others)."""

    def __init__(self, joints: Sequence[str], ceilings: Ceilings, *, following_s: float, load_s: float) -> None:
        self._joints = tuple(joints)
        self._watched = (
            (ceilings.error, following_s, "is {:+.2f} rad off its command: jammed or overloaded"),
            (ceilings.current, load_s, "draws {:+.2f} A (at most {:.2f}): jammed or overloaded"),
            (ceilings.temperature, load_s, "is at {:.0f} °C (at most {:.0f})"),
        )
        self._good_ns: list[NDArray[np.int64]] = []

    def start(self, now_ns: int) -> None:
        """The torque came on: what was before no longer counts."""
        self._good_ns = [np.full(len(self._joints), now_ns) for _ in self._watched]

    def reason(self, error: Array, reading: Reading, now_ns: int) -> str:
        """Which joint has been above which ceiling for too long, "" where none has.

        `error` (n,) rad: command less measured. What the servos cannot measure is not watched.
        """
        measured = (error, reading.current, reading.temperature)
        for (most, seconds, words), good_ns, values in zip(self._watched, self._good_ns, measured, strict=True):
            if not len(values):
                continue
            good_ns[np.abs(values) <= most] = now_ns
            if len(late := np.flatnonzero(now_ns - good_ns > seconds * NS)):
                worst = late[np.argmax(np.abs(values[late]) / most[late])]
                return f"{self._joints[worst]} " + words.format(values[worst], most[worst])
        return ""
