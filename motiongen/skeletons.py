"""Skeletons known by name: where each canonical joint is in a file, and how its local axes lie in a T-pose."""

from __future__ import annotations

from dataclasses import dataclass

from motiongen.motion import SMPL_JOINTS


@dataclass(frozen=True)
class SkeletonTable:
    """How a file's skeleton maps to the canonical one.

    `joints`: canonical name → name in the file; a canonical joint without one is put half-way along the bone that
    skips it. `axes`: name in the file → three letters for where its x, y, z point in the T-pose: F(ront), B(ack),
    L(eft), R(ight), U(p), D(own). `pitch`: radians, nose down, by which a joint's frame is turned about the left axis
    after that. `unit`: metres per unit of the file. The file's world is y up, facing z. `floor`: whether the floor of
    its clips is at height 0; where it is not, the clip's lowest foot is put on it. `own_names`: whether no other
    skeleton has these names; where others do, the limbs must lie in the file as `axes` says.
    """

    joints: dict[str, str]
    axes: dict[str, str]
    pitch: dict[str, float]
    unit: float
    licence: str
    foot_height: tuple[float, float]
    floor: bool = True
    own_names: bool = True


# Foot and toe pitch: the mean over planted, level feet of the data set itself, so that a flat sole is the identity.
_FOOT_PITCH, _TOE_PITCH = 0.693, 0.400

BANDAI_NAMCO = SkeletonTable(
    joints={
        "pelvis": "Hips", "spine1": "Spine", "spine3": "Chest", "neck": "Neck", "head": "Head",
        "left_collar": "Shoulder_L", "left_shoulder": "UpperArm_L", "left_elbow": "LowerArm_L", "left_wrist": "Hand_L",
        "right_collar": "Shoulder_R", "right_shoulder": "UpperArm_R", "right_elbow": "LowerArm_R",
        "right_wrist": "Hand_R", "left_hip": "UpperLeg_L", "left_knee": "LowerLeg_L", "left_ankle": "Foot_L",
        "left_foot": "Toes_L", "right_hip": "UpperLeg_R", "right_knee": "LowerLeg_R", "right_ankle": "Foot_R",
        "right_foot": "Toes_R",
    },
    axes={
        "Hips": "URF", "Spine": "UFL", "Chest": "UFL", "Neck": "UFL", "Head": "UFL",
        "Shoulder_L": "LUF", "UpperArm_L": "LUF", "LowerArm_L": "LUF", "Hand_L": "LUF",
        "Shoulder_R": "LDB", "UpperArm_R": "LDB", "LowerArm_R": "LDB", "Hand_R": "LDB",
        "UpperLeg_L": "DLF", "LowerLeg_L": "DLF", "Foot_L": "FLU", "Toes_L": "FLU",
        "UpperLeg_R": "ULB", "LowerLeg_R": "ULB", "Foot_R": "BLD", "Toes_R": "BLD",
    },
    pitch={"Foot_L": _FOOT_PITCH, "Foot_R": _FOOT_PITCH, "Toes_L": _TOE_PITCH, "Toes_R": _TOE_PITCH},
    unit=0.01,
    licence="CC BY-NC 4.0 (Bandai-Namco Research Motiondataset)",
    foot_height=(0.117, 0.042),
)  # fmt: skip
# What `motiongen.formats.bvh_write` writes: a T-pose whose joint frames all lie along the file's axes.
SMPL = SkeletonTable(
    joints={name: name for name in SMPL_JOINTS},
    axes=dict.fromkeys(SMPL_JOINTS, "LUF"),
    pitch={},
    unit=0.01,
    licence="",
    foot_height=(0.117, 0.042),
)
# The CMU clips on Reallusion's Character Creator skeleton. Measured on the T-pose in frame 0 of trial 07_12, which not
# every trial has: the letters, and the pitch of spine, neck and feet as the figure stands.
CMU = SkeletonTable(
    joints={
        "pelvis": "CC_Base_Hip", "spine1": "CC_Base_Waist", "spine2": "CC_Base_Spine01", "spine3": "CC_Base_Spine02",
        "neck": "CC_Base_NeckTwist01", "head": "CC_Base_Head",
        "left_collar": "CC_Base_L_Clavicle", "left_shoulder": "CC_Base_L_Upperarm", "left_elbow": "CC_Base_L_Forearm",
        "left_wrist": "CC_Base_L_Hand", "right_collar": "CC_Base_R_Clavicle", "right_shoulder": "CC_Base_R_Upperarm",
        "right_elbow": "CC_Base_R_Forearm", "right_wrist": "CC_Base_R_Hand",
        "left_hip": "CC_Base_L_Thigh", "left_knee": "CC_Base_L_Calf", "left_ankle": "CC_Base_L_Foot",
        "left_foot": "CC_Base_L_ToeBase", "right_hip": "CC_Base_R_Thigh", "right_knee": "CC_Base_R_Calf",
        "right_ankle": "CC_Base_R_Foot", "right_foot": "CC_Base_R_ToeBase",
    },
    axes={
        "CC_Base_Hip": "LUF", "CC_Base_Waist": "LUF", "CC_Base_Spine01": "LUF", "CC_Base_Spine02": "LUF",
        "CC_Base_NeckTwist01": "LUF", "CC_Base_Head": "LUF",
        "CC_Base_L_Clavicle": "DLF", "CC_Base_L_Upperarm": "DLF", "CC_Base_L_Forearm": "DLF", "CC_Base_L_Hand": "DLF",
        "CC_Base_R_Clavicle": "URF", "CC_Base_R_Upperarm": "URF", "CC_Base_R_Forearm": "URF", "CC_Base_R_Hand": "URF",
        "CC_Base_L_Thigh": "RDF", "CC_Base_L_Calf": "RDF", "CC_Base_L_Foot": "RFU", "CC_Base_L_ToeBase": "RFU",
        "CC_Base_R_Thigh": "RDF", "CC_Base_R_Calf": "RDF", "CC_Base_R_Foot": "RFU", "CC_Base_R_ToeBase": "RFU",
    },
    pitch={
        "CC_Base_Waist": 0.28, "CC_Base_Spine01": -0.09, "CC_Base_Spine02": -0.18, "CC_Base_NeckTwist01": 0.19,
        "CC_Base_L_Foot": 0.22, "CC_Base_R_Foot": 0.22, "CC_Base_L_ToeBase": -0.10, "CC_Base_R_ToeBase": -0.10,
    },
    unit=0.01,
    licence="free for research and commercial use, not to be resold as data (mocap.cs.cmu.edu, NSF EIA-0196217)",
    foot_height=(0.056, 0.033),
    floor=False,
)  # fmt: skip
# LAFAN1: every limb lies along its joints' x axis, so that its zero pose is none of a body. The letters follow from the
# offsets and from the hinges of knees and elbows; the feet were measured while the figure stands at the start of
# walk1_subject1, its toe joints on the floor.
LAFAN1 = SkeletonTable(
    joints={
        "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head",
        "left_collar": "LeftShoulder", "left_shoulder": "LeftArm", "left_elbow": "LeftForeArm",
        "left_wrist": "LeftHand", "right_collar": "RightShoulder", "right_shoulder": "RightArm",
        "right_elbow": "RightForeArm", "right_wrist": "RightHand",
        "left_hip": "LeftUpLeg", "left_knee": "LeftLeg", "left_ankle": "LeftFoot", "left_foot": "LeftToe",
        "right_hip": "RightUpLeg", "right_knee": "RightLeg", "right_ankle": "RightFoot", "right_foot": "RightToe",
    },
    axes={
        "Hips": "UFL", "Spine": "UFL", "Spine1": "UFL", "Spine2": "UFL", "Neck": "UFL", "Head": "UFL",
        "LeftShoulder": "LBU", "LeftArm": "LBU", "LeftForeArm": "LBU", "LeftHand": "LBU",
        "RightShoulder": "RBD", "RightArm": "RBD", "RightForeArm": "RBD", "RightHand": "RBD",
        "LeftUpLeg": "DFR", "LeftLeg": "DFR", "LeftFoot": "FUR", "LeftToe": "FUR",
        "RightUpLeg": "DFR", "RightLeg": "DFR", "RightFoot": "FUR", "RightToe": "FUR",
    },
    pitch={"LeftFoot": 0.43, "RightFoot": 0.43, "LeftToe": 0.055, "RightToe": 0.055},
    unit=0.01,
    licence="CC BY-NC-ND 4.0 (Ubisoft La Forge Animation Dataset)",
    foot_height=(0.072, 0.0),
    own_names=False,
)  # fmt: skip
TABLES = {"bandai-namco": BANDAI_NAMCO, "smpl": SMPL, "cmu": CMU, "lafan1": LAFAN1}
