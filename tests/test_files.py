"""Motion and trajectory files: exact round trips, and one clear line for every bad file."""

from __future__ import annotations

import csv
import stat
from pathlib import Path

import numpy as np
import pytest
from motions import a_motion

from motiongen.files import FileError, load_motion, replacing, require_timing, save_motion
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Source
from retarget.files import load_trajectory, save_trajectory, write_csv
from retarget.trajectory import Trajectory

CSV_ROOT = ["time_s", "root_x_m", "root_y_m", "root_z_m", "root_qw", "root_qx", "root_qy", "root_qz"]


def a_trajectory(frames: int = 5) -> Trajectory:
    rng = np.random.default_rng(4)
    qpos = rng.normal(size=(frames, 9))
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    contacts = {"left": np.arange(frames) % 2 == 0, "right": np.ones(frames, bool)}
    return Trajectory(qpos, 50.0, "toy", ("neck", "tail"), contacts, (Label(0, 1, "nod"),), Source("file x.bvh"))


@pytest.mark.parametrize("contacts", [True, False])
def test_a_motion_survives_its_file(tmp_path: Path, contacts: bool) -> None:
    motion = a_motion(contacts=contacts)
    save_motion(motion, tmp_path / "m.npz")
    back = load_motion(tmp_path / "m.npz")
    np.testing.assert_array_equal(back.root_pos, motion.root_pos)
    np.testing.assert_allclose(back.joint_quat, motion.joint_quat, atol=1e-15)
    np.testing.assert_array_equal(back.skeleton.offsets, motion.skeleton.offsets)
    assert (back.skeleton.names, back.skeleton.parents) == (SMPL_JOINTS, SMPL_PARENTS)
    assert (back.fps, back.labels, back.source) == (motion.fps, motion.labels, motion.source)
    assert back.skeleton.foot_height == (0.11, 0.04)
    if motion.contacts is None:
        assert back.contacts is None
    else:
        np.testing.assert_array_equal(back.contacts, motion.contacts)


def test_a_trajectory_survives_its_file(tmp_path: Path) -> None:
    trajectory = a_trajectory()
    save_trajectory(trajectory, tmp_path / "t.npz")
    back = load_trajectory(tmp_path / "t.npz")
    np.testing.assert_array_equal(back.qpos, trajectory.qpos)
    assert (back.fps, back.rig, back.joints) == (50.0, "toy", ("neck", "tail"))
    assert (back.labels, back.source) == (trajectory.labels, trajectory.source)
    assert back.contacts.keys() == {"left", "right"}
    np.testing.assert_array_equal(back.contacts["left"], trajectory.contacts["left"])


def test_the_same_content_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        save_trajectory(a_trajectory(), tmp_path / name)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_csv_names_units_and_holds_every_number(tmp_path: Path) -> None:
    trajectory = a_trajectory()
    write_csv(trajectory, tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == [*CSV_ROOT, "neck_rad", "tail_rad"]
    table = np.array(rows[1:], float)
    np.testing.assert_allclose(table[:, 0], [0, 0.02, 0.04, 0.06, 0.08])
    np.testing.assert_allclose(table[:, 1:], trajectory.qpos, rtol=1e-8)


# ---- Bad files


def damaged(path: Path, **changed: object) -> Path:
    """The file at `path` with some of its arrays changed, None taking one away."""
    with np.load(path) as archive:
        arrays = {**{n: archive[n] for n in archive.files}, **changed}
    np.savez(path, **{n: a for n, a in arrays.items() if a is not None})
    return path


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"root_pos": np.full((7, 3), np.nan)}, "frame 0 holds NaN"),
        ({"root_pos": np.full((7, 3), np.inf, "f2")}, "frame 0 holds NaN"),
        ({"root_pos": np.full((7, 3), 1j)}, "complex128 (7, 3) where rows of numbers are expected"),
        ({"root_pos": np.zeros((0, 3)), "joint_quat": np.zeros((0, 22, 4)), "contacts": None}, "zero frames"),
        ({"fps": 0.0}, "frames a second, expected 0.1 to 10000"),
        ({"fps": None}, "'fps' is missing"),
        ({"notes": "{"}, "Expecting property name"),
        ({"notes": '{"labels": [], "source": {"generator": "x", "spare": 1}}'}, "spare"),
        ({"version": 2}, "version 2, this rigcast reads version 1"),
        ({"version": None}, "not written by rigcast"),
        ({"kind": "trajectory"}, "holds a trajectory, expected a motion"),
        ({"joint_quat": np.zeros((7, 22, 4))}, "length 0, not 1"),
        ({"names": np.array("pelvis")}, "m.npz: "),
        ({"notes": "[" * 5000}, "nested too deeply"),
    ],
)
def test_a_bad_motion_file_is_one_line(tmp_path: Path, changed: dict[str, object], words: str) -> None:
    save_motion(a_motion(), tmp_path / "m.npz")
    with pytest.raises(FileError) as caught:
        load_motion(damaged(tmp_path / "m.npz", **changed))
    message = str(caught.value)
    assert words in message
    assert message.startswith(str(tmp_path / "m.npz"))
    assert "\n" not in message


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"qpos": np.full((5, 9), np.inf)}, "frame 0 is not finite"),
        ({"qpos": np.zeros((0, 9)), "contact:left": None, "contact:right": None}, "zero frames"),
        ({"fps": -1.0}, "frames a second, expected 0.1 to 10000"),
        ({"joints": np.array(["neck"])}, "does not fit"),
        ({"contact:left": np.ones(3, bool)}, "differ in length"),
        ({"rig": None}, "'rig' is missing"),
    ],
)
def test_a_bad_trajectory_file_is_one_line(tmp_path: Path, changed: dict[str, object], words: str) -> None:
    save_trajectory(a_trajectory(), tmp_path / "t.npz")
    with pytest.raises(FileError) as caught:
        load_trajectory(damaged(tmp_path / "t.npz", **changed))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_truncated_file_is_refused_wherever_it_ends(tmp_path: Path) -> None:
    save_motion(a_motion(), tmp_path / "m.npz")
    whole = (tmp_path / "m.npz").read_bytes()
    for end in range(0, len(whole), len(whole) // 23):
        (tmp_path / "cut.npz").write_bytes(whole[:end])
        with pytest.raises(FileError, match="damaged"):
            load_motion(tmp_path / "cut.npz")


def test_a_flipped_byte_is_refused_or_changes_nothing(tmp_path: Path) -> None:
    motion = a_motion()
    save_motion(motion, tmp_path / "m.npz")
    whole = (tmp_path / "m.npz").read_bytes()
    for at in range(0, len(whole), 37):
        (tmp_path / "bad.npz").write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
        try:
            back = load_motion(tmp_path / "bad.npz")
        except FileError:
            continue
        np.testing.assert_array_equal(back.root_pos, motion.root_pos)


@pytest.mark.parametrize("content", [b"", b"PK", b"HIERARCHY", bytes(range(256))])
def test_a_foreign_file_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "f.npz").write_bytes(content)
    with pytest.raises(FileError, match="damaged"):
        load_motion(tmp_path / "f.npz")


def test_pickles_and_bare_arrays_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "p.npz", kind="motion", version=1, evil=np.array([{}], object))
    np.save(tmp_path / "bare.npy", np.zeros(3))
    np.savez(tmp_path / "amass.npz", poses=np.zeros((3, 156)))
    with pytest.raises(FileError, match="damaged"):
        load_motion(tmp_path / "p.npz")
    with pytest.raises(FileError, match=r"bare \.npy"):
        load_motion(tmp_path / "bare.npy")
    with pytest.raises(FileError, match=r"not written by rigcast .*poses"):
        load_motion(tmp_path / "amass.npz")


def test_a_clip_may_last_four_hours() -> None:
    require_timing(4 * 3600 * 50, 50.0)
    with pytest.raises(ValueError, match="720001 frames at 50 a second last over 4 hours"):
        require_timing(4 * 3600 * 50 + 1, 50.0)
    for fps in (0.09, 10_001.0, float("nan"), -30.0):
        with pytest.raises(ValueError, match="frames a second, expected"):
            require_timing(1, fps)


def test_a_missing_file_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        load_motion(tmp_path / "none.npz")


# ---- Writing under a temporary name


def test_what_fails_half_way_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")

    def fail_half_way() -> None:
        with replacing(tmp_path / "a.txt") as temporary:
            temporary.write_text("half")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail_half_way()
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_what_goes_well_replaces_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    with replacing(tmp_path / "a.txt") as temporary:
        assert temporary.suffix == ".txt"
        temporary.write_text("new")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "new"
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) & 0o444 == 0o444


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"no such folder.*nowhere"):
        save_trajectory(a_trajectory(), tmp_path / "nowhere" / "t.npz")
