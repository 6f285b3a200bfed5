"""Which reader a file gets, which writer a suffix gets, and that no garbage gets through any of them."""

from __future__ import annotations

from pathlib import Path

import motions
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motiongen.amass import write_amass
from motiongen.bvh_write import write_bvh
from motiongen.files import save_motion
from motiongen.humanml_files import humanml_positions, write_humanml
from motiongen.motion import Motion
from retarget.rig import load_rig
from retarget.robot_csv import write_robot_csv
from retarget.trajectory import Trajectory
from rigcast.__main__ import main
from rigcast.outputs import WRITERS, suffix_of
from rigcast.pipeline import READABLE, read


def puppet_pose() -> Trajectory:
    """The rig `puppet` with every joint at zero for a second, at 30 frames a second."""
    joints = load_rig("puppet").joint_names()
    qpos = np.zeros((31, 7 + len(joints)))
    qpos[:, 2], qpos[:, 3] = 0.3, 1.0
    return Trajectory(qpos, 30.0, "puppet", joints)


def one_of_each(folder: Path) -> dict[str, Path]:
    """A small good file of every format."""
    clip = motions.stand(seconds=1)
    save_motion(clip, folder / "ours.npz")
    write_bvh(clip, folder / "clip.bvh")
    write_amass(clip, folder / "amass.npz")
    write_humanml(clip, folder / "features.npy")
    np.save(folder / "joints.npy", humanml_positions(clip))
    for style in ("ours", "unitree"):
        write_robot_csv(puppet_pose(), folder / f"{style}.csv", style)  # type: ignore[arg-type]
    return {path.name: path for path in folder.iterdir()}


def test_every_format_finds_its_reader(tmp_path: Path) -> None:
    for name, path in one_of_each(tmp_path).items():
        what = read(path, "puppet", "unitree" if name == "unitree.csv" else "ours")
        assert isinstance(what, Trajectory if path.suffix == ".csv" else Motion), name
        assert what.duration == pytest.approx(1, abs=0.06), name


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("unitree.csv", [], "name the file's --style: ours, unitree, kimodo, gmr"),
        ("unitree.csv", ["--style", "gmr"], "give --fps"),
        ("unitree.csv", ["--style", "unitree", "--rig", "humanoid"], "line 1 has 27 columns, expected"),
        ("unitree.csv", ["--style", "kimodo", "--fps", "0"], "not"),
        ("ours.csv", ["--rig", "humanoid"], "not those of humanoid"),
        ("clip.bvh", ["--style", "gmr"], "--style and --fps are for .csv"),
        ("joints.npy", ["--fps", "30"], "--style and --fps are for .csv"),
    ],
)
def test_what_a_file_leaves_open_must_be_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, options: list[str], said: str
) -> None:
    path = one_of_each(tmp_path)[name]
    assert main(["check", str(path), *options]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error
    assert "\n" not in error
    assert error.startswith("rigcast: ")


def test_a_foreign_npz_is_refused_with_its_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.savez(tmp_path / "x.npz", qpos=np.zeros((3, 36)), rate=30)
    assert main(["play", str(tmp_path / "x.npz")]) == 2
    assert "no kind and version in it: qpos, rate" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", WRITERS)
def test_the_longest_suffix_decides(suffix: str) -> None:
    assert suffix_of(Path(f"walk{suffix}")) == suffix


def test_play_writes_what_play_reads(tmp_path: Path) -> None:
    clip = one_of_each(tmp_path)["clip.bvh"]
    outs = ["p.amass.npz", "p.npy", "p.bvh", "p.unitree.csv", "p.kimodo.csv", "p.gmr.csv"]
    assert main(["play", str(clip), "--unchecked", *(a for o in outs for a in ("--out", str(tmp_path / o)))]) == 0
    for name in outs[:3]:
        assert isinstance(read(tmp_path / name), Motion)
    for style in ("unitree", "kimodo", "gmr"):
        back = read(tmp_path / f"p.{style}.csv", "puppet", style, 50.0 if style == "gmr" else None)  # type: ignore[arg-type]
        assert isinstance(back, Trajectory)
        assert back.fps == (50 if style == "gmr" else 30)


# ---- Garbage

GARBAGE = settings(
    max_examples=150, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@GARBAGE
@given(content=st.binary(max_size=300), suffix=st.sampled_from(READABLE))
def test_garbage_is_one_line(tmp_path: Path, content: bytes, suffix: str) -> None:
    (tmp_path / f"x{suffix}").write_bytes(content)
    with pytest.raises(ValueError, match=rf"x\{suffix}: ") as caught:
        read(tmp_path / f"x{suffix}", "puppet", "unitree" if suffix == ".csv" else "ours")
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Content of a good file of every format, by name."""
    return {n: p.read_bytes() for n, p in sorted(one_of_each(tmp_path_factory.mktemp("good")).items())}


@GARBAGE
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused_in_one_line(
    tmp_path: Path, good: dict[str, bytes], data: st.DataObject
) -> None:
    """Good files with bytes changed, cut out or put in somewhere."""
    name, whole = data.draw(st.sampled_from(list(good.items())))
    at = data.draw(st.integers(0, len(whole) - 1))
    gone = data.draw(st.sampled_from([0, 1, 7, 1000]))
    (tmp_path / name).write_bytes(whole[:at] + data.draw(st.binary(max_size=6)) + whole[at + gone :])
    said = f"{name}: "
    try:
        read(tmp_path / name, "puppet", "unitree" if name == "unitree.csv" else "ours")
    except ValueError as error:
        said = str(error)
    assert f"{name}: " in said
    assert "\n" not in said
