"""Staying upright on the ankles: what is added to the servos' targets when the root leans other than the motion.

A rig that leans is pushed back by the foot that it stands on, as people do it on a swaying bus: each ankle's target is
moved in proportion to the lean and, to look ahead, to its rate. That needs an IMU, which feels both, and nothing else;
turns about the vertical, which it cannot feel, play no part. The gains are the rig's (`[foot.upright]` in rig.toml).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array, cross, quat_conj, quat_mul, quat_rotate, quat_to_rotvec, yaw_of_quat, yaw_quat
from retarget.rig import Rig
from retarget.trajectory import Trajectory

UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Upright:
    """`gain` (feet, nj, 2): rad that a joint's target moves, while that foot alone stands, per rad of lean about the
    heading's x axis (to the right) and y axis (forward). `ahead` s: how much of its rate counts as lean. `delay` s: how
    old what the IMU says is.
    """

    gain: Array
    ahead: float
    delay: float


def upright_of(rig: Rig) -> Upright:
    """What keeps `rig` upright. Raises ValueError where it has no IMU, or no foot of it has gains."""
    if not rig.sensors.imu:
        raise ValueError(f"rig {rig.name!r} has no IMU to keep it upright")
    gain = np.array([[foot.upright.get(j.name, (0.0, 0.0)) for j in rig.joints] for foot in rig.feet])
    if not gain.any():
        raise ValueError(f"rig {rig.name!r}: no foot has gains (foot.upright) to keep it upright")
    return Upright(gain, rig.ahead, rig.sensors.delay)


def lean(felt: Array, spin: Array, asked: Array, turning: Array, ahead: float) -> Array:
    """(..., 2) rad: how much more than asked the root leans about the heading's x and y axes, `ahead` s from now.

    `felt` (..., 4) is the root's orientation, of which its yaw plays no part, and `spin` (..., 3) rad/s what its
    gyroscope says; `asked` (..., 4) and `turning` (..., 3) are what both should be.
    """
    off = cross(quat_rotate(quat_conj(felt), UP), quat_rotate(quat_conj(asked), UP))  # in the root's frame
    level = quat_mul(quat_conj(yaw_quat(yaw_of_quat(asked))), asked)
    return quat_rotate(level, off + ahead * (spin - turning))[..., :2]


def corrections(upright: Upright, leans: Array, stands: NDArray[np.bool_]) -> Array:
    """(..., nj) rad to add to the targets, for `leans` (..., 2) and the feet that stand, `stands` (feet,)."""
    share = stands / max(int(stands.sum()), 1)
    return np.einsum("f,fja,...a->...j", share, upright.gain, leans)


def turning(trajectory: Trajectory) -> Array:
    """(T, 3) rad/s, in its own frame, at which the root of `trajectory` turns from each frame to the next."""
    quat = trajectory.root_quat
    rate = quat_to_rotvec(quat_mul(quat_conj(quat[:-1]), quat[1:])) * trajectory.fps
    return np.concatenate([rate, np.zeros((1, 3))])


def standing(trajectory: Trajectory, rig: Rig) -> NDArray[np.bool_]:
    """(T, feet) which feet of `rig` the motion says stand; all of them where it says nothing."""
    every = np.ones(len(trajectory), bool)
    return np.stack([trajectory.contacts.get(foot.name, every) for foot in rig.feet], axis=1)
