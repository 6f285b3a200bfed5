"""The numbers a model sees: 140 per frame at 30 frames a second, in the heading frame, and back to a `Motion`.

| columns | what | unit |
|---|---|---|
| 0 | yaw rate to the next frame | rad/s |
| 1:3 | planar velocity of the pelvis to the next frame, forward and left in this frame's heading | m/s |
| 3 | height of the pelvis | m |
| 4:136 | orientation of the 22 joints in the heading frame, 6-d each | – |
| 136:140 | contacts of left ankle, left foot, right ankle, right foot | 0…1 |

Joint orientations are global but for the heading: errors do not add up along a limb, and forward kinematics is a sum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.motion import FOOT_JOINTS, SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source
from motiongen.rotation import (
    Array,
    matrix_from_6d,
    matrix_to_6d,
    matrix_to_quat,
    quat_conj,
    quat_continuous,
    quat_mul,
    quat_rotate,
    quat_to_matrix,
    yaw_of_quat,
    yaw_quat,
)

FPS = 30.0
YAW, PLANAR, HEIGHT = 0, slice(1, 3), 3
TURNS = slice(4, 136)
CONTACTS = slice(136, 140)
WIDTH = 140

CONTACT_SPEED = 0.15  # m/s and …
CONTACT_HEIGHT = 0.10  # m above where the joint lies when the sole is flat: the two of the contact label

MIRRORED_JOINT = np.array(  # row of the joint on the other side
    [SMPL_JOINTS.index(n.replace("left", "?").replace("right", "left").replace("?", "right")) for n in SMPL_JOINTS]
)
_FEET = np.array([SMPL_JOINTS.index(n) for n in FOOT_JOINTS])


def find_contacts(motion: Motion) -> NDArray[np.bool_]:
    """Contacts (T, 4) of `FOOT_JOINTS`: slower than 0.15 m/s and less than 0.10 m above its height on a flat sole."""
    feet = motion.positions()[:, _FEET]
    if len(motion) == 1:
        speed = np.zeros(feet.shape[:2])
    else:
        speed = np.linalg.norm(np.gradient(feet, axis=0), axis=-1) * motion.fps
    ankle, toe = motion.skeleton.foot_height
    above = feet[..., 2] - np.array([ankle, toe, ankle, toe])
    return (speed < CONTACT_SPEED) & (above < CONTACT_HEIGHT)


def motion_to_features(motion: Motion) -> NDArray[np.float32]:
    """Features (T, 140) of a motion on the canonical skeleton, resampled to 30 frames a second.

    Raises ValueError where the skeleton is not the 22 joints of SMPL.
    """
    if motion.skeleton.names != SMPL_JOINTS:
        raise ValueError(f"features need the {len(SMPL_JOINTS)} joints of SMPL, not {motion.skeleton.names}")
    if motion.fps != FPS:
        motion = motion.resampled(FPS)
    turn = motion.global_quat()
    yaw = np.unwrap(yaw_of_quat(turn[:, 0]))
    level = quat_conj(yaw_quat(yaw))
    out = np.zeros((len(motion), WIDTH), np.float32)
    if len(motion) > 1:
        step = np.diff(motion.root_pos, axis=0) * FPS
        out[:-1, YAW] = np.diff(yaw) * FPS
        out[:-1, PLANAR] = quat_rotate(level[:-1], step)[:, :2]
        out[-1, :3] = out[-2, :3]
    out[:, HEIGHT] = motion.root_pos[:, 2]
    out[:, TURNS] = matrix_to_6d(quat_to_matrix(quat_mul(level[:, None], turn))).reshape(len(motion), -1)
    out[:, CONTACTS] = find_contacts(motion)
    return out


def root_path(features: NDArray[np.floating]) -> tuple[Array, Array]:
    """Heading (T,) in radians and place (T, 3) in metres of the pelvis that features (T, 140) lead along, from the
    origin facing +x."""
    yaw = np.concatenate([[0.0], np.cumsum(features[:-1, YAW]) / FPS])
    planar = np.concatenate([features[:, PLANAR], np.zeros((len(features), 1))], axis=1)
    step = quat_rotate(yaw_quat(yaw), planar)[:-1] / FPS
    root = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    root[:, 2] = features[:, HEIGHT]
    return yaw, root


def features_to_motion(
    features: NDArray[np.floating], skeleton: Skeleton, *, labels: tuple[Label, ...] = (), source: Source | None = None
) -> Motion:
    """The motion that features (T, 140) describe, starting at the origin and facing +x.

    6-d orientations are made orthonormal; raises ValueError where the features are not finite.
    """
    features = np.asarray(features, float)
    turn = features[:, TURNS].reshape(len(features), len(SMPL_JOINTS), 6)
    yaw, root = root_path(features)
    world = quat_mul(yaw_quat(yaw)[:, None], matrix_to_quat(matrix_from_6d(turn)))
    local = world.copy()
    for j, parent in enumerate(SMPL_PARENTS):
        if parent >= 0:
            local[:, j] = quat_mul(quat_conj(world[:, parent]), world[:, j])
    return Motion(
        root,
        quat_continuous(local),
        FPS,
        skeleton,
        labels=labels,
        source=source or Source("features"),
        contacts=features[:, CONTACTS] > 0.5,
    )


def mirror(features: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same motion with left and right exchanged; mirroring twice gives the features back."""
    out = np.array(features)
    out[..., YAW] *= -1
    out[..., 2] *= -1
    turn = features[..., TURNS].reshape(*features.shape[:-1], len(SMPL_JOINTS), 2, 3)[..., MIRRORED_JOINT, :, :]
    # Reflecting y conjugates a rotation R to S·R·S with S = diag(1, −1, 1).
    turn = turn * np.array([[1, -1, 1], [-1, 1, -1]], np.float32)
    out[..., TURNS] = turn.reshape(*features.shape[:-1], -1)
    out[..., CONTACTS] = features[..., CONTACTS][..., [2, 3, 0, 1]]
    return out
