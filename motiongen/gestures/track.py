"""Steps to frames: every channel of the body over time, eased, each joint a little behind the one it hangs from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.gestures.pose import STAND, Arm, Foot, Step
from motiongen.rotation import (
    Array,
    matrix_to_quat,
    quat_continuous,
    quat_mul,
    quat_normalize,
    rotvec_to_quat,
    slerp,
    yaw_quat,
)

# Seconds by which a joint follows the trunk: a chain of limbs unrolls from its root.
LAG = {"spine": 0.02, "head": 0.0, "shrug": 0.02, "shoulder": 0.03, "elbow": 0.07, "wrist": 0.10}
LAST = max(LAG.values())


@dataclass(frozen=True)
class Track:
    """The channels over T frames. Quaternions `w x y z` (T, 4), of the pelvis in the world and of the others as a whole
    on what carries them; `shoulder`, `elbow`, `wrist` for (right, left), the shoulder in the chest's frame; `shrug`
    (T,) in radians; `shift` (T, 3) in metres; `feet` for (right, left), (T, 5): x, y to the left, z, pitch, yaw."""

    pelvis: Array
    spine: Array
    head: Array
    shrug: Array
    shift: Array
    shoulder: tuple[Array, Array]
    elbow: tuple[Array, Array]
    wrist: tuple[Array, Array]
    feet: tuple[Array, Array]


def min_jerk(u: Array) -> Array:
    """0 → 1 at rest at both ends with the least jerk: 10u³ − 15u⁴ + 6u⁵ (Flash and Hogan 1985, Eq. 3)."""
    return u**3 * (10 - 15 * u + 6 * u * u)


EASES: dict[str, Callable[[Array], Array]] = {
    "smooth": min_jerk,
    "launch": lambda u: u * u,
    "brake": lambda u: 1 - (1 - u) ** 2,
    "flow": lambda u: u,
}


def length(steps: Sequence[Step], speed: float) -> float:
    """Seconds that `steps` take, with what the last joint trails behind."""
    return (sum(step.seconds for step in steps) + LAST) / speed


def play(steps: Sequence[Step], speed: float, fps: float) -> Track:
    """`steps` from standing on, `speed` times as fast as written, at `fps` frames a second."""
    poses = [STAND, *(step.pose for step in steps)]
    ends = np.cumsum([0.0, *(step.seconds / speed for step in steps)])
    count = round(length(steps, speed) * fps) + 1

    flows = np.array([step.ease == "flow" for step in steps])

    def blend(rows: Array, lag: float = 0.0) -> Array:
        """Numbers (T, …) of keys (K, …)."""
        segment, u = _progress(ends, steps, np.arange(count) / fps - lag / speed)
        u = u.reshape(-1, *[1] * (rows.ndim - 1))
        return rows[segment] + u * (rows[segment + 1] - rows[segment]) + _bulge(rows, ends, flows, segment, u)

    def turn(rows: Array, lag: float = 0.0) -> Array:
        """Quaternions (T, 4) of keys (K, 4)."""
        segment, u = _progress(ends, steps, np.arange(count) / fps - lag / speed)
        flowing = quat_normalize(blend(quat_continuous(rows), lag))  # near enough: its keys are some 30 degrees apart
        return np.where(flows[segment, None], flowing, slerp(rows[segment], rows[segment + 1], u))

    def vec(name: str) -> Array:
        return np.array([getattr(pose, name) for pose in poses], float)

    arms = [[_arm(getattr(pose, side), out) for pose in poses] for side, out in (("right", -1.0), ("left", 1.0))]
    parts = [[np.array([arm[i] for arm in side]) for i in range(3)] for side in arms]
    feet = [np.array([_foot(getattr(p, f"{side}_foot"), out) for p in poses]) for side, out in _SIDES]
    return Track(
        pelvis=quat_mul(yaw_quat(blend(vec("heading"))), turn(rotvec_to_quat(vec("pelvis")))),
        spine=turn(rotvec_to_quat(vec("spine")), LAG["spine"]),
        head=turn(rotvec_to_quat(vec("head")), LAG["head"]),
        shrug=blend(vec("shrug"), LAG["shrug"]),
        shift=blend(vec("shift")),
        shoulder=(turn(parts[0][0], LAG["shoulder"]), turn(parts[1][0], LAG["shoulder"])),
        elbow=(turn(parts[0][1], LAG["elbow"]), turn(parts[1][1], LAG["elbow"])),
        wrist=(turn(parts[0][2], LAG["wrist"]), turn(parts[1][2], LAG["wrist"])),
        feet=(blend(feet[0]), blend(feet[1])),
    )


_SIDES = (("right", -1.0), ("left", 1.0))


def _progress(ends: Array, steps: Sequence[Step], at: Array) -> tuple[np.ndarray, Array]:
    """Which segment each time lies in, and how far along it the pose is: 0 … 1."""
    segment = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(steps) - 1)
    span = np.maximum(ends[segment + 1] - ends[segment], 1e-9)
    u = np.clip((at - ends[segment]) / span, 0.0, 1.0)
    kinds = np.array([step.ease for step in steps])[segment]
    eased = np.zeros_like(u)
    for name, ease in EASES.items():
        eased = np.where(kinds == name, ease(u), eased)
    return segment, eased


def _bulge(rows: Array, ends: Array, flows: NDArray[np.bool_], segment: NDArray[np.intp], u: Array) -> Array:
    """What a monotone cubic through keys (K, …) at times `ends` has over straight lines, 0 where nothing flows.

    Slopes at the keys are weighted harmonic means of those on both sides (Fritsch and Butland 1984), 0 where one of
    these is or they differ in sign, so that nothing shoots over a key and what stands stays.
    """
    span = np.diff(ends).reshape(-1, *[1] * (rows.ndim - 1))
    line = np.diff(rows, axis=0) / np.maximum(span, 1e-9)
    before, after = span[:-1] + 2 * span[1:], 2 * span[:-1] + span[1:]
    on = (line[:-1] * line[1:] > 0) & (flows[:-1] & flows[1:]).reshape(-1, *[1] * (rows.ndim - 1))
    slope = np.zeros_like(rows)
    one, other = np.where(on, line[:-1], 1.0), np.where(on, line[1:], 1.0)
    slope[1:-1] = np.where(on, (before + after) / (before / one + after / other), 0.0)
    start, end = slope[segment] - line[segment], slope[segment + 1] - line[segment]
    bulge = span[segment] * u * (1 - u) * (start * (1 - u) - end * u)
    return np.where(flows[segment].reshape(u.shape), bulge, 0.0)


def _foot(foot: Foot, out: float) -> tuple[float, float, float, float, float]:
    return foot.x, out * foot.y, foot.z, foot.pitch, foot.yaw


def _arm(arm: Arm, out: float) -> tuple[Array, Array, Array]:
    """Shoulder in the chest's frame, elbow and wrist, quaternions (4,), of the arm on the side `out` (left is 1).

    In the T-pose the arm points outward and the elbow bends forward; the shoulder carries those two directions over.
    """
    upper, fore, hinge = (np.array([x, out * y, z]) for x, y, z in (arm.upper, arm.fore, arm.hinge))
    upper, fore = upper / np.linalg.norm(upper), fore / np.linalg.norm(fore)
    bend = np.arccos(np.clip(upper @ fore, -1.0, 1.0))
    towards = fore - (fore @ upper) * upper if bend > 0.02 else hinge - (hinge @ upper) * upper
    towards = towards / np.linalg.norm(towards)
    # Columns: where x (the way the elbow bends), y (the bone, pointing left) and z of the rest frame go.
    shoulder = np.stack([towards, out * upper, np.cross(towards, out * upper)], axis=1)
    flex, supinate = arm.wrist
    wrist = np.array([-out * flex, out * supinate, 0.0])
    return matrix_to_quat(shoulder), rotvec_to_quat(np.array([0.0, 0.0, -out * bend])), rotvec_to_quat(wrist)
