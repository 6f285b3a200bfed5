"""The canonical 22 joints at the size of HumanML3D's body, measured, for files that carry no bone lengths."""

from __future__ import annotations

import numpy as np

from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Skeleton

# Metres, x forward, y left, z up, from the parent. Lengths: clip 012314 of HumanML3D (MIT), whose bones are rigid to
# 1e-6 m, the mean of left and right. Directions: within the pelvis (hips, spine1) and the chest (neck, collars) also
# measured there, the pelvis pitched so that hips and spine1 lean back alike; limbs and spine straight; the foot as it
# lies in the clip's planted frames, which give the foot height too.
_OFFSETS = {
    "left_hip": (-0.0126, 0.0603, -0.0867),
    "left_knee": (0, 0, -0.3919),
    "left_ankle": (0, 0, -0.4290),
    "left_foot": (0.1384, 0, -0.0478),
    "spine1": (-0.0190, 0, 0.1302),
    "spine2": (0, 0, 0.1432),
    "spine3": (0, 0, 0.0574),
    "neck": (0, 0, 0.2194),
    "head": (0, 0, 0.1030),
    "left_collar": (-0.0151, 0.0719, 0.1196),
    "left_shoulder": (0, 0.1273, 0),
    "left_elbow": (0, 0.2600, 0),
    "left_wrist": (0, 0.2679, 0),
}


def _skeleton() -> Skeleton:
    offsets = np.zeros((len(SMPL_JOINTS), 3))
    for j, name in enumerate(SMPL_JOINTS[1:], start=1):
        offsets[j] = _OFFSETS[name.replace("right", "left")]
        if name.startswith("right"):
            offsets[j, 1] *= -1
    return Skeleton(SMPL_JOINTS, SMPL_PARENTS, offsets, foot_height=(0.060, 0.012))


SMPL_SKELETON = _skeleton()
