"""Which reader a file gets, which writer a suffix gets, and that no garbage gets through any of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fuzz import RIG, damaged, one_of_each, outcome, style_of
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motiongen.motion import Motion
from retarget.trajectory import Trajectory
from rigcast.__main__ import main
from rigcast.outputs import WRITERS, suffix_of
from rigcast.pipeline import READABLE, read


def test_every_format_finds_its_reader(tmp_path: Path) -> None:
    for name in one_of_each(tmp_path):
        style = style_of(name)
        what = read(tmp_path / name, RIG, style, 30.0 if style == "gmr" else None)
        assert isinstance(what, Trajectory if name.startswith("traj") or name.endswith(".csv") else Motion), name
        assert what.duration == pytest.approx(1, abs=0.12), name  # features lose a frame, KIT-ML's at 12.5 a second


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("unitree.csv", [], "name the file's --style: ours, unitree, kimodo, gmr"),
        ("unitree.csv", ["--style", "gmr"], "give --fps"),
        ("unitree.csv", ["--style", "unitree", "--rig", "humanoid"], "line 1 has 27 columns, expected"),
        ("unitree.csv", ["--style", "kimodo", "--fps", "0"], "0 frames a second, expected 0.1 to 10000"),
        ("ours.csv", ["--rig", "humanoid"], "not those of humanoid"),
        ("clip.bvh", ["--style", "gmr"], "--style and --fps are for .csv"),
        ("joints.npy", ["--fps", "30"], "--style and --fps are for .csv"),
    ],
)
def test_what_a_file_leaves_open_must_be_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, options: list[str], said: str
) -> None:
    one_of_each(tmp_path)
    path = tmp_path / name
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
    one_of_each(tmp_path)
    clip = tmp_path / "clip.bvh"
    outs = ["p.amass.npz", "p.npy", "p.kit.npy", "p.bvh", "p.unitree.csv", "p.kimodo.csv", "p.gmr.csv", "p.glb"]
    assert main(["play", str(clip), "--unchecked", *(a for o in outs for a in ("--out", str(tmp_path / o)))]) == 0
    for name in outs[:4]:
        assert isinstance(read(tmp_path / name), Motion)
    assert (tmp_path / "p.glb").read_bytes()[:4] == b"glTF"
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
    return one_of_each(tmp_path_factory.mktemp("good"))


@GARBAGE
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused_in_one_line(
    tmp_path: Path, good: dict[str, bytes], data: st.DataObject
) -> None:
    """A few of those that `benchmarks/motion_files.py --fuzz` tries by the thousand."""
    assert outcome(tmp_path, *data.draw(damaged(good))) in ("read", "refused")
