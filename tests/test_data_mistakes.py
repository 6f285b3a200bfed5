"""Data sets: bad clips, bad captions, mistakes at the command line, sources that changed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from motions import motion, wave

from motiongen.data.build import build
from motiongen.data.clip import SourceError
from motiongen.data.dataset import DatasetError, open_dataset
from motiongen.data.sources import find_clips
from motiongen.files import save_motion
from rigcast.__main__ import main


def test_bad_clips_are_skipped_and_listed(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "more" / "walk.bvh").write_text("HIERARCHY\nnonsense")
    rush = motion(1.0, 30, {}, "rush", np.array([[0.0, 0, 1], *[[9e4, 0, 1]] * 30]))
    save_motion(rush, folder / "rush.npz")
    with (folder / "captions.csv").open("a") as file:
        file.write("rush.npz,rushes off\n")
    assert main(["data", "build", f"folder:{folder}", "--out", str(tmp_path / "out")]) == 0
    assert "2 clips were skipped, the first because" in capsys.readouterr().err
    dataset = open_dataset(tmp_path / "out")
    assert [e.file for e in dataset.entries] == ["wave.npz"]
    assert "float16" in dataset.skipped[1].why
    assert "clips/rush.npz: moves faster" in (tmp_path / "out" / "report.md").read_text()


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ("file,caption\nwave.npz,waves\n\nmore/walk.bvh,walks\n", "line 3: blank"),
        ("file,caption\nnone.npz,waves\n", "line 2: no file 'none.npz'"),
        ("file,caption\nwave.npz, \n", "line 2: file 'wave.npz' with caption ' '; neither may be empty"),
        ("file,caption\nnotes.txt,waves\n", "cannot read 'notes.txt'; known are .bvh"),
        ("file,caption\nwave.npz,waves,twice\n", "line 2: 3 values instead of 2"),
        ("wave.npz,waves\n", "no column 'file'"),
        ("", "no column 'file'"),
        ("file,caption\nwave.npz,\0" + "x" * 200_000 + "\n", "line 2: "),
        ("file,caption\n", "no clips in this folder"),
    ],
)
def test_a_bad_captions_file_is_one_line(folder: Path, lines: str, words: str) -> None:
    (folder / "captions.csv").write_text(lines)
    with pytest.raises(SourceError) as error:
        find_clips(f"folder:{folder}")
    assert words in str(error.value)


@pytest.mark.parametrize("line", ["", "[1]", '{"file": "wave.npz"}', '{"file": 3, "caption": "x"}', "{"])
def test_a_bad_jsonl_line_is_named(folder: Path, line: str) -> None:
    (folder / "captions.csv").unlink()
    good = '{"file": "wave.npz", "caption": "waves"}\n'
    (folder / "captions.jsonl").write_text(good + line + "\n" + good)
    with pytest.raises(SourceError, match="line 2: "):
        find_clips(f"folder:{folder}")


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["build", "--out", "new"], "no source; name one or more"),
        (["build", "vicon:x", "--out", "new"], "unknown source 'vicon:x'; there are bandai-namco:FOLDER"),
        (["build", "clips", "--out", "new"], "unknown source 'clips'"),
        (["build", "cmu:nowhere", "--out", "new"], "cmu:nowhere: no such folder"),
        (["build", "cmu:empty", "--out", "new"], "no index.csv"),
        (["build", "folder:empty", "--out", "new"], "neither captions.csv nor captions.jsonl"),
        (["build", "bandai-namco:empty", "--out", "new"], "no clips in this folder"),
        (["build", "humanml3d:empty", "--out", "new"], "no new_joint_vecs in this folder"),
        (["build", "gestures:none", "--out", "new"], "the count must be from 1"),
        (["build", "gestures:2", "gestures:2", "--out", "new"], "clip gestures/000000 is in the sources 2 times"),
        (["build", "gestures:2", "--out", "full"], "full: not empty and not a data set"),
        (["build", "gestures:2", "--out", "full/note"], "note: is a file"),
        (["build", "gestures:2", "--out", "old"], "old: format version 0, this rigcast reads 1"),
        (["show", "nowhere"], "nowhere: not a data set"),
        (["show", "empty"], "empty: not a data set"),
        (["show", "old"], "old: format version 0"),
        (["show", "broken"], "dataset.json: damaged"),
        (["show", "cut"], "cut: the build was interrupted; run the same"),
        (["show", "torn"], "shard-0000.npy: missing or damaged"),
        (["show", "good", "--clip", "2"], "no clip 2 in good; there are 0 to 1"),
        (["show", "good", "--out", "a.gif"], "a.gif: the suffix must be .png"),
        (["show", "good", "--out", "nowhere/a.png"], "no folder nowhere"),
        (["show", "good", "--sheet", "2"], "--sheet 2 needs --out FILE.png and no --clip"),
        (["show", "good", "--sheet", "0", "--out", "a.png"], "--sheet 0: 1 to 60 clips"),
        (["build", "gestures:2", "--jobs", "0", "--out", "new"], "jobs must be 1 or more, not 0"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(
    args: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("empty", "full", "old", "broken", "cut"):
        Path(name).mkdir()
    Path("full/note").write_text("mine")
    Path("old/dataset.json").write_text('{"version": 0}')
    Path("broken/dataset.json").write_text('{"version"')
    Path("cut/dataset.json").write_text('{"version": 1, "sources": ["gestures:2"], "clips": 2}')
    for name in ("good", "torn"):
        build(["gestures:2"], Path(name))
    whole = Path("torn/shard-0000.npy").read_bytes()
    Path("torn/shard-0000.npy").write_bytes(whole[: len(whole) // 2])
    assert main(["data", *args]) == 2
    said = capsys.readouterr().err
    assert said.startswith("rigcast: ")
    assert said.count("\n") == 1
    assert words in said
    assert not Path("new").exists()


def test_sources_of_which_nothing_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_bytes(b"no")
    (tmp_path / "captions.csv").write_text("file,caption\na.npz,a\n")
    with pytest.raises(SourceError, match=r"none of the 1 clips can be read; the first, .*a\.npz"):
        build([f"folder:{tmp_path}"], tmp_path / "out")


@pytest.mark.parametrize("finished", [True, False])
@pytest.mark.parametrize("change", ["renamed", "another caption", "another motion"])
def test_sources_that_changed_are_noticed(change: str, finished: bool, folder: Path, tmp_path: Path) -> None:
    build([f"folder:{folder}"], tmp_path / "out")
    head = tmp_path / "out" / "dataset.json"
    head.write_text(json.dumps({**json.loads(head.read_text()), "finished": finished}))
    captions = folder / "captions.csv"
    if change == "renamed":
        (folder / "wave.npz").rename(folder / "greet.npz")
        captions.write_text(captions.read_text().replace("wave.npz", "greet.npz"))
    elif change == "another caption":
        captions.write_text(captions.read_text().replace("walks", "strolls"))
    else:
        save_motion(wave("left", seconds=2), folder / "wave.npz")
    with pytest.raises(DatasetError, match="the sources changed since this was built; remove it"):
        build([f"folder:{folder}"], tmp_path / "out")


@pytest.mark.parametrize("torn", ["shard-0000.npy", "shard-0000.jsonl"])
def test_a_build_does_not_go_on_from_a_damaged_shard(torn: str, tmp_path: Path) -> None:
    build(["gestures:2"], tmp_path / "out")
    head = tmp_path / "out" / "dataset.json"
    head.write_text(json.dumps({**json.loads(head.read_text()), "finished": False}))
    path = tmp_path / "out" / torn
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(DatasetError, match=f"{torn}: .*damaged; build the data set anew"):
        build(["gestures:2"], tmp_path / "out")
