"""AMASS files against scipy's rotations and a forward kinematics in the file's own frames."""

from __future__ import annotations

import zipfile
from pathlib import Path

import motions
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motiongen import files
from motiongen.files import FileError
from motiongen.formats.amass import WIDTHS, read_amass, write_amass
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS
from motiongen.smpl import SMPL_SKELETON


def amass(path: Path, width: int = 156, frames: int = 6, rate: str = "mocap_framerate", **changed: object) -> Path:
    """A file with random poses, laid out as the data set's."""
    rng = np.random.default_rng(width)
    arrays: dict[str, object] = {
        "poses": rng.normal(0, 0.5, (frames, width)),
        "trans": rng.normal(0, 1, (frames, 3)),
        rate: np.array(120.0),
        "betas": rng.normal(size=16),
        "gender": np.array("female"),
        **changed,
    }
    np.savez(path, **{n: a for n, a in arrays.items() if a is not None})  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("rate", ["mocap_framerate", "mocap_frame_rate"])
def test_joints_are_where_the_files_own_kinematics_puts_them(tmp_path: Path, width: int, rate: str) -> None:
    path = amass(tmp_path / "a.npz", width, rate=rate)
    motion = read_amass(path)
    with np.load(path) as file:
        poses, trans = file["poses"], file["trans"]
    rest = SMPL_SKELETON.offsets[:, [1, 2, 0]]  # x left, y up, z front: the body model's frames
    ours = motion.positions()
    for t in range(len(poses)):
        turn: list[Rotation] = []
        place: list[np.ndarray] = []
        for j, parent in enumerate(SMPL_PARENTS):
            local = Rotation.from_rotvec(poses[t, 3 * j : 3 * j + 3])
            turn.append(local if parent < 0 else turn[parent] * local)
            place.append(trans[t] if parent < 0 else place[parent] + turn[parent].apply(rest[j]))
        np.testing.assert_allclose(ours[t] - ours[0, 0], np.array(place) - trans[0], atol=1e-9)
    assert motion.fps == 120


def test_the_lowest_foot_is_on_the_floor(tmp_path: Path) -> None:
    feet = read_amass(amass(tmp_path / "a.npz")).positions()[:, [7, 10, 8, 11], 2]
    assert (feet - np.tile(SMPL_SKELETON.foot_height, 2)).min() == pytest.approx(0, abs=1e-12)


def test_a_person_who_stands_up_in_the_file_stands_up_here(tmp_path: Path) -> None:
    """In the z-up world of the data set an upright body is turned by a right angle about x, and faces -y."""
    poses = np.zeros((2, 156))
    poses[:, 0] = np.pi / 2
    motion = read_amass(amass(tmp_path / "a.npz", frames=2, poses=poses))
    at = dict(zip(SMPL_JOINTS, motion.positions()[0], strict=True))
    assert at["head"][2] > at["pelvis"][2] > at["left_ankle"][2] > 0
    assert at["left_wrist"][0] > at["right_wrist"][0]
    assert at["left_foot"][1] < at["left_ankle"][1]


def test_rotations_survive_a_round_trip(tmp_path: Path) -> None:
    walk = motions.walk(seconds=2)
    write_amass(walk, tmp_path / "w.npz")
    back = read_amass(tmp_path / "w.npz")
    sign = np.sign((back.joint_quat * walk.joint_quat).sum(-1, keepdims=True))
    np.testing.assert_allclose(back.joint_quat * sign, walk.joint_quat, atol=1e-9)
    np.testing.assert_allclose(back.root_pos[:, :2], walk.root_pos[:, :2], atol=1e-12)
    assert back.fps == walk.fps
    with np.load(tmp_path / "w.npz") as file:
        assert file["poses"].shape == (len(walk), 156)
        assert {"trans", "betas", "gender", "mocap_framerate"} <= set(file.files)


def test_objects_that_are_not_needed_do_no_harm(tmp_path: Path) -> None:
    """SMPL-X files of the data set carry an array of objects; it is never read."""
    assert len(read_amass(amass(tmp_path / "a.npz", 165, markers_latent_vids=np.array([{}], object)))) == 6


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"poses": np.zeros((6, 150))}, r"poses \(6, 150\)"),
        ({"poses": np.full((6, 156), np.nan)}, "frame 0 holds NaN"),
        ({"trans": np.zeros((5, 3))}, r"trans \(5, 3\)"),
        ({"trans": np.full((6, 3), np.inf)}, "frame 0 holds NaN"),
        ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "zero frames"),
        ({"mocap_framerate": None}, "needs poses, trans and mocap_framerate or mocap_frame_rate"),
        ({"mocap_framerate": np.array(0.0)}, "frames a second, expected 0.1 to 10000"),
        ({"mocap_framerate": np.array("fast")}, "must be numbers"),
        ({"poses": np.array([{}], object)}, "holding objects"),
    ],
)
def test_bad_files_are_one_line(tmp_path: Path, changed: dict[str, object], said: str) -> None:
    with pytest.raises(FileError, match=said) as caught:
        read_amass(amass(tmp_path / "bad.npz", **changed))  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "bad.npz"))


def test_a_zip_bomb_is_refused_unopened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "MAX_BYTES", 1 << 20)
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("poses.npy", bytes(2 << 20))
    assert (tmp_path / "bomb.npz").stat().st_size < 1 << 13
    with pytest.raises(FileError, match="bytes unpacked"):
        read_amass(tmp_path / "bomb.npz")


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    whole = amass(tmp_path / "a.npz").read_bytes()
    for end in range(0, len(whole), len(whole) // 11):
        (tmp_path / "cut.npz").write_bytes(whole[:end])
        with pytest.raises(FileError, match="damaged"):
            read_amass(tmp_path / "cut.npz")
