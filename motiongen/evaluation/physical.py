"""How a motion moves, by measure: what no embedding sees. Every threshold in SI units, none per frame.

| figure | what | source |
|---|---|---|
| skate ratio | share of frames with a low toe in which that toe moves along the floor | Kimodo |
| skate speed | planar speed of low toes, m/s | |
| jerk | third derivative of joint positions, m/s³ | |
| penetration, floating | how far the lowest sole is below, above the floor, m | PhysDiff (Yuan et al. 2023) |
| broken | moves as no body can: too fast, or in the air for a second | |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motiongen.evaluation.metrics import interval
from motiongen.motion import FOOT_JOINTS, Motion
from motiongen.rotation import Array, quat_conj, quat_mul, quat_to_rotvec

LOW = 0.05  # m: a toe that is lower, in two frames that follow each other, is on the floor …
SLIDING = 0.2  # m/s: … and skates where it moves faster along it
TOLERANCE = 0.005  # m by which a sole may be off the floor: the labelling noise of motion capture
FASTEST_BODY = 15.0  # m/s
FASTEST_JOINT = 40.0  # rad/s
AIRBORNE = 0.2  # m above the floor …
AIRBORNE_SECONDS = 1.0  # … for as long: nobody jumps so


@dataclass(frozen=True)
class Physical:
    """One motion's figures. `skate_ratio` and `skate_speed` are None where no toe is ever low; `jerk` where there are
    under four frames. `broken`: what is beyond a body, or empty."""

    skate_ratio: float | None
    skate_speed: float | None
    jerk: float | None
    penetration: float
    floating: float
    broken: str


@dataclass(frozen=True)
class PhysicalSummary:
    """Means over the motions that have the figure, with half of their 95 % interval over motions; None where none has.

    `broken`: share of motions.
    """

    motions: int
    skate_ratio: tuple[float, float] | None
    skate_speed: tuple[float, float] | None
    jerk: tuple[float, float] | None
    penetration: tuple[float, float]
    floating: tuple[float, float]
    broken: float


def measure_physics(motion: Motion) -> Physical:
    """The figures of one motion at its own frame rate; the floor is z = 0.

    Heights are those above where a foot joint lies when its sole is flat. Raises ValueError where the skeleton lacks
    the joints of the feet.
    """
    where = motion.positions()
    rows = [motion.skeleton.index(name) for name in FOOT_JOINTS]
    ankle, toe = motion.skeleton.foot_height
    above = where[:, rows, 2] - np.array([ankle, toe, ankle, toe])
    lowest = above.min(1)
    low, speed = low_toes(above[:, [1, 3]], where[:, [rows[1], rows[3]], :2], motion.fps)
    jerk = np.linalg.norm(np.diff(where, 3, axis=0), axis=-1) * motion.fps**3
    return Physical(
        skate_ratio=float((speed[low] > SLIDING).mean()) if low.any() else None,
        skate_speed=float(speed[low].mean()) if low.any() else None,
        jerk=float(jerk.mean()) if len(jerk) else None,
        penetration=float(np.maximum(-(lowest + TOLERANCE), 0.0).mean()),
        floating=float(np.maximum(lowest - TOLERANCE, 0.0).mean()),
        broken=_broken(motion, where, lowest),
    )


def low_toes(height: Array, planar: Array, fps: float) -> tuple[np.ndarray, Array]:
    """Whether each toe (T − 1, F) is low in a frame and the next, and its planar speed (m/s) between them.

    `height` (T, F) above the flat sole and `planar` (T, F, 2), in metres.
    """
    low = (height[1:] < LOW) & (height[:-1] < LOW)
    return low, np.linalg.norm(np.diff(planar, axis=0), axis=-1) * fps


def summarise(motions: Sequence[Motion]) -> PhysicalSummary:
    """Means of the figures over motions; raises ValueError where there are none, and as `measure_physics`."""
    if not motions:
        raise ValueError("no motions to measure")
    each = [measure_physics(motion) for motion in motions]

    def over(values: list[float | None]) -> tuple[float, float] | None:
        there = [v for v in values if v is not None]
        return interval(there) if there else None

    return PhysicalSummary(
        motions=len(each),
        skate_ratio=over([p.skate_ratio for p in each]),
        skate_speed=over([p.skate_speed for p in each]),
        jerk=over([p.jerk for p in each]),
        penetration=interval([p.penetration for p in each]),
        floating=interval([p.floating for p in each]),
        broken=float(np.mean([bool(p.broken) for p in each])),
    )


def _broken(motion: Motion, where: Array, lowest: Array) -> str:
    """The first thing that no body does, with its figure; empty where there is none."""
    if len(motion) > 1:
        body = np.linalg.norm(np.diff(where, axis=0), axis=-1).max() * motion.fps
        if body > FASTEST_BODY:
            return f"a body moves at {body:.1f} m/s"
        turn = quat_mul(quat_conj(motion.joint_quat[:-1]), motion.joint_quat[1:])
        joint = np.linalg.norm(quat_to_rotvec(turn), axis=-1).max() * motion.fps
        if joint > FASTEST_JOINT:
            return f"a joint turns at {joint:.0f} rad/s"
    longest = run = 0
    for up in lowest > AIRBORNE:
        run = run + 1 if up else 0
        longest = max(longest, run)
    if longest >= AIRBORNE_SECONDS * motion.fps:
        return f"in the air for {longest / motion.fps:.1f} s"
    return ""
