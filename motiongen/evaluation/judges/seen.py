"""What an evaluator of ours sees of a motion: 71 numbers per frame, 15 frames a second, in the heading frame.

| columns | what | unit |
|---|---|---|
| 0 | yaw rate | rad/s |
| 1:3 | planar velocity of the pelvis, forward and left | m/s |
| 3 | height of the pelvis | m |
| 4:67 | the other 21 joints from the pelvis, forward, left and up | m |
| 67:71 | contacts of left ankle, left foot, right ankle, right foot | 0 or 1 |

Every motion is put on one body, by its joint angles, its way and height scaled by the length of the legs: bone lengths
would tell the clips of one source from those of another. Contacts are found anew; what a generator says of its own feet
is not believed. The twist of a bone about itself is not seen.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.features import CONTACTS, FPS, HEIGHT, MIRRORED_JOINT, PLANAR, TURNS, YAW, motion_to_features
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion
from motiongen.rotation import Array, matrix_from_6d
from motiongen.smpl import SMPL_SKELETON

WIDTH = 71
EVERY = 2  # of the features' frames one is seen: half the cost, and no gesture is faster than 7 Hz
SEEN_FPS = FPS / EVERY
MOST_SECONDS = 8.0  # of a motion that are seen, from its start
MOST_FRAMES = round(MOST_SECONDS * SEEN_FPS)
_PLACES, _CONTACTS = slice(4, 67), slice(67, 71)
_LEG = [SMPL_JOINTS.index(name) for name in ("left_knee", "left_ankle", "right_knee", "right_ankle")]


def see_motion(motion: Motion) -> NDArray[np.float32]:
    """What is seen (T, 71) of a motion's first 8 s; raises ValueError where its skeleton is not SMPL's 22 joints."""
    return see(motion_to_features(motion), motion.skeleton.offsets)[:MOST_FRAMES]


def see(features: NDArray[np.floating], offsets: Array) -> NDArray[np.float32]:
    """What is seen (T / 2, 71) of features (T, 140) of a body with `offsets` (22, 3) in metres."""
    features = features[::EVERY]
    size = leg_length(SMPL_SKELETON.offsets) / leg_length(offsets)
    axes = matrix_from_6d(np.asarray(features[:, TURNS], float).reshape(len(features), len(SMPL_JOINTS), 6))
    where = np.zeros((len(features), len(SMPL_JOINTS), 3))
    for j, parent in enumerate(SMPL_PARENTS):
        if parent >= 0:
            where[:, j] = where[:, parent] + axes[:, parent] @ SMPL_SKELETON.offsets[j]
    out = np.empty((len(features), WIDTH), np.float32)
    out[:, YAW] = features[:, YAW]
    out[:, PLANAR] = features[:, PLANAR] * size
    out[:, HEIGHT] = features[:, HEIGHT] * size
    out[:, _PLACES] = where[:, 1:].reshape(len(features), -1)
    out[:, _CONTACTS] = features[:, CONTACTS] > 0.5
    return out


def leg_length(offsets: Array) -> float:
    """Thigh and shin in metres, the mean of left and right, of `offsets` (22, 3)."""
    return float(np.linalg.norm(offsets[_LEG], axis=1).sum() / 2)


def mirror_seen(seen: NDArray[np.float32]) -> NDArray[np.float32]:
    """What would be seen (T, 71) of the mirror image."""
    out = seen * np.where(np.arange(WIDTH) % 3 == 2, -1, 1).astype(np.float32)  # column 2 and every joint's left
    out[:, YAW] = -seen[:, YAW]
    out[:, _PLACES] = out[:, _PLACES].reshape(len(seen), -1, 3)[:, MIRRORED_JOINT[1:] - 1].reshape(len(seen), -1)
    out[:, _CONTACTS] = seen[:, _CONTACTS][:, [2, 3, 0, 1]]
    return out
