"""What is done to drawn features before they are a motion: smoothed, feet that stand planted, put on the floor."""

from __future__ import annotations

import numpy as np

from motiongen.features import CONTACTS, HEIGHT, PLANAR, features_to_motion
from motiongen.motion import FOOT_JOINTS, Motion, Skeleton
from motiongen.rotation import Array, quat_conj, quat_rotate, yaw_of_quat, yaw_quat


def finished(features: Array, skeleton: Skeleton) -> Array:
    """Features (T, 140) of a whole clip: smoothed, on the floor, with the slip of planted feet off the root's path."""
    features = smoothed_over_five(features)
    drawn = features_to_motion(features, skeleton)
    features[:, HEIGHT] -= _floats(drawn)
    features[:, PLANAR] -= slip(drawn, features[:, CONTACTS])
    return features


def smoothed_over_five(features: Array) -> Array:
    """Binomial smoothing over five frames, which takes away what jitters faster than people can (over ~8 Hz)."""
    padded = np.concatenate([features[:1]] * 2 + [features] + [features[-1:]] * 2)
    return np.sum([k / 16 * padded[i : i + len(features)] for i, k in enumerate((1, 4, 6, 4, 1))], axis=0)


def slip(motion: Motion, touch: Array) -> Array:
    """Planar velocity (T, 2) in m/s, in each frame's heading, with which feet slide that should stand.

    The mean over `FOOT_JOINTS`, each weighed by how surely it touches the floor (`touch` (T, 4), 0…1). Taken off the
    root's velocity, it is the planted foot that stays and the body that moves over it.
    """
    feet = motion.positions()[:, [motion.skeleton.index(n) for n in FOOT_JOINTS]]
    moved = np.zeros((len(feet), len(FOOT_JOINTS), 3))
    moved[:-1] = np.diff(feet, axis=0) * motion.fps
    sure = np.clip(touch, 0.0, 1.0)
    sure[:-1] = np.minimum(sure[:-1], sure[1:])
    mean = (moved * sure[..., None]).sum(1) / np.maximum(sure.sum(1), 1e-6)[:, None]
    heading = yaw_quat(yaw_of_quat(motion.joint_quat[:, 0]))
    return smoothed_over_five(quat_rotate(quat_conj(heading), mean)[:, :2] * sure.max(1)[:, None])


def _floats(motion: Motion) -> float:
    """Metres by which the lower foot lies too high in most frames (the 20 % quantile: a runner flies in between)."""
    ankle, toe = motion.skeleton.foot_height
    names = motion.skeleton.names
    at = motion.positions()[:, [names.index(n) for n in ("left_ankle", "right_ankle", "left_foot", "right_foot")], 2]
    return float(np.quantile((at - np.array([ankle, ankle, toe, toe])).min(axis=1), 0.2))
