"""Joint trajectory of one rig: what retargeting hands to physics and to the wire."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from motiongen.motion import Label, Source


@dataclass(frozen=True)
class Trajectory:
    """`qpos` (T, 7 + nj) in MuJoCo's order: root position (m), root quaternion (w x y z), then the rig's joints (rad).

    The root block is always there, also for a rig on a stand, whose root then stands still. `joints` names the nj
    columns after it. `contacts` maps each foot of the rig, by name, to (T,) booleans. `aim` (T, nj) rad is what the
    servos are told so that under load they come to where `qpos` has the joints; None where they are told just that.

    Raises ValueError naming what is wrong: shapes, no frames, fps not above 0, NaN, a root quaternion not of unit
    length (tolerance 1e-3).
    """

    qpos: NDArray[np.float64]
    fps: float
    rig: str
    joints: tuple[str, ...]
    contacts: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    labels: tuple[Label, ...] = ()
    source: Source = field(default_factory=lambda: Source("unknown"))
    aim: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        qpos = np.asarray(self.qpos, float)
        if qpos.ndim != 2 or qpos.shape[1] != 7 + len(self.joints):
            raise ValueError(f"trajectory: qpos {qpos.shape} does not fit a root and {len(self.joints)} joints")
        if len(qpos) == 0:
            raise ValueError("trajectory: zero frames")
        if not np.isfinite(self.fps) or self.fps <= 0:
            raise ValueError(f"trajectory: fps must be above 0, not {self.fps}")
        if not np.isfinite(qpos).all():
            raise ValueError(f"trajectory: frame {int(np.argmin(np.isfinite(qpos).all(1)))} is not finite")
        if np.abs(np.linalg.norm(qpos[:, 3:7], axis=1) - 1).max() > 1e-3:
            raise ValueError("trajectory: a root quaternion is not of unit length")
        if any(np.shape(c) != (len(qpos),) for c in self.contacts.values()):
            raise ValueError("trajectory: contacts and qpos differ in length")
        if self.aim is not None and (np.shape(self.aim) != qpos[:, 7:].shape or not np.isfinite(self.aim).all()):
            raise ValueError(f"trajectory: aim {np.shape(self.aim)} should be {qpos[:, 7:].shape} and finite")
        object.__setattr__(self, "qpos", qpos)

    def __len__(self) -> int:
        return len(self.qpos)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self) - 1) / self.fps

    @property
    def root_pos(self) -> NDArray[np.float64]:
        """(T, 3) metres, world."""
        return self.qpos[:, :3]

    @property
    def root_quat(self) -> NDArray[np.float64]:
        """(T, 4) w x y z, world."""
        return self.qpos[:, 3:7]

    @property
    def joint_pos(self) -> NDArray[np.float64]:
        """(T, nj) radians."""
        return self.qpos[:, 7:]

    @property
    def targets(self) -> NDArray[np.float64]:
        """(T, nj) radians that the servos are told: `aim`, or the joints."""
        return self.joint_pos if self.aim is None else self.aim
