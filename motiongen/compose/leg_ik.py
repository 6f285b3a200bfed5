"""Ankles where they are wanted: the leg that a motion has, bent and swung until its ankle is there."""

from __future__ import annotations

import numpy as np

from motiongen.measure.swings import smoothed
from motiongen.motion import SMPL_JOINTS, Motion, Skeleton
from motiongen.rotation import Array, axis_angle_to_quat, quat_conj, quat_mul, quat_rotate, shortest_arc

STRAIGHT = 0.9999  # share of its length to which a leg stretches: at 1 the knee would not know which way to bend …
SOFT = 0.995  # … and to which it does without the pelvis giving way: close to 1 knees snap open and shut
SINK_S = 0.2  # s over which the pelvis gives way, before and after it must
SIDES = ("left", "right")


def with_ankles(motion: Motion, ankles: Array) -> Array:
    """`joint_quat` (T, 22, 4) of `motion` with hips, knees and ankles turned so that the ankles are at `ankles`
    (T, 2, 3): world, metres, left and right. Pelvis and soles keep their orientation in the world, each knee the plane
    in which it bends: where an ankle is in its place already, nothing changes.

    Two bones and the law of cosines. Raises ValueError where a leg is too short.
    """
    at, turn, quat = motion.positions(), motion.global_quat(), motion.joint_quat.copy()
    for side, goal in zip(SIDES, (ankles[:, 0], ankles[:, 1]), strict=True):
        knee = SMPL_JOINTS.index(f"{side}_knee")
        hip, ankle = _hip_and_ankle(side)
        thigh, shin = leg_bones(motion.skeleton, side)
        far = np.linalg.norm(goal - at[:, hip], axis=1)
        reach = _distance(at, hip, ankle)
        short = far > np.maximum(STRAIGHT * (thigh + shin), reach) + 1e-6
        if short.any():
            raise ValueError(
                f"the {side} foot is {far[short].max():.3f} m from its hip; the leg is {thigh + shin:.3f} m"
            )
        # The knee opens or closes about its own axis until the ankle is as far from the hip as its goal …
        upper, lower = at[:, knee] - at[:, hip], at[:, ankle] - at[:, knee]
        axis, forward = _knee_axis(upper, lower, turn[:, hip])
        bend = _knee_angle(thigh, shin, far) - forward * _knee_angle(thigh, shin, reach)
        shin_turn = quat_mul(axis_angle_to_quat(axis, bend), turn[:, knee])
        # … and the whole leg swings about the hip until the ankle is there.
        moved = upper + quat_rotate(axis_angle_to_quat(axis, bend), lower)
        swing = shortest_arc(_unit(moved), _unit(goal - at[:, hip]))
        thigh_turn, shin_turn = quat_mul(swing, turn[:, hip]), quat_mul(swing, shin_turn)
        quat[:, hip] = quat_mul(quat_conj(turn[:, 0]), thigh_turn)
        quat[:, knee] = quat_mul(quat_conj(thigh_turn), shin_turn)
        quat[:, ankle] = quat_mul(quat_conj(shin_turn), turn[:, ankle])
    return quat


def sinking(motion: Motion, ankles: Array) -> Array:
    """Metres (T,), 0 or more, by which the pelvis must sink for both legs to reach `ankles` (T, 2, 3), smooth in time.

    Raises ValueError where a foot is too far aside for any height.
    """
    at, need = motion.positions(), np.zeros(len(motion))
    for side, goal in zip(SIDES, (ankles[:, 0], ankles[:, 1]), strict=True):
        line = at[:, SMPL_JOINTS.index(f"{side}_hip")] - goal
        aside, leg = np.linalg.norm(line[:, :2], axis=1), SOFT * sum(leg_bones(motion.skeleton, side))
        if aside.max() > leg:
            raise ValueError(f"the {side} foot is {aside.max():.3f} m aside of its hip; the leg is {leg:.3f} m long")
        too_far = np.linalg.norm(line, axis=1) > np.maximum(leg, _distance(at, *_hip_and_ankle(side))) + 1e-6
        need = np.maximum(need, np.where(too_far, line[:, 2] - np.sqrt(leg**2 - aside**2), 0.0))
    half = max(1, round(SINK_S * motion.fps / 2))  # the highest need in reach of the average, so that it is enough
    padded = np.pad(need, half)
    highest = np.max([padded[i : i + len(need)] for i in range(2 * half + 1)], axis=0)
    return smoothed(highest, motion.fps, SINK_S)


def leg_bones(skeleton: Skeleton, side: str) -> tuple[float, float]:
    """Length in metres of thigh and shin."""
    thigh, shin = (np.linalg.norm(skeleton.offsets[skeleton.index(f"{side}_{name}")]) for name in ("knee", "ankle"))
    return float(thigh), float(shin)


def _knee_angle(thigh: float, shin: float, far: Array) -> Array:
    """Radians (T,) by which a knee is bent, 0 straight, when hip and ankle are `far` (T,) metres apart."""
    return np.pi - np.arccos(np.clip((thigh**2 + shin**2 - far**2) / (2 * thigh * shin), -1, 1))


def _knee_axis(upper: Array, lower: Array, thigh: Array) -> tuple[Array, Array]:
    """Axis (T, 3) about which the knee bends as knees do, of a straight leg the thigh's own left; and 1, or -1 where
    the knee is overstretched, (T,)."""
    across = np.cross(upper, lower)
    size = np.linalg.norm(across, axis=1, keepdims=True)
    left = quat_rotate(thigh, [0.0, 1.0, 0.0])
    forward = np.where(np.sum(across * left, axis=1) < 0, -1.0, 1.0)
    straight = size < 1e-3 * np.linalg.norm(upper, axis=1, keepdims=True) * np.linalg.norm(lower, axis=1, keepdims=True)
    return np.where(straight, left, forward[:, None] * across / np.maximum(size, 1e-12)), forward


def _hip_and_ankle(side: str) -> tuple[int, int]:
    return SMPL_JOINTS.index(f"{side}_hip"), SMPL_JOINTS.index(f"{side}_ankle")


def _distance(at: Array, a: int, b: int) -> Array:
    return np.linalg.norm(at[:, a] - at[:, b], axis=1)


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
