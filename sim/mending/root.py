"""The way of the root in the mended motion, before balance moves it: with the feet, and low enough for the legs."""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array, quat_conj, quat_mul, yaw_of_quat, yaw_quat
from retarget.kinematics import Poses, poses
from retarget.timeline import normalised
from sim.mending.body import GRAVITY, Body, sole_turn
from sim.mending.feet import Feet, between
from sim.mending.pace import Pace

BLUR = 0.1  # s, over which the root's way gives where feet were moved
REACH = 0.98  # of a straight leg: what is left bends the knee, which could not move otherwise
AHEAD = 0.3  # s, by which the root is low before a leg must reach
GENTLE = 0.3  # of gravity, that the root speeds up or down at most


def shown(qpos: Array, pace: Pace) -> Array:
    """`qpos` (T, 7 + nj) at the pace of the mended motion: (T', 7 + nj)."""
    return normalised(between(normalised(qpos), pace.at))


def follow(body: Body, qpos: Array, at: Poses, pace: Pace, feet: Feet, fps: float) -> Array:
    """`qpos` (T', 7 + nj) with the root moved and turned as its feet were, on average; `at` are the poses that it was
    `shown` from.
    """
    from scipy.ndimage import gaussian_filter1d

    way, turn = [], []
    for i, leg in enumerate(body.legs):
        way.append(feet.place[:, i, :2] - between(at.place[:, leg.body, :2], pace.at))
        was = between(np.unwrap(yaw_of_quat(sole_turn(leg, at)))[:, None], pace.at)[:, 0]
        now = np.unwrap(yaw_of_quat(quat_mul(feet.turn[:, i], quat_conj(leg.flat))))
        turn.append(now - was - 2 * np.pi * np.rint((now - was)[0] / (2 * np.pi)))
    out = qpos.copy()
    out[:, :2] += gaussian_filter1d(np.mean(way, axis=0), BLUR * fps, axis=0, mode="nearest")
    turned = yaw_quat(gaussian_filter1d(np.mean(turn, axis=0), BLUR * fps, mode="nearest"))
    out[:, 3:7] = quat_mul(turned, qpos[:, 3:7])
    return out


def height(body: Body, qpos: Array, feet: Feet, fps: float) -> Array:
    """(T',) metres of the root of `qpos` (T', 7 + nj), lowered where a leg would not reach its foot; never jumping."""
    from scipy.ndimage import gaussian_filter1d, minimum_filter1d

    at = poses(body.tree, qpos)
    most = np.full(len(qpos), np.inf)
    for i, leg in enumerate(body.legs):
        hip, reach = at.place[:, leg.hip], REACH * leg.length
        across = np.linalg.norm(feet.place[:, i, :2] - hip[:, :2], axis=1)
        up = np.sqrt(np.maximum(reach**2 - across**2, (0.3 * reach) ** 2))
        most = np.minimum(most, feet.place[:, i, 2] + up - hip[:, 2] + qpos[:, 2])
    ahead = round(AHEAD * fps)
    lowered = minimum_filter1d(np.minimum(most - qpos[:, 2], 0.0), 2 * ahead + 1)
    high, blur = qpos[:, 2] + gaussian_filter1d(lowered, ahead / 2, mode="nearest"), 1.0
    while np.abs(np.diff(high, n=2)).max(initial=0.0) * fps**2 > GENTLE * GRAVITY:
        high, blur = gaussian_filter1d(high, blur, mode="nearest"), 1.3 * blur
    return high
