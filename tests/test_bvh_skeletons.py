"""BVH files with other people's skeletons: joints found by name, rest poses, round trips, an independent reader."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import motions
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motiongen.formats.bvh import canonical, forward, read_bvh
from motiongen.formats.bvh_raw import BvhError, RawBvh, read_raw
from motiongen.formats.bvh_write import write_bvh
from motiongen.formats.joint_names import match_joints
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion
from motiongen.rotation import axis_angle_to_quat, quat_conj, quat_mul, quat_rotate, quat_to_rotvec, rotvec_to_quat

CLIPS = Path(os.environ.get("RIGCAST_MOTION_DATA", ""))
real = pytest.mark.skipif(
    "RIGCAST_MOTION_DATA" not in os.environ, reason="RIGCAST_MOTION_DATA names no folder of clips"
)

# Names in the order of SMPL_JOINTS.
MIXAMO = [
    "Hips", "LeftUpLeg", "RightUpLeg", "Spine", "LeftLeg", "RightLeg", "Spine1", "LeftFoot", "RightFoot",
    "Spine2", "LeftToeBase", "RightToeBase", "Neck", "LeftShoulder", "RightShoulder", "Head", "LeftArm",
    "RightArm", "LeftForeArm", "RightForeArm", "LeftHand", "RightHand",
]  # fmt: skip
UNREAL = [
    "pelvis", "thigh_l", "thigh_r", "spine_01", "calf_l", "calf_r", "spine_02", "foot_l", "foot_r",
    "spine_03", "ball_l", "ball_r", "neck_01", "clavicle_l", "clavicle_r", "head", "upperarm_l", "upperarm_r",
    "lowerarm_l", "lowerarm_r", "hand_l", "hand_r",
]  # fmt: skip
BIPED = [
    "Bip01 Pelvis", "Bip01 L Thigh", "Bip01 R Thigh", "Bip01 Spine", "Bip01 L Calf", "Bip01 R Calf",
    "Bip01 Spine1", "Bip01 L Foot", "Bip01 R Foot", "Bip01 Spine2", "Bip01 L Toe0", "Bip01 R Toe0",
    "Bip01 Neck", "Bip01 L Clavicle", "Bip01 R Clavicle", "Bip01 Head", "Bip01 L UpperArm",
    "Bip01 R UpperArm", "Bip01 L Forearm", "Bip01 R Forearm", "Bip01 L Hand", "Bip01 R Hand",
]  # fmt: skip
SOMA = [
    "Hips", "LeftLeg", "RightLeg", "Spine1", "LeftShin", "RightShin", "Spine2", "LeftFoot", "RightFoot",
    "Chest", "LeftToeBase", "RightToeBase", "Neck1", "LeftShoulder", "RightShoulder", "Head", "LeftArm",
    "RightArm", "LeftForeArm", "RightForeArm", "LeftHand", "RightHand",
]  # fmt: skip
STYLES = {
    "mixamo": [f"mixamorig:{n}" for n in MIXAMO],
    "mixamo, no colon": [f"mixamorig{n}" for n in MIXAMO],
    "lafan1": [n.replace("ToeBase", "Toe") for n in MIXAMO],
    "unreal": UNREAL,
    "upper case": [n.upper() for n in UNREAL],
    "biped": BIPED,
    "soma": SOMA,
    "ours": list(SMPL_JOINTS),
}


def written(tmp_path: Path, motion: Motion, names: list[str]) -> RawBvh:
    """What a file of `motion` with these names holds."""
    write_bvh(motion, tmp_path / "m.bvh")
    raw = read_raw(tmp_path / "m.bvh")
    return replace(raw, names=tuple(names[SMPL_JOINTS.index(n)] for n in raw.names))


def lifted(a: Motion, b: Motion) -> np.ndarray:
    """Positions of `a` less those of `b`, less what may differ: the height of the whole clip."""
    apart = a.positions() - b.positions()
    return apart - apart[:1, :1] * [0, 0, 1]


def tilt(a: Motion, b: Motion) -> np.ndarray:
    """Angle (T, J) in radians between world orientations."""
    return np.linalg.norm(quat_to_rotvec(quat_mul(quat_conj(a.global_quat()), b.global_quat())), axis=-1)


@pytest.mark.parametrize("style", STYLES)
def test_names_are_told_whatever_the_style(style: str) -> None:
    names = STYLES[style]
    raw = motions.skeleton()
    found, missing = match_joints(names, raw.parents)
    assert missing == ()
    assert [found[joint] for joint in SMPL_JOINTS] == names


def test_what_found_no_match_is_listed(tmp_path: Path) -> None:
    raw = written(tmp_path, motions.stand(), [f"bone{j}" if 18 <= j <= 19 else n for j, n in enumerate(MIXAMO)])
    with pytest.raises(
        ValueError, match=r"no joint by name for left_elbow, right_elbow among Hips, .*bone18"
    ) as caught:
        canonical(raw, "x")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("style", ["mixamo", "unreal", "soma"])
def test_a_t_pose_file_with_other_names_is_the_same_motion(tmp_path: Path, style: str) -> None:
    walk = motions.walk(seconds=2)
    got = canonical(written(tmp_path, walk, STYLES[style]), "x")
    assert np.abs(lifted(got, walk)).max() < 1e-5
    assert tilt(got, walk).max() < 1e-5
    assert "centimetres" in got.source.generator


def test_a_file_in_metres_with_z_up(tmp_path: Path) -> None:
    walk = motions.walk(seconds=2)
    raw = written(tmp_path, walk, MIXAMO)
    turn = axis_angle_to_quat([1.0, 0.0, 0.0], np.pi / 2)  # y up to z up
    quats = raw.quats.copy()
    quats = quat_mul(quat_mul(turn, quats), quat_conj(turn))
    z_up = replace(
        raw, offsets=quat_rotate(turn, raw.offsets) / 100, positions=quat_rotate(turn, raw.positions) / 100, quats=quats
    )
    got = canonical(z_up, "x")
    height = got.positions()[0, SMPL_JOINTS.index("head"), 2] - got.positions()[0, 7, 2]
    want = walk.positions()[0, SMPL_JOINTS.index("head"), 2] - walk.positions()[0, 7, 2]
    assert height == pytest.approx(want, abs=1e-5)
    assert "metres" in got.source.generator


def test_an_a_pose_is_straightened(tmp_path: Path) -> None:
    """Offsets drawn with the arms 45° down: the joints stay where they are, and level arms are the identity again."""
    wave = motions.wave()
    raw = written(tmp_path, wave, MIXAMO)
    offsets, positions, quats = raw.offsets.copy(), raw.positions.copy(), raw.quats.copy()
    for side, sign in (("Left", -1), ("Right", 1)):
        down = axis_angle_to_quat([0.0, 0.0, 1.0], sign * np.pi / 4)  # about the file's front
        arm, fore, hand = (raw.names.index(f"{side}{part}") for part in ("Arm", "ForeArm", "Hand"))
        for j in (fore, hand):
            offsets[j] = quat_rotate(down, offsets[j])
            positions[:, j] = quat_rotate(down, positions[:, j])
        quats[:, arm] = quat_mul(quats[:, arm], quat_conj(down))
        for j in (fore, hand):
            quats[:, j] = quat_mul(quat_mul(down, quats[:, j]), quat_conj(down))
    got = canonical(replace(raw, offsets=offsets, positions=positions, quats=quats), "x")
    assert np.abs(lifted(got, wave)).max() < 1e-5
    arms = [j for j, n in enumerate(SMPL_JOINTS) if n.endswith(("shoulder", "elbow"))]
    assert tilt(got, wave)[:, arms].max() < 1e-5


def test_a_zero_pose_that_says_nothing_still_gives_the_positions(tmp_path: Path) -> None:
    """Joint frames turned at random, as LAFAN1's zero pose looks: no T-pose anywhere, and the figure is the same."""
    walk = motions.walk(seconds=2)
    raw = written(tmp_path, walk, STYLES["lafan1"])
    rng = np.random.default_rng(1)
    turns = rotvec_to_quat(rng.normal(0, 2, (len(raw.names), 3)))
    quats, positions, offsets = raw.quats.copy(), raw.positions.copy(), raw.offsets.copy()
    for j, parent in enumerate(raw.parents):
        before = turns[parent] if parent >= 0 else np.array([1.0, 0, 0, 0])
        quats[:, j] = quat_mul(quat_mul(quat_conj(before), raw.quats[:, j]), turns[j])
        if parent >= 0:
            offsets[j] = quat_rotate(quat_conj(before), raw.offsets[j])
            positions[:, j] = quat_rotate(quat_conj(before), raw.positions[:, j])
    got = canonical(replace(raw, quats=quats, positions=positions, offsets=offsets), "x")
    assert np.abs(lifted(got, walk)).max() < 1e-5
    assert "rotations fitted" in got.source.generator


# LAFAN1's offsets in centimetres, as its clips of subject 1 have them, and the walk's T-pose in its joint frames.
LAFAN1_OFFSETS = {
    "LeftUpLeg": (0.1, 1.86, 10.55), "LeftLeg": (43.5, 0, 0), "LeftFoot": (42.37, 0, 0), "LeftToe": (17.3, 0, 0),
    "Spine": (6.9, -2.6, 0), "Spine1": (12.59, 0, 0), "Spine2": (12.34, 0, 0), "Neck": (25.83, 0, 0),
    "Head": (11.77, 0, 0), "LeftShoulder": (19.75, -1.48, 6.0), "LeftArm": (11.28, 0, 0), "LeftForeArm": (33.0, 0, 0),
    "LeftHand": (25.2, 0, 0),
}  # fmt: skip


def lafan1(degrees: dict[str, tuple[float, float, float]]) -> RawBvh:
    """One frame of LAFAN1's skeleton, Z Y X rotations by joint, laid out as its files are."""
    names = tuple(STYLES["lafan1"])
    offsets = np.zeros((len(names), 3))
    for j, name in enumerate(names):
        if name != "Hips":
            offsets[j] = LAFAN1_OFFSETS[name.replace("Right", "Left")]
            offsets[j, 2] *= -1 if name.startswith("Right") else 1
    quats = np.zeros((1, len(names), 4))
    quats[..., 0] = 1
    for name, angles in degrees.items():
        x, y, z, w = Rotation.from_euler("ZYX", angles, degrees=True).as_quat()
        quats[0, names.index(name)] = w, x, y, z
    positions = offsets[None].copy()
    positions[0, 0] = (0, 91.9, 0)
    return RawBvh(names, SMPL_PARENTS, offsets, positions, quats, 30.0)


# The figure upright, facing z, arms level: legs turned round, toes bent, collars out to the sides.
LAFAN1_T = {
    "Hips": (90, 0, 90), "LeftUpLeg": (180, 0, 180), "RightUpLeg": (180, 0, 180),
    "LeftFoot": (65.4, 0, 0), "RightFoot": (65.4, 0, 0), "LeftToe": (21.45, 0, 0), "RightToe": (21.45, 0, 0),
    "LeftShoulder": (180, -90, 0), "RightShoulder": (180, 90, 0),
}  # fmt: skip


def test_lafan1_has_its_own_t_pose() -> None:
    motion = canonical(lafan1(LAFAN1_T), "x")
    turned = np.degrees(np.linalg.norm(quat_to_rotvec(motion.global_quat()[0]), axis=-1))
    assert turned.max() < 1
    at = dict(zip(SMPL_JOINTS, motion.positions()[0] * 100, strict=True))
    assert at["left_wrist"] - at["left_shoulder"] == pytest.approx([0, 58.2, 0], abs=0.01)
    assert at["right_hip"] - at["pelvis"] == pytest.approx([1.86, -10.55, 0.1], abs=0.01)
    assert "Ubisoft" in motion.source.licence


@pytest.mark.parametrize(
    ("joint", "turn", "canonical_turn"),
    [
        ("LeftLeg", (-40, 0, 0), ("left_knee", [0, 40, 0])),  # in the clips knees bend about -z only
        ("RightForeArm", (-40, 0, 0), ("right_elbow", [0, 0, 40])),  # and elbows about -z: forward
        ("LeftForeArm", (-40, 0, 0), ("left_elbow", [0, 0, -40])),
    ],
)
def test_lafan1_hinges(joint: str, turn: tuple[float, float, float], canonical_turn: tuple[str, list[float]]) -> None:
    motion = canonical(lafan1(LAFAN1_T | {joint: turn}), "x")
    name, want = canonical_turn
    got = np.degrees(quat_to_rotvec(motion.joint_quat[0, SMPL_JOINTS.index(name)]))
    np.testing.assert_allclose(got, want, atol=0.1)


def test_lafan1s_names_on_other_bones_are_another_skeleton(tmp_path: Path) -> None:
    walk = motions.walk(seconds=1)
    got = canonical(written(tmp_path, walk, STYLES["lafan1"]), "x")
    assert tilt(got, walk).max() < 1e-5
    assert "by name" in got.source.generator


def test_soma_files_with_a_root_above_the_hips_and_no_end_sites(tmp_path: Path) -> None:
    """As Kimodo writes them: ROOT Root with channels of its own, Hips with six, Z Y X, no End Site."""
    walk = motions.walk(seconds=1)
    raw = written(tmp_path, walk, SOMA)
    lines = ["HIERARCHY", "ROOT Root", "{", "OFFSET 0 0 0"]
    place, turn = "Xposition Yposition Zposition", "Zrotation Yrotation Xrotation"
    lines.append(f"CHANNELS 6 {place} {turn}")
    order: list[int] = []

    def write(joint: int) -> None:
        order.append(joint)
        offset = " ".join(f"{v:.6f}" for v in (raw.offsets[joint] if joint else (0, 100, 0)))
        channels = f"CHANNELS 3 {turn}" if joint else f"CHANNELS 6 {place} {turn}"
        lines.extend([f"JOINT {raw.names[joint]}", "{", f"OFFSET {offset}", channels])
        for child in [j for j, parent in enumerate(raw.parents) if parent == joint]:
            write(child)
        lines.append("}")

    write(0)
    lines += ["}", "MOTION", f"Frames: {len(walk)}", f"Frame Time: {1 / walk.fps}"]
    angles = Rotation.from_quat(raw.quats[..., [1, 2, 3, 0]].reshape(-1, 4)).as_euler("ZYX", degrees=True)
    angles = angles.reshape(len(walk), len(raw.names), 3)
    for t in range(len(walk)):
        row = [0.0] * 6 + [*raw.positions[t, 0]] + [a for j in order for a in angles[t, j]]
        lines.append(" ".join(f"{v:.6f}" for v in row))
    (tmp_path / "soma.bvh").write_text("\n".join(lines) + "\n")
    got = read_bvh(tmp_path / "soma.bvh")
    assert np.abs(lifted(got, walk)).max() < 1e-5
    assert tilt(got, walk).max() < 1e-5


def test_a_figure_of_no_size_is_refused(tmp_path: Path) -> None:
    raw = written(tmp_path, motions.stand(), MIXAMO)
    with pytest.raises(ValueError, match="no person's in metres, inches, centimetres, millimetres"):
        canonical(replace(raw, offsets=raw.offsets * 50, positions=raw.positions * 50), "x")


def test_a_shorter_spine_is_shared_out() -> None:
    keep = [j for j, n in enumerate(SMPL_JOINTS) if n not in ("spine1", "spine2")]
    names = [MIXAMO[j] for j in keep]
    parents = [-1 if j == 0 else keep.index(max(p for p in keep if p in _above(j))) for j in keep]
    found, missing = match_joints(names, parents)
    assert missing == ()
    assert found["spine3"] == "Spine2"
    assert not {"spine1", "spine2"} & set(found)


def _above(joint: int) -> list[int]:
    parents, out = motions.skeleton().parents, []
    while joint:
        joint = parents[joint]
        out.append(joint)
    return out


# ---- Real clips


def clips(count: int) -> list[Path]:
    """Evenly spread over both data sets."""
    found = sorted(CLIPS.rglob("dataset-*.bvh")), sorted(CLIPS.glob("All_BVH/**/*.bvh"))
    return [f for files in found if files for f in files[:: max(1, len(files) // count)]]


@real
def test_bvh_to_motion_and_back_again(tmp_path: Path) -> None:
    for path in clips(6):
        motion = read_bvh(path)
        write_bvh(motion, tmp_path / "m.bvh")
        again = read_bvh(tmp_path / "m.bvh")
        assert np.abs(again.positions() - motion.positions()).max() < 1e-4, path.name


@real
def test_every_cmu_joint_but_the_head_is_where_the_file_has_it() -> None:
    from motiongen.skeletons import CMU

    for path in sorted(CLIPS.glob("All_BVH/**/*.bvh"))[::20]:
        motion, raw = read_bvh(path), read_raw(path)
        _, where = forward(raw)
        for joint, name in CMU.joints.items():
            there = where[:, raw.names.index(name)][:, [2, 0, 1]] / 100
            apart = motion.positions()[:, SMPL_JOINTS.index(joint)] - there
            apart -= apart.mean(0)
            # Two joints of the neck become one, so the head rides on a mean bone.
            assert np.abs(apart).max() < (0.05 if joint == "head" else 1e-4), (path.name, joint)


@real
def test_the_cmu_t_pose_is_a_t_pose() -> None:
    for path in CLIPS.glob("All_BVH/**/007_12.bvh"):
        at = dict(zip(SMPL_JOINTS, read_bvh(path).positions()[0], strict=True))
        reach = at["left_wrist"] - at["left_shoulder"]
        assert reach / np.linalg.norm(reach) == pytest.approx([0, 1, 0], abs=0.05)
        turned = np.linalg.norm(quat_to_rotvec(read_bvh(path).global_quat()[0]), axis=-1)
        assert np.degrees(turned).max() < 20  # collars sweep back by 15°


def test_an_independent_reader_agrees_on_our_files(tmp_path: Path) -> None:
    bvhio = pytest.importorskip("bvhio", reason="bvhio (extra dev) is not installed")  # warns of its own when imported
    motion = motions.walk()
    write_bvh(motion, tmp_path / "m.bvh")
    root = bvhio.readAsHierarchy(str(tmp_path / "m.bvh"))
    for frame in (0, len(motion) // 2, len(motion) - 1):
        root.loadPose(frame)
        for joint, _, _ in root.layout():
            x, y, z = joint.PositionWorld
            want = motion.positions()[frame, SMPL_JOINTS.index(joint.Name)]
            np.testing.assert_allclose(np.array([z, x, y]) / 100, want, atol=1e-3)


def test_an_unknown_file_is_one_line(tmp_path: Path) -> None:
    write_bvh(motions.stand(), tmp_path / "m.bvh")
    text = (tmp_path / "m.bvh").read_text()
    (tmp_path / "m.bvh").write_text(text.replace("left_knee", "gizmo").replace("left_ankle", "widget"))
    with pytest.raises(BvhError, match="no joint by name for left_knee, left_foot among pelvis") as caught:
        read_bvh(tmp_path / "m.bvh")
    assert "\n" not in str(caught.value)
