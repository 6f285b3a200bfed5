"""Robot CSV files: columns as each style has them, read by hand; and one clear line for every bad file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from motiongen.files import FileError
from motiongen.motion import Source
from motiongen.rotation import rotvec_to_quat
from retarget.files import CSV_ROOT
from retarget.robot_csv import STYLES, Style, read_robot_csv, write_robot_csv
from retarget.trajectory import Trajectory

JOINTS = ("neck", "tail")
ROW = [0.1, 0.2, 0.9]  # root position; then the quaternion of a quarter turn about z, and two joints
HALF = float(np.sqrt(0.5))


def a_trajectory(fps: float = 30.0, frames: int = 31) -> Trajectory:
    t = np.arange(frames) / fps
    quat = rotvec_to_quat(np.stack([0.2 * t, 0.1 * t, t], axis=1))
    qpos = np.column_stack([t, 0 * t, 0.5 + 0 * t, quat, 0.3 * t, -0.2 * t])
    return Trajectory(qpos, fps, "toy", JOINTS, source=Source("x"))


@pytest.mark.parametrize(
    ("style", "row", "fps"),
    [
        ("unitree", [*ROW, 0, 0, HALF, HALF, 0.5, -0.5], 30),
        ("gmr", [*ROW, 0, 0, HALF, HALF, 0.5, -0.5], 60),
        ("kimodo", [*ROW, HALF, 0, 0, HALF, 0.5, -0.5], 30),
    ],
)
def test_each_style_has_its_own_quaternion_order(tmp_path: Path, style: Style, row: list[float], fps: float) -> None:
    path = tmp_path / "clip.csv"
    path.write_text("\n".join(",".join(map(str, row)) for _ in range(3)) + "\n")
    got = read_robot_csv(path, style, "toy", JOINTS, 60 if style == "gmr" else None)
    np.testing.assert_allclose(got.qpos, [[*ROW, HALF, 0, 0, HALF, 0.5, -0.5]] * 3)
    assert (got.fps, got.joints, got.rig) == (fps, JOINTS, "toy")
    write_robot_csv(got, tmp_path / "back.csv", style)
    np.testing.assert_allclose(np.loadtxt(tmp_path / "back.csv", delimiter=","), [row] * 3, atol=1e-9)


@pytest.mark.parametrize("style", STYLES)
def test_round_trip(tmp_path: Path, style: Style) -> None:
    want = a_trajectory()
    write_robot_csv(want, tmp_path / "t.csv", style)
    back = read_robot_csv(tmp_path / "t.csv", style, "toy", JOINTS, 30 if style == "gmr" else None)
    np.testing.assert_allclose(back.qpos, want.qpos, atol=1e-8)
    assert back.fps == pytest.approx(30, abs=1e-4)


def test_a_style_with_a_rate_is_resampled_to_it(tmp_path: Path) -> None:
    write_robot_csv(a_trajectory(fps=50.0, frames=51), tmp_path / "t.csv", "unitree")
    back = read_robot_csv(tmp_path / "t.csv", "unitree", "toy", JOINTS, None)
    np.testing.assert_allclose(back.qpos, a_trajectory(30.0, 31).qpos, atol=1e-6)


def test_columns_with_names_are_put_in_the_rigs_order(tmp_path: Path) -> None:
    write_robot_csv(a_trajectory(), tmp_path / "t.csv", "ours")
    back = read_robot_csv(tmp_path / "t.csv", "ours", "toy", ("tail", "neck"), None)
    np.testing.assert_allclose(back.joint_pos, a_trajectory().joint_pos[:, ::-1], atol=1e-8)


GOOD = ",".join(map(str, [*ROW, 0, 0, HALF, HALF, 0.5, -0.5]))


@pytest.mark.parametrize(
    ("content", "style", "fps", "said"),
    [
        (GOOD, "gmr", None, "give --fps"),
        (GOOD, "unitree", 0.0, "frames a second, expected 0.1 to 10000"),
        (GOOD, "ours", None, "no header .* name the file's --style: ours, unitree, kimodo, gmr"),
        (f"{GOOD}\n{GOOD},1", "unitree", None, "line 2 has 10 columns, expected 9"),
        (GOOD.replace("0.5", "half", 1), "unitree", None, "line 1: could not convert"),
        (GOOD.replace("0.5", "nan", 1), "unitree", None, "line 1 holds NaN"),
        (GOOD.replace("0.5", "1e999", 1), "unitree", None, "line 1 holds NaN, infinity or"),
        (GOOD.replace("0.707", "0.9"), "unitree", None, "frame 0 is not of unit length"),
        ("", "unitree", None, "line 1 has 1 columns"),
        ("", "ours", None, "no header"),
        (",".join([*CSV_ROOT, "neck_rad", "ear_rad"]), "ours", None, "not those of toy: ear, tail; name the --rig"),
        (",".join([*CSV_ROOT, "neck_rad", "tail_rad"]), "ours", None, "no rows"),
        (",".join([*CSV_ROOT, "neck_rad", "neck_rad"]), "ours", None, "not those of toy"),
        (",".join([*CSV_ROOT, "neck_rad", "tail_rad"]) + f"\n0,{GOOD}", "ours", None, "two or more frames"),
        (",".join([*CSV_ROOT, "neck_rad", "tail_rad"]) + f"\n0,{GOOD}", "ours", 30.0, "leave --fps out"),
        ("\x00\x01", "kimodo", None, "line 1"),
    ],
)
def test_bad_files_are_one_line(tmp_path: Path, content: str, style: Style, fps: float | None, said: str) -> None:
    (tmp_path / "bad.csv").write_text(content)
    with pytest.raises(FileError, match=said) as caught:
        read_robot_csv(tmp_path / "bad.csv", style, "toy", JOINTS, fps)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "bad.csv"))


def test_not_text_and_not_there(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileError, match="not text"):
        read_robot_csv(tmp_path / "bad.csv", "kimodo", "toy", JOINTS, None)
    with pytest.raises(FileNotFoundError):
        read_robot_csv(tmp_path / "none.csv", "kimodo", "toy", JOINTS, None)
