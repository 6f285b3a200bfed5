"""The body that gestures are written for: an adult of about 1.65 m on the canonical 22 joints, sizes rounded."""

from __future__ import annotations

import numpy as np

from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Skeleton
from motiongen.skeletons import SMPL

UPPER_ARM, FOREARM = 0.245, 0.225  # m, shoulder to elbow, elbow to wrist
THIGH, SHIN = 0.39, 0.41  # m
SHOULDER = 0.105  # m, from the middle of the body out to the shoulder joint
TOES = (0.09, 0.0, -0.075)  # m, from the ankle to the ball of the foot
HIP = 0.07  # m, from the middle out to the hip joint
STANCE = 0.09  # m, from the middle out to a standing foot
SOFT_KNEES = 0.015  # m by which relaxed knees lower the pelvis: straight legs have no way to give

_OFFSETS = {
    "left_hip": (0, HIP, -0.02),
    "left_knee": (0, 0, -THIGH),
    "left_ankle": (0, 0, -SHIN),
    "left_foot": TOES,
    "spine1": (0, 0, 0.15),
    "spine2": (0, 0, 0.05),
    "spine3": (0, 0, 0.05),
    "neck": (0, 0, 0.16),
    "head": (0, 0, 0.07),
    "left_collar": (0, 0.05, 0.13),
    "left_shoulder": (0, SHOULDER - 0.05, 0),
    "left_elbow": (0, UPPER_ARM, 0),
    "left_wrist": (0, FOREARM, 0),
}


def _skeleton() -> Skeleton:
    rows = []
    for name in SMPL_JOINTS:
        x, y, z = _OFFSETS.get(name.replace("right", "left"), (0, 0, 0))
        rows.append((x, -y if name.startswith("right") else y, z))
    return Skeleton(SMPL_JOINTS, SMPL_PARENTS, np.array(rows), SMPL.foot_height)


BODY = _skeleton()
ANKLE_HEIGHT = BODY.foot_height[0]
STANDING = ANKLE_HEIGHT + SHIN + THIGH + 0.02 - SOFT_KNEES  # m, height of the pelvis
