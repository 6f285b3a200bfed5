"""The BVH reader against kinematics worked out by scipy, and against files broken in every way."""

import os
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motiongen.formats.bvh import read_bvh
from motiongen.formats.bvh_raw import BvhError, read_raw
from motiongen.motion import SMPL_JOINTS
from motiongen.skeletons import BANDAI_NAMCO

TINY = """HIERARCHY
ROOT hip
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Yrotation Xrotation Zrotation
  JOINT knee
  {
    OFFSET 0 -40 0
    CHANNELS 3 Zrotation Yrotation Xrotation
    End Site
    {
      OFFSET 0 -40 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.02
1 2 3 10 20 30 40 50 60
4 5 6 70 80 90 15 25 35
"""

# The data set's tree: name, parent, offset in centimetres; every bone along the joint's x, as in its files.
TREE = [
    ("joint_Root", "", (0, 0, 0)), ("Hips", "joint_Root", (0, 92, 0)), ("Spine", "Hips", (15.7, 0, 0)),
    ("Chest", "Spine", (9, 0, 0)), ("Neck", "Chest", (16.4, 0, 0)), ("Head", "Neck", (6.5, 0, 0)),
    ("Shoulder_L", "Chest", (13, 0, 5)), ("UpperArm_L", "Shoulder_L", (5.3, 0, 0)),
    ("LowerArm_L", "UpperArm_L", (24.3, 0, 0)), ("Hand_L", "LowerArm_L", (22.3, 0, 0)),
    ("Shoulder_R", "Chest", (13, 0, -5)), ("UpperArm_R", "Shoulder_R", (-5.3, 0, 0)),
    ("LowerArm_R", "UpperArm_R", (-24.3, 0, 0)), ("Hand_R", "LowerArm_R", (-22.3, 0, 0)),
    ("UpperLeg_L", "Hips", (-2.2, -6.5, 0)), ("LowerLeg_L", "UpperLeg_L", (39.1, 0, 0)),
    ("Foot_L", "LowerLeg_L", (41, 0, 0)), ("Toes_L", "Foot_L", (11.75, 0, 0)),
    ("UpperLeg_R", "Hips", (-2.2, 6.5, 0)), ("LowerLeg_R", "UpperLeg_R", (-39.1, 0, 0)),
    ("Foot_R", "LowerLeg_R", (-41, 0, 0)), ("Toes_R", "Foot_R", (-11.75, 0, 0)),
]  # fmt: skip


def bandai(tmp_path: Path, frames: int = 4, seed: int = 0) -> tuple[Path, np.ndarray]:
    """A file with the data set's skeleton and random rotations, and its joints' world positions (T, 22, 3) in cm."""
    rng = np.random.default_rng(seed)
    names = [n for n, _, _ in TREE]

    def node(name: str, depth: int) -> str:
        offset = next(o for n, _, o in TREE if n == name)
        pad = "\t" * depth
        inner = "".join(node(n, depth + 1) for n, p, _ in TREE if p == name)
        inner = inner or f"{pad}\tEnd Site\n{pad}\t{{\n{pad}\t\tOFFSET 0 0 0\n{pad}\t}}\n"
        kind = "JOINT" if depth else "ROOT"
        head = f"{pad}\tOFFSET {offset[0]} {offset[1]} {offset[2]}\n"
        head += f"{pad}\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
        return f"{pad}{kind} {name}\n{pad}{{\n{head}{inner}{pad}}}\n"

    order: list[str] = []

    def walk(name: str) -> None:
        order.append(name)
        for n, p, _ in TREE:
            if p == name:
                walk(n)

    walk("joint_Root")
    euler = rng.uniform(-60, 60, (frames, len(names), 3))
    world = np.zeros((frames, len(names), 3))
    rows = []
    for t in range(frames):
        turns: dict[str, Rotation] = {"": Rotation.identity()}
        places = {"": np.zeros(3)}
        values: dict[str, np.ndarray] = {}
        for i, (name, parent, offset) in enumerate(TREE):
            turns[name] = turns[parent] * Rotation.from_euler("ZXY", euler[t, i], degrees=True)
            places[name] = places[parent] + turns[parent].apply(offset)
            world[t, i] = places[name]
            values[name] = np.concatenate([offset, euler[t, i]])
        rows.append(" ".join(f"{v:.6f}" for n in order for v in values[n]))
    text = f"HIERARCHY\n{node('joint_Root', 0)}MOTION\nFrames: {frames}\nFrame Time: 0.0333333\n" + "\n".join(rows)
    path = tmp_path / "dataset-2_walk_normal_001.bvh"
    path.write_text(text + "\n")
    return path, world


def test_any_channel_order(tmp_path: Path) -> None:
    path = tmp_path / "tiny.bvh"
    path.write_text(TINY)
    raw = read_raw(path)
    hip = Rotation.from_euler("YXZ", [70, 80, 90], degrees=True).as_quat(scalar_first=True)
    knee = Rotation.from_euler("ZYX", [15, 25, 35], degrees=True).as_quat(scalar_first=True)
    assert abs(raw.quats[1, 0] @ hip) == pytest.approx(1)
    assert abs(raw.quats[1, 1] @ knee) == pytest.approx(1)
    assert raw.positions[1].tolist() == [[4, 5, 6], [0, -40, 0]]
    assert raw.fps == pytest.approx(50)


def test_positions_agree_with_the_files_own_kinematics(tmp_path: Path) -> None:
    path, world = bandai(tmp_path)
    motion = read_bvh(path)
    ours = motion.positions()
    names = [n for n, _, _ in TREE]
    for canonical, name in BANDAI_NAMCO.joints.items():
        x, y, z = world[:, names.index(name)].T / 100
        assert np.allclose(ours[:, SMPL_JOINTS.index(canonical)], np.stack([z, x, y], axis=1), atol=1e-6), canonical
    assert motion.fps == pytest.approx(30, abs=1e-3)
    assert "NC" in motion.source.licence


def test_rest_pose_is_a_t_pose(tmp_path: Path) -> None:
    path, _ = bandai(tmp_path)
    skeleton = read_bvh(path).skeleton
    rest = np.zeros((22, 3))
    for j, parent in enumerate(skeleton.parents):
        if j:
            rest[j] = rest[parent] + skeleton.offsets[j]
    at = dict(zip(SMPL_JOINTS, rest, strict=True))
    assert at["left_wrist"] - at["left_shoulder"] == pytest.approx([0, 0.466, 0], abs=1e-6)
    assert at["right_wrist"] - at["right_shoulder"] == pytest.approx([0, -0.466, 0], abs=1e-6)
    assert at["left_ankle"] - at["left_hip"] == pytest.approx([0, 0, -0.801], abs=1e-6)
    assert at["head"][2] > at["neck"][2] > at["spine3"][2] > 0
    assert at["left_foot"][0] > at["left_ankle"][0]  # toes point forward
    assert at["left_hip"][1] > 0 > at["right_hip"][1]


@pytest.mark.parametrize(
    ("broken", "said"),
    [
        (TINY.replace("HIERARCHY", "HIERACHY"), "no HIERARCHY"),
        (TINY[: TINY.index("MOTION")], "no HIERARCHY and MOTION"),
        (TINY.replace("Frames: 2", "Frames: 3"), "need 27"),
        (TINY.replace("Frames: 2", "Frames: 0"), "0 frames"),
        (TINY.replace("Frames: 2", "Frames: two"), "must be numbers"),
        (TINY.replace("Frames: 2", "Frames: 99999999999"), "99999999999 frames"),
        (TINY.replace("0.02", "0"), "frame time 0"),
        (TINY.replace("0.02", "nan"), "frame time nan"),
        (TINY.replace("0.02", "1e-320"), "inf frames a second, expected 0.1 to 10000"),
        (TINY.replace("0.02", "60"), "0.0166667 frames a second"),
        (TINY.replace("70 80", "nan 80"), "frame 1 holds NaN"),
        (TINY.replace("70 80", "seventy 80"), "seventy"),
        (TINY.replace("Zrotation Yrotation Xrotation", "Zrotation Yrotation Wrotation"), "Wrotation"),
        (TINY.replace("    }\n  }\n}\n", "    }\n  }\n"), "matching braces"),
        (TINY.replace("OFFSET 0 -40 0\n    CHANNELS", "OFFSET 0 -40\n    CHANNELS"), "malformed"),
        (TINY.replace("JOINT knee", "JOIN knee"), "'JOIN'"),
        (TINY[:-20], "need 18"),
        (TINY, "unknown skeleton"),
    ],
)
def test_broken_files_are_named(tmp_path: Path, broken: str, said: str) -> None:
    path = tmp_path / "broken.bvh"
    path.write_text(broken)
    with pytest.raises(BvhError, match=said) as error:
        read_bvh(path)
    assert "broken.bvh" in str(error.value)
    assert "\n" not in str(error.value)


def test_not_text(tmp_path: Path) -> None:
    path = tmp_path / "picture.bvh"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    with pytest.raises(BvhError, match="not text"):
        read_bvh(path)


@pytest.mark.skipif("RIGCAST_MOTION_DATA" not in os.environ, reason="RIGCAST_MOTION_DATA names no folder of clips")
def test_real_clips_stand_on_the_floor() -> None:
    files = sorted(Path(os.environ["RIGCAST_MOTION_DATA"]).rglob("dataset-2_walk_*_00[1-5].bvh"))
    for path in files:
        motion = read_bvh(path)
        toes = motion.positions()[:, [SMPL_JOINTS.index("left_foot"), SMPL_JOINTS.index("right_foot")], 2]
        assert toes.min() == pytest.approx(motion.skeleton.foot_height[1], abs=0.03), path.name


@pytest.mark.parametrize(
    ("joint", "canonical", "degrees", "axis"),
    [
        ("LowerArm_L", "left_elbow", -50, (0, 0, -1)),
        ("LowerArm_R", "right_elbow", -50, (0, 0, 1)),
        ("LowerLeg_L", "left_knee", 50, (0, 1, 0)),
        ("LowerLeg_R", "right_knee", 50, (0, 1, 0)),
    ],
)
def test_hinges_bend_as_they_do_on_people(
    tmp_path: Path, joint: str, canonical: str, degrees: float, axis: tuple[int, int, int]
) -> None:
    """The data set's elbows turn about their −y and its knees about their +y (the principal axes of its own clips).

    In a T-pose an elbow bends about the vertical and brings the hand forward; a knee, about the left axis, takes the
    shank back.
    """
    path, _ = bandai(tmp_path, frames=1)
    head, _, _ = path.read_text().partition("Frame Time: 0.0333333\n")
    names = re.findall(r"(?:ROOT|JOINT) (\w+)", head)
    offsets = {n: o for n, _, o in TREE}
    rows = [f"{' '.join(map(str, offsets[n]))} 0 0 {degrees if n == joint else 0}" for n in names]
    path.write_text(head + "Frame Time: 0.0333333\n" + " ".join(rows) + "\n")
    bent = read_bvh(path).joint_quat[0, SMPL_JOINTS.index(canonical)]
    straight_row = " ".join(f"{' '.join(map(str, offsets[n]))} 0 0 0" for n in names)
    path.write_text(head + "Frame Time: 0.0333333\n" + straight_row + "\n")
    straight = read_bvh(path).joint_quat[0, SMPL_JOINTS.index(canonical)]
    turn = Rotation.from_quat(straight, scalar_first=True).inv() * Rotation.from_quat(bent, scalar_first=True)
    assert turn.as_rotvec(degrees=True) == pytest.approx(np.array(axis) * 50, abs=1e-4)
