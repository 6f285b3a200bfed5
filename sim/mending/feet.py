"""The way of the feet in the mended motion: still and flat while they stand, and clear of the floor in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.rotation import (
    Array,
    quat_conj,
    quat_mul,
    quat_rotate,
    quat_to_rotvec,
    rotvec_to_quat,
    yaw_of_quat,
    yaw_quat,
)
from retarget.contacts import Flags
from retarget.kinematics import Poses
from sim.mending.body import Body, Leg, sole_height, sole_turn
from sim.mending.pace import Pace
from sim.mending.steps import Stance, Steps, Swing, turned

CLEAR = 0.075  # of the root's height, that a sole is lifted half-way
APART = 0.8  # of the distance between the feet at first, that one keeps from the other where it passes
FADE = 0.2  # of a swing, at either end, over which the motion's own way of the foot comes in


@dataclass(frozen=True)
class Feet:
    """Where each of n legs has its foot's body: `place` (T, n, 3), `turn` (T, n, 4); `stands` (T, n)."""

    place: Array
    turn: Array
    stands: Flags


def find_feet(body: Body, steps: Steps, pace: Pace, at: Poses) -> Feet:
    """The feet of a mended motion; `at` are the poses of the motion as it was."""
    frames, legs = len(pace.at), len(body.legs)
    place, turn = np.empty((frames, legs, 3)), np.empty((frames, legs, 4))
    stands = np.ones((frames, legs), bool)
    beside = _beside(steps)
    for i, leg in enumerate(body.legs):
        now = steps.first[i]
        _stand(place[:, i], turn[:, i], leg, now.spot, now.yaw)
        for swing, other, (lift, land) in zip(steps.swings, beside, pace.swings, strict=True):
            if swing.leg != i:
                continue
            place[lift:land, i], turn[lift:land, i] = _way(body, leg, swing, at, land - lift)
            if other is not None:
                place[lift:land, i, :2] = _past(place[lift:land, i, :2], leg, steps, i, other)
            stands[lift + 1 : land, i] = False
            _stand(place[land:, i], turn[land:, i], leg, swing.after.spot, swing.after.yaw)
    return Feet(place, turn, stands)


def _beside(steps: Steps) -> list[Stance | None]:
    """For each swing where the other foot stands; None where there is not just one other."""
    now, found = list(steps.first), list[Stance | None]()
    for swing in steps.swings:
        found.append(now[1 - swing.leg] if len(now) == 2 else None)
        now[swing.leg] = swing.after
    return found


def _past(flat: Array, leg: Leg, steps: Steps, foot: int, other: Stance) -> Array:
    """The way `flat` (frames, 2) of foot number `foot`, bowed out where it would pass too near the one on `other`."""
    first, beside = steps.first[foot], steps.first[1 - foot]
    apart = turned(first.spot - beside.spot, -beside.yaw)
    side = float(np.sign(apart[1]))
    ahead, aside = turned((flat - other.spot).T, -other.yaw)
    u = np.arange(len(flat)) / len(flat)
    bow = 16 * (u * (1 - u)) ** 2
    lacks = APART * float(np.linalg.norm(apart)) - side * aside
    alongside = (np.abs(ahead) < float(np.ptp(leg.sole[:, 0]))) & (lacks > 0)
    if not alongside.any():
        return flat
    out = float((lacks / np.maximum(bow, 0.5))[alongside].max()) * side  # ends are footholds, and stay
    return flat + bow[:, None] * turned(np.array([0.0, out]), other.yaw)


def _stand(place: Array, turn: Array, leg: Leg, spot: Array, yaw: float) -> None:
    place[:, :2], place[:, 2] = spot, leg.rise
    turn[:] = quat_mul(yaw_quat(yaw), leg.flat)


def _way(body: Body, leg: Leg, swing: Swing, at: Poses, frames: int) -> tuple[Array, Array]:
    """(frames, 3) and (frames, 4): by minimum jerk from stance to stance, and what the motion does beside that."""
    from scipy.ndimage import gaussian_filter1d

    u = np.arange(frames) / frames
    s = u**3 * (10 - 15 * u + 6 * u * u)
    own = np.clip(swing.start + u * max(swing.end - swing.start, 1), 0, len(at.place) - 1)
    fade = np.clip(np.minimum(u, 1 - u) / FADE, 0, 1)
    fade = (fade * fade * (3 - 2 * fade))[:, None]

    path = between(at.place[:, leg.body, :2], own)
    aside = path - (path[0] + s[:, None] * (path[-1] - path[0]))
    height = CLEAR * body.height
    high = between(sole_height(leg, at)[:, None], own)[:, 0] * fade[:, 0]
    bump = height * 16 * (u * (1 - u)) ** 2
    lifted = bump + gaussian_filter1d(np.maximum(high - height, 0) * fade[:, 0], FADE * frames / 4, mode="constant")
    free = gaussian_filter1d(np.clip(high / height - 1, 0, 1), FADE * frames / 4, mode="constant")[:, None]
    flat = swing.before.spot + s[:, None] * (swing.after.spot - swing.before.spot) + free * fade * aside

    yaw = swing.before.yaw + s * (swing.after.yaw - swing.before.yaw)
    sole = sole_turn(leg, at)
    tilt = between(quat_to_rotvec(quat_mul(quat_conj(yaw_quat(yaw_of_quat(sole))), sole)), own)
    turn = quat_mul(quat_mul(yaw_quat(yaw), rotvec_to_quat(free * fade * tilt)), leg.flat)
    corners = quat_rotate(turn[:, None], leg.sole[None])
    return np.hstack([flat, (lifted - corners[..., 2].min(1))[:, None]]), turn


def between(values: Array, at: Array) -> Array:
    """`values` (T, k) at the fractional frames `at` (n,), linear between them."""
    low = np.minimum(at.astype(int), len(values) - 1)
    high = np.minimum(low + 1, len(values) - 1)
    u = (at - low)[:, None]
    return values[low] * (1 - u) + values[high] * u
