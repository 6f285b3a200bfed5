"""What the rig shows now and next: passed motions one after the other, and the idle motion in between.

Every motion begins and ends at rest in the rig's nominal pose, so that one can follow another at any time. One that has
to give way is exchanged for the same motion cut short, which passed the gate as a whole.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.samples import Samples, samples_of
from motiongen.rotation import Array
from retarget.cut import standing_at
from retarget.files import load_trajectory
from retarget.resample import resampled
from retarget.rig import Rig
from retarget.trajectory import Trajectory

IDLE = 0


@dataclass(frozen=True)
class Part:
    """A passed motion, at the rate of the wire. `number` is whose request it is, `IDLE` for the idle motion.

    `path`: the file of it, with `checked_fps` frames a second as the gate saw them. `final`: it is not cut again.
    """

    number: int
    trajectory: Trajectory
    report_id: str
    path: Path
    checked_fps: float
    final: bool = False


def part_of(number: int, path: Path, report_id: str, rate_hz: float, *, final: bool = False) -> Part:
    """The trajectory in `path` as a part, linear between the frames that were checked. Raises FileError, OSError."""
    trajectory = load_trajectory(path)
    return Part(number, resampled(trajectory, rate_hz), report_id, path, trajectory.fps, final)


class Player:
    """Plays `idle` over and over, and what `waiting` holds in turn; `part` is what it plays now."""

    def __init__(self, idle: Part, rig: Rig) -> None:
        self._idle, self._rig = idle, rig
        self.waiting: deque[Part] = deque()
        self.part = idle
        self._begin(idle, idle.trajectory.qpos[0, :7])

    @property
    def left_s(self) -> float:
        """Seconds to the end of the part."""
        return (len(self._samples) - self._at) / self._samples.fps

    @property
    def at_s(self) -> float:
        """Seconds since the part began."""
        return self._at / self._samples.fps

    def next(self) -> tuple[Samples, int]:
        """The columns of the part, and which row of them is due next; begins the next part where one has ended."""
        if self._at == len(self._samples):
            self._begin(self.waiting.popleft() if self.waiting else self._idle, self._samples.root[-1].astype(float))
        self._at += 1
        return self._samples, self._at - 1

    def give_way(self, shorter: Part, of: Part, at_s: float) -> bool:
        """Play `shorter` on, which is `of` cut at `at_s`; False where it is too late, or something else plays."""
        if self.part is not of or self.at_s > at_s:
            return False
        self.part = replace(shorter, number=of.number, path=of.path, final=True)
        self._samples = self._placed(self.part)
        return True

    def _begin(self, part: Part, root: Array) -> None:
        self.part, self._root, self._at = part, root, 0
        self._samples = self._placed(part)

    def _placed(self, part: Part) -> Samples:
        return samples_of(standing_at(part.trajectory, self._root), self._rig)
