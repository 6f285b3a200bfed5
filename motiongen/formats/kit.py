"""KIT-ML's 21 joints, those of the MMM model, to the canonical 22 and back.

The data set's coordinates are y up, facing +z, and mirror images: with the toes towards +z the joints that MMM calls
left lie towards -x. That is how language2pose, from which its authors took the joints, swaps MMM's y and z. Its unit is
the MMM model's millimetre, of a body 1 m tall; TEMOS measures 480 of them on 0.75 m of SMPL's body, taken here.
"""

from __future__ import annotations

import numpy as np

from motiongen.formats.fit import fill_joints
from motiongen.formats.humanml import KIT_ML, facing_front
from motiongen.motion import Motion
from motiongen.rotation import Array

METRES = 0.75 / 480  # per unit of the data set
# The data set's rows. The two middles of the feet (MMM's LMrot, RMrot) have no place among the canonical joints.
JOINTS = (
    "pelvis", "spine1", "spine3", "neck", "head", "left_shoulder", "left_elbow", "left_wrist", "right_shoulder",
    "right_elbow", "right_wrist", "left_hip", "left_knee", "left_ankle", "", "left_foot", "right_hip", "right_knee",
    "right_ankle", "", "right_foot",
)  # fmt: skip
_LEG_M = (0.5, 1.2)  # thigh and shin of a person, together
_MIDDLE = 0.34  # where MMM's model has the middle of the foot between ankle and toes
_TO_OURS = [2, 0, 1]  # x front, y left, z up out of the file's x left, y up, z front
_TO_FILE = [1, 2, 0]
_MIRROR = np.array([-1.0, 1.0, 1.0])  # of the file's coordinates


def kit_to_canonical(where: Array) -> Array:
    """Positions (T, 22, 3) in metres, z up, of KIT-ML's (T, 21, 3), mirrored back where the feet say so.

    Joints that the data set lacks (spine2, collars) are put evenly along the bone that skips them. Raises ValueError
    where a leg is no person's in the data set's unit.
    """
    at = {name: row for row, name in enumerate(JOINTS) if name}
    leg = sum(
        np.linalg.norm(where[:, at[f"left_{a}"]] - where[:, at[f"left_{b}"]], axis=-1).mean() * METRES
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    )
    if not _LEG_M[0] <= leg <= _LEG_M[1]:
        raise ValueError(f"a leg of {leg:.3g} m in KIT-ML's unit, expected {_LEG_M[0]} to {_LEG_M[1]} m")
    left = where[:, at["left_hip"]] - where[:, at["right_hip"]]
    toes, ankles = (where[:, [at[f"{side}_{joint}"] for side in ("left", "right")]] for joint in ("foot", "ankle"))
    feet = (toes - ankles).sum(1)
    front = left[:, 0] * feet[:, 2] - left[:, 2] * feet[:, 0]  # left × up · feet: above 0 for a body, else its mirror's
    true = where * METRES * (_MIRROR if front.sum() < 0 else 1.0)
    return fill_joints(true[..., _TO_OURS], at)


def kit_positions(motion: Motion) -> Array:
    """Joint positions (T, 21, 3) as the data set has them: 12.5 frames a second, its unit, mirrored, y up, the lowest
    joint on the floor, from the origin, facing +z in the first frame. Raises ValueError where a joint is missing.

    Bone lengths stay the motion's own, and the middles of the feet lie on the line from ankle to toes.
    """
    rows = [motion.skeleton.index(name) for name in JOINTS if name]
    ours = (motion if motion.fps == KIT_ML.fps else motion.resampled(KIT_ML.fps)).positions()
    where = np.zeros((len(ours), len(JOINTS), 3))
    where[:, [j for j, name in enumerate(JOINTS) if name]] = ours[:, rows]
    for middle, (ankle, toes) in ((14, (13, 15)), (19, (18, 20))):
        where[:, middle] = where[:, ankle] + _MIDDLE * (where[:, toes] - where[:, ankle])
    level = facing_front(where, [(JOINTS.index(f"left_{j}"), JOINTS.index(f"right_{j}")) for j in ("hip", "shoulder")])
    return level[..., _TO_FILE] * _MIRROR / METRES
