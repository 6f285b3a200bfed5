"""A person as somebody tells of them, pose by pose, whenever one comes; and the same at a steady rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.motion import Motion, Skeleton, Source
from motiongen.rotation import Array, slerp


@dataclass(frozen=True)
class Person:
    """Where a person is at `at_ns`: the pelvis at `pos` (3,) m in the world; `turns` (22, 4) as in a `Motion`."""

    at_ns: int
    pos: Array
    turns: Array


class Steady:
    """Poses in, `fps` frames a second out, each between the two poses beside it."""

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._origin_ns = 0
        self._made = 0
        self._last: Person | None = None
        self._ready: list[tuple[Array, Array]] = []

    def put(self, person: Person) -> None:
        """Take a pose; one that is not after the last is left out."""
        last = self._last
        if last is None:
            self._origin_ns = person.at_ns
            last = person
        elif person.at_ns <= last.at_ns:
            return
        while (at_ns := self._origin_ns + round(self._made * 1e9 / self._fps)) <= person.at_ns:
            u = (at_ns - last.at_ns) / max(person.at_ns - last.at_ns, 1)
            turns = slerp(last.turns, person.turns, np.full(len(person.turns), u))
            self._ready.append((last.pos + u * (person.pos - last.pos), turns))
            self._made += 1
        self._last = person

    def take(self, count: int, skeleton: Skeleton, source: Source) -> Motion | None:
        """The next `count` frames of the person with that `skeleton`; None where they have not all come."""
        if len(self._ready) < count:
            return None
        frames, self._ready = self._ready[:count], self._ready[count:]
        pos, turns = (np.stack(part) for part in zip(*frames, strict=True))
        return Motion(pos, turns, self._fps, skeleton, source=source)
