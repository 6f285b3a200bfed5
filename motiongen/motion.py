"""Human motion: the type that every generator and every file reader hands over."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array, quat_continuous, quat_mul, quat_rotate, slerp

SMPL_JOINTS = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
)  # fmt: skip
SMPL_PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19)
FOOT_JOINTS = ("left_ankle", "left_foot", "right_ankle", "right_foot")


@dataclass(frozen=True)
class Skeleton:
    """Named joints in a T-pose whose joint frames all lie along the world's: x forward, y left, z up.

    `offsets` (J, 3) in metres, from the parent joint, in that pose; row 0 is zero. `parents[0]` is -1 and every other
    parent comes before its child. `foot_height` in metres: how high the `left_ankle` and `left_foot` joints lie above
    the sole of a foot that stands flat on the floor.

    Raises ValueError where names repeat, a parent does not come first, or offsets are not finite.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array
    foot_height: tuple[float, float] = (0.08, 0.02)

    def __post_init__(self) -> None:
        object.__setattr__(self, "offsets", np.asarray(self.offsets, float))
        n = len(self.names)
        if len(set(self.names)) != n or len(self.parents) != n or self.offsets.shape != (n, 3):
            raise ValueError(f"skeleton: {n} names, {len(self.parents)} parents and offsets {self.offsets.shape}")
        if self.parents[0] != -1 or any(not 0 <= p < i for i, p in enumerate(self.parents) if i):
            raise ValueError(f"skeleton: a parent must come before its child, not {self.parents}")
        if not np.isfinite(self.offsets).all():
            raise ValueError("skeleton: offsets must be finite")

    @cached_property
    def levels(self) -> tuple[tuple[list[int], list[int]], ...]:
        """Joints that are equally far from joint 0, and their parents: next to it first."""
        depth = [0]
        for parent in self.parents[1:]:
            depth.append(depth[parent] + 1)
        rows = [[j for j, d in enumerate(depth) if d == far] for far in range(1, max(depth) + 1)]
        return tuple((joints, [self.parents[j] for j in joints]) for joints in rows)

    def index(self, name: str) -> int:
        """Row of the joint `name`; raises ValueError that lists the names."""
        if name not in self.names:
            raise ValueError(f"no joint {name!r} in this skeleton; it has {', '.join(self.names)}")
        return self.names.index(name)


@dataclass(frozen=True)
class Label:
    """What a stretch of motion shows: `text` between two times in seconds; `parts` empty means the whole body."""

    start_s: float
    end_s: float
    text: str
    parts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Source:
    """Where a motion came from; carried on to everything made from it."""

    generator: str
    weights: str = ""
    seed: int | None = None
    licence: str = ""


@dataclass(frozen=True)
class Motion:
    """Human motion in metres, seconds and unit quaternions (w x y z); z up, x forward, y left.

    `root_pos` (T, 3): world position of joint 0. `joint_quat` (T, J, 4): orientation of each joint relative to its
    parent's, joint 0 relative to the world; all are the identity in the skeleton's T-pose. `fps`: frames a second.
    `contacts`: (T, 4) booleans in the order of `FOOT_JOINTS`, or None where nobody measured them.

    Raises ValueError naming what is wrong: shapes that differ, no frames, fps not above 0, NaN, quaternions not of
    unit length (tolerance 1e-3; what is within is normalised).
    """

    root_pos: Array
    joint_quat: Array
    fps: float
    skeleton: Skeleton
    labels: tuple[Label, ...] = ()
    source: Source = field(default_factory=lambda: Source("unknown"))
    contacts: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        pos, quat = np.asarray(self.root_pos, float), np.asarray(self.joint_quat, float)
        joints = len(self.skeleton.names)
        if pos.ndim != 2 or pos.shape[1] != 3 or quat.shape != (len(pos), joints, 4):
            raise ValueError(f"motion: root_pos {pos.shape} and joint_quat {quat.shape} do not fit {joints} joints")
        if len(pos) == 0:
            raise ValueError("motion: zero frames")
        if not np.isfinite(self.fps) or self.fps <= 0:
            raise ValueError(f"motion: fps must be above 0, not {self.fps}")
        if not np.isfinite(pos).all() or not np.isfinite(quat).all():
            bad = ~np.isfinite(pos).all(1) | ~np.isfinite(quat).all((1, 2))
            raise ValueError(f"motion: frame {int(np.argmax(bad))} is not finite (NaN or infinity)")
        norm = np.linalg.norm(quat, axis=-1, keepdims=True)
        if np.abs(norm - 1).max() > 1e-3:
            raise ValueError(f"motion: a quaternion has length {norm.flat[np.abs(norm - 1).argmax()]:.4g}, not 1")
        if self.contacts is not None and np.shape(self.contacts) != (len(pos), len(FOOT_JOINTS)):
            raise ValueError(f"motion: contacts {np.shape(self.contacts)} instead of {(len(pos), len(FOOT_JOINTS))}")
        object.__setattr__(self, "root_pos", pos)
        object.__setattr__(self, "joint_quat", quat / norm)

    def __len__(self) -> int:
        return len(self.root_pos)

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self) - 1) / self.fps

    def global_quat(self) -> Array:
        """World orientation (T, J, 4) of every joint."""
        out = self.joint_quat.copy()
        for joints, parents in self.skeleton.levels:
            out[:, joints] = quat_mul(out[:, parents], out[:, joints])
        return out

    def positions(self, turn: Array | None = None) -> Array:
        """World position (T, J, 3) of every joint in metres, by forward kinematics from `turn`, its `global_quat`."""
        turn = self.global_quat() if turn is None else turn
        out = quat_rotate(turn[:, self.skeleton.parents], self.skeleton.offsets)
        out[:, 0] = self.root_pos
        for joints, parents in self.skeleton.levels:
            out[:, joints] += out[:, parents]
        return out

    def resampled(self, fps: float) -> Motion:
        """The same motion at `fps` frames a second: positions linear, rotations by slerp.

        Raises ValueError where `fps` is not above 0.
        """
        if not np.isfinite(fps) or fps <= 0:
            raise ValueError(f"fps must be above 0, not {fps}")
        count = max(1, round(self.duration * fps) + 1)
        return self.sampled(np.clip(np.arange(count) * self.fps / fps, 0, len(self) - 1), fps)

    def sampled(self, at: Array, fps: float) -> Motion:
        """The motion at the frames `at` (n,), fractional and within it, as frames of `fps` a second.

        Positions are linear in between, rotations slerped, contacts those of the nearest frame.
        """
        low = np.minimum(at.astype(int), max(len(self) - 2, 0))
        high, u = np.minimum(low + 1, len(self) - 1), at - low
        quat = quat_continuous(slerp(self.joint_quat[low], self.joint_quat[high], u[:, None]))
        pos = self.root_pos[low] + u[:, None] * (self.root_pos[high] - self.root_pos[low])
        near = np.where(u < 0.5, low, high)
        contacts = None if self.contacts is None else self.contacts[near]
        return replace(self, root_pos=pos, joint_quat=quat, fps=float(fps), contacts=contacts)


def cut(motion: Motion, start: int, end: int) -> Motion:
    """Frames `start` up to `end` of a motion."""
    contacts = None if motion.contacts is None else motion.contacts[start:end]
    return replace(
        motion, root_pos=motion.root_pos[start:end], joint_quat=motion.joint_quat[start:end], contacts=contacts
    )
