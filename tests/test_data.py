"""Data sets: each kind of source, shards against the features themselves, resuming, splits, mirrors, mistakes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from motions import motion, stand, walk, wave

from motiongen.data.build import build
from motiongen.data.clip import Clip, Sample, SourceError, split_of
from motiongen.data.dataset import DatasetError, Entry, open_dataset
from motiongen.data.pictures import CELL, LEFT, POSES, RIGHT, TITLE, different, draw_clips
from motiongen.data.read_clips import read_clips
from motiongen.data.sources import find_clips
from motiongen.features import motion_to_features
from motiongen.files import load_motion, save_motion
from motiongen.formats.bvh_write import write_bvh
from motiongen.formats.humanml_npy import write_humanml
from motiongen.gestures.reading import read
from motiongen.measure.clip import measure
from motiongen.text.captions import kept_for_testing, phrasings, swap_sides
from motiongen.text.say_numbers import says_number
from rigcast.__main__ import main

ROOT = Path(__file__).parent.parent
SHARD = 30_000  # bytes: about one clip of four seconds


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two clips with three captions."""
    where = tmp_path / "clips"
    (where / "more").mkdir(parents=True)
    save_motion(wave("right"), where / "wave.npz")
    write_bvh(walk(), where / "more" / "walk.bvh")
    (where / "captions.csv").write_text(
        'file,caption\nwave.npz,"waves, upright, with the right hand"\nmore/walk.bvh,walks\nwave.npz,"says ""hi"""\n'
    )
    return where


# ---- Sources


def test_a_folder_with_captions(folder: Path, tmp_path: Path) -> None:
    dataset, fresh = build([f"folder:{folder}"], tmp_path / "out")
    assert fresh
    assert [(e.name, e.captions) for e in dataset.entries] == [
        ("clips/more/walk.bvh", ("walks", "walks 8 steps")),
        ("clips/wave.npz", ("waves, upright, with the right hand", 'says "hi"')),
    ]
    assert dataset.captions(1, mirrored=True) == ("waves, upright, with the left hand", 'says "hi"')


def test_jsonl_says_the_same_as_csv(folder: Path) -> None:
    by_csv = find_clips(f"folder:{folder}")
    (folder / "captions.csv").unlink()
    rows = [("wave.npz", "waves"), ("more/walk.bvh", "walks")]
    (folder / "captions.jsonl").write_text("".join(json.dumps({"file": f, "caption": c}) + "\n" for f, c in rows))
    assert [(c.name, c.file) for c in find_clips(f"folder:{folder}")] == [(c.name, c.file) for c in by_csv]


def test_bandai_namco_names_say_content_and_style(tmp_path: Path) -> None:
    source = tmp_path / "dataset" / "data"
    source.mkdir(parents=True)
    write_bvh(wave("right"), source / "dataset-2_wave-right-hand_tired_001.bvh")
    entry = build([f"bandai-namco:{tmp_path / 'dataset'}"], tmp_path / "out")[0].entries[0]
    assert (entry.content, entry.style) == ("wave-right-hand", "exhausted")
    for captions, content in ((entry.captions, "wave-right-hand"), (entry.mirrored, "wave-left-hand")):
        numbered = {c for c in captions if says_number(c)}
        assert len(set(captions)) == 12
        assert 0 < len(numbered) <= 8
        assert set(captions) - numbered <= set(phrasings(content, "exhausted"))
        assert not [c for c in numbered if not re.search(r"(three|3) times\b|(four|4) seconds\b", c)]


def test_cmu_takes_captions_from_the_index_and_drops_the_t_pose(tmp_path: Path) -> None:
    source = tmp_path / "cmu"
    source.mkdir()
    for name in ("007_01", "007_02", "notes"):
        write_bvh(walk(seconds=2), source / f"{name}.bvh")
    (source / "index.csv").write_text(
        '"Subject","Trial #","Motion Description","framerate"\n7,1,"walk, turn left",120\n7,2,,120\n'
    )
    dataset, _ = build([f"cmu:{source}"], tmp_path / "out")
    assert [e.name for e in dataset.entries] == ["cmu/007_01"]
    assert dataset.captions(0, mirrored=True)[0] == "walk, turn right"
    assert len(dataset.features(0)) == len(walk(seconds=2)) - 1


def test_humanml3d_cuts_out_what_a_text_speaks_of(tmp_path: Path) -> None:
    source = tmp_path / "humanml"
    (source / "new_joint_vecs").mkdir(parents=True)
    (source / "texts").mkdir()
    for name in ("000001", "M000001"):
        write_humanml(walk(seconds=4), source / "new_joint_vecs" / f"{name}.npy")
        (source / "texts" / f"{name}.txt").write_text(
            "a person walks.#a/DET#0.0#0.0\nsteps left#x#0.5#1.5\nwalks on#x#nan#nan\n"
        )
    dataset, _ = build([f"humanml3d:{source}"], tmp_path / "out")
    whole, part = dataset.entries
    assert (whole.name, whole.captions[:2]) == ("humanml3d/000001", ("a person walks.", "walks on"))
    assert (part.name, part.captions) == ("humanml3d/000001@0.5-1.5", ("steps left",))
    assert part.frames == 31  # one second at 30 a second
    assert whole.split == part.split


def official(folder: Path, names: Sequence[str], split: dict[str, str]) -> str:
    """A directory laid out like HumanML3D's, of one walk under several names."""
    for needed in ("new_joint_vecs", "texts"):
        (folder / needed).mkdir(parents=True)
    for name in names:
        write_humanml(walk(seconds=2), folder / "new_joint_vecs" / f"{name}.npy")
        (folder / "texts" / f"{name}.txt").write_text("a person walks.#x#0.0#0.0\n")
    for which, listed in split.items():
        (folder / f"{which}.txt").write_text(listed)
    return f"humanml3d:{folder}"


def test_official_splits_are_kept(tmp_path: Path) -> None:
    names = [f"{n:06d}" for n in range(4)]
    lists = {"train": "000002\nM000002\n", "val": "000000\n", "test": "000001\nM000001"}
    source = official(tmp_path / "there", names, lists)
    dataset, _ = build([source], tmp_path / "out")
    assert {e.name[-1]: e.split for e in dataset.entries} == {"0": "val", "1": "test", "2": "train"}
    (tmp_path / "there" / "test.txt").write_text("000001\n000002\n")
    with pytest.raises(SourceError, match=r"test\.txt: line 2: 000002 is in train\.txt too"):
        find_clips(source)
    (tmp_path / "there" / "val.txt").unlink()
    with pytest.raises(SourceError, match=r"has train\.txt but no val\.txt"):
        find_clips(source)


def test_kit_ml_wants_its_own_features(tmp_path: Path) -> None:
    source = official(tmp_path / "there", ["00001"], {})
    with pytest.raises(SourceError, match=r"\(40, 263\) is not \(frames, 251\), the features of kit-ml"):
        build([source.replace("humanml3d", "kit-ml")], tmp_path / "out")


def test_what_a_gesture_is_called_is_what_was_performed() -> None:
    """Its captions' numbers, read back, are those that the motion measures."""
    counted = {"nod": "nods", "shake-head": "head_shakes", "clap": "claps", "squat": "squats", "jump": "jumps"}
    seen = Counter()
    for clip in find_clips("gestures:400"):
        sample = clip.load()
        family = sample.content
        if family not in counted and family != "wave":
            continue
        found = measure(sample.motion)
        done = max(found.left_waves, found.right_waves) if family == "wave" else getattr(found, counted[family])
        for caption in sample.captions:
            said = read(caption).count
            assert said in (None, done), caption
            seen[family] += said is not None
    assert set(seen) == {*counted, "wave"}
    assert min(seen.values()) > 9


def test_gestures_are_the_same_whatever_their_number() -> None:
    few, many = find_clips("gestures:2"), find_clips("gestures:5")
    for a, b in zip(few, many, strict=False):
        left, right = a.load(), b.load()
        np.testing.assert_array_equal(left.motion.joint_quat, right.motion.joint_quat)
        assert (a.name, left.captions) == (b.name, right.captions)
    assert [c.name for c in many][:2] == [c.name for c in few]


# ---- What is written


def test_shards_hold_the_features_of_every_clip(folder: Path, tmp_path: Path) -> None:
    dataset, _ = build([f"folder:{folder}", "gestures:4"], tmp_path / "out", shard_bytes=SHARD)
    assert len(dataset.shards) > 2
    assert all(isinstance(s, np.memmap) and s.dtype == np.float16 for s in dataset.shards)
    row = [e.file for e in dataset.entries].index("wave.npz")
    wanted = motion_to_features(load_motion(folder / "wave.npz"))
    np.testing.assert_allclose(dataset.features(row), wanted, atol=2e-3, rtol=1e-3)
    np.testing.assert_allclose(dataset.motion(row).positions()[:, :, 2], wave("right").positions()[:, :, 2], atol=5e-3)
    assert sum(len(s) for s in dataset.shards) == sum(e.frames for e in dataset.entries)


def test_the_mirror_image_moves_the_other_arm(folder: Path, tmp_path: Path) -> None:
    dataset, _ = build([f"folder:{folder}"], tmp_path / "out")
    clip = dataset.motion(1, mirrored=True)
    wanted = wave("left").positions()
    np.testing.assert_allclose(clip.positions() - clip.root_pos[:, None], wanted - wanted[:, :1], atol=0.01)


def test_statistics_are_those_of_the_training_split_and_its_mirror_images(tmp_path: Path) -> None:
    dataset, _ = build(["gestures:16"], tmp_path / "out", shard_bytes=SHARD)
    training = [i for i, entry in enumerate(dataset.entries) if entry.split == "train"]
    assert 0 < len(training) < len(dataset)
    rows = np.concatenate([dataset.features(i, m) for i in training for m in (False, True)]).astype(float)
    np.testing.assert_allclose(dataset.head.mean, rows.mean(0), atol=1e-6)
    np.testing.assert_allclose(dataset.head.std, rows.std(0), atol=1e-5)


def test_the_split_is_a_known_hash_in_known_shares() -> None:
    shares = Counter(split_of(f"clip {i}") for i in range(20_000))
    assert {k: round(v / 20_000, 2) for k, v in shares.items()} == {"train": 0.8, "val": 0.05, "test": 0.15}
    # Written down once: a release that moved clips between the splits would spoil every comparison.
    assert [i for i in range(40) if split_of(f"clip {i}") == "val"] == [11, 15, 24]
    assert [i for i in range(40) if split_of(f"clip {i}") == "test"] == [1, 5, 12, 26, 35]


def test_pieces_of_a_clip_stay_together() -> None:
    assert all(split_of(f"humanml3d/{i}@1-2.5") == split_of(f"humanml3d/{i}") for i in range(50))


def test_phrasings_kept_for_testing_are_in_no_training_clip() -> None:
    tested = Counter()
    for clip in find_clips("gestures:60"):
        captions = clip.load().captions
        tested[split_of(clip.name)] += sum(map(kept_for_testing, captions))
        assert captions
    assert tested["train"] == 0
    assert tested["test"] > 0


def test_sides_are_whole_words() -> None:
    text = "turns left (clockwise), leans leftwards, stands upright in bright light on the right-hand side"
    swapped = "turns right (counterclockwise), leans rightwards, stands upright in bright light on the left-hand side"
    assert swap_sides(text) == swapped
    assert swap_sides(swapped) == text


def test_the_report_counts(folder: Path, tmp_path: Path) -> None:
    build([f"folder:{folder}", "gestures:2"], tmp_path / "out")
    page = (tmp_path / "out" / "report.md").read_text()
    assert "| folder | not stated | 2 | 0.00 | 4 |" in page
    assert "| gestures | Apache-2.0 | 2 |" in page
    spans = re.findall(r"^\| (?:over )?\d.* s \| (\d+) \|", page, re.M)
    assert sum(map(int, spans)) == 4
    assert "![Some of the clips as stick figures](report.png)" in page


def test_a_data_set_without_pillow_has_no_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert build(["gestures:1"], tmp_path / "out")[1]
    assert "report.png" not in (tmp_path / "out" / "report.md").read_text()
    assert not (tmp_path / "out" / "report.png").exists()


def test_stick_figures_stand_where_the_joints_are(folder: Path, tmp_path: Path) -> None:
    """The hand that waves is high, on the picture's left and blue: it is the right one, seen from ahead."""
    from PIL import Image

    dataset, _ = build([f"folder:{folder}"], tmp_path / "out")
    draw_clips(dataset, [1], tmp_path / "clip.png")
    with Image.open(tmp_path / "clip.png") as picture:
        rgb = np.asarray(picture.convert("RGB")).astype(int)
    middle = slice(4 * CELL[0], 5 * CELL[0])
    assert rgb.shape == (CELL[1] + TITLE, POSES * CELL[0], 3)

    def highest(colour: tuple[int, int, int]) -> tuple[int, int]:
        rows, columns = np.nonzero((np.abs(rgb[TITLE:, middle] - colour) < 12).all(-1))
        return int(rows.min()), int(columns[rows.argmin()])

    (blue, across), (red, _) = highest(RIGHT), highest(LEFT)
    assert blue < red - 10
    assert across < CELL[0] / 2 - 10


def test_different_contents_are_picked() -> None:
    content = [("a", ""), ("b", ""), ("a", ""), ("c", ""), ("d", ""), ("b", "")]
    entries = [Entry(str(i), "", "", "", "train", 0, 1, (), (), c, s, (), (0, 0)) for i, (c, s) in enumerate(content)]
    assert different(entries, 2) == [0, 4]
    assert different(entries, 9) == [0, 1, 3, 4]
    assert different([replace(e, content="") for e in entries], 3) == [0, 2, 5]


def test_any_number_of_jobs_writes_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    (folder / "more" / "walk.bvh").write_text("HIERARCHY\nnonsense")  # one that is skipped
    sources = [f"folder:{folder}", "gestures:9"]
    for jobs in (1, 3):
        build(sources, tmp_path / str(jobs), jobs=jobs, shard_bytes=SHARD)
    names = sorted(p.name for p in (tmp_path / "1").iterdir())
    assert len(names) > 6
    assert sorted(p.name for p in (tmp_path / "3").iterdir()) == names
    assert all((tmp_path / "1" / n).read_bytes() == (tmp_path / "3" / n).read_bytes() for n in names)
    with pytest.raises(ValueError, match="jobs must be 1 or more, not 0"):
        build(sources, tmp_path / "none", jobs=0)


def die() -> Sample:
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError


def test_a_killed_reader_is_one_line() -> None:
    clips = [Clip(str(i), "", "", die) for i in range(2)]
    with pytest.raises(RuntimeError, match="a process that read clips was killed"):
        list(read_clips(clips, jobs=2))


# ---- Interruptions

KILLED = """
import os, signal
from pathlib import Path
import motiongen.data.read_clips as b
from motiongen.data.build import build
real, calls = b.motion_to_features, []
def dying(motion):
    calls.append(1)
    if len(calls) == 6:
        os.kill(os.getpid(), signal.SIGKILL)
    return real(motion)
b.motion_to_features = dying
build(["gestures:9"], Path("cut"), shard_bytes=30000)
"""


def test_a_killed_build_is_noticed_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = subprocess.run([sys.executable, "-c", KILLED], cwd=tmp_path, env={"PYTHONPATH": str(ROOT)}, check=False)
    assert run.returncode == -9
    cut = tmp_path / "cut"
    (cut / ".shard-0009-1.npy").write_bytes(b"half")
    kept = {p.name: p.stat().st_mtime_ns for p in cut.glob("shard-*")}
    assert len(kept) >= 2
    with pytest.raises(DatasetError, match="interrupted; run the same"):
        open_dataset(cut)
    with pytest.raises(DatasetError, match="an unfinished data set of 9 clips"):
        build(["gestures:8"], cut, shard_bytes=SHARD)
    started: list[int] = []
    build(["gestures:9"], cut, shard_bytes=SHARD, progress=lambda done, _: started.append(done))
    assert started[0] > 0
    assert all((cut / name).stat().st_mtime_ns == when for name, when in kept.items())
    build(["gestures:9"], tmp_path / "whole", shard_bytes=SHARD)
    names = sorted(p.name for p in (tmp_path / "whole").iterdir())
    assert sorted(p.name for p in cut.iterdir()) == names
    assert all((cut / n).read_bytes() == (tmp_path / "whole" / n).read_bytes() for n in names)


def test_a_finished_build_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = ["data", "build", "gestures:2", "--out", str(tmp_path / "out")]
    assert main(args) == 0
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "out").iterdir()}
    assert main(args) == 0
    assert "already built: 2 clips" in capsys.readouterr().out
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "out").iterdir()} == before


# ---- Bad clips and mistakes


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


# ---- Looking at it


def test_show_lists_tells_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from PIL import Image

    dataset, _ = build(["gestures:22"], tmp_path / "out")
    assert main(["data", "show", str(tmp_path / "out")]) == 0
    listed = capsys.readouterr().out
    assert "gestures/000019" in listed
    assert "… and 2 more" in listed
    shortest = min(range(len(dataset)), key=lambda i: dataset.entries[i].frames)
    sheet = tmp_path / "sheet.png"
    args = ["data", "show", str(tmp_path / "out"), "--clip", str(shortest), "--mirrored", "--out", str(sheet)]
    assert main(args) == 0
    assert all(caption in capsys.readouterr().out.splitlines()[1] for caption in dataset.captions(shortest, True)[:1])
    with Image.open(sheet) as picture:
        assert picture.size == (1280, 680)


def test_a_sheet_has_a_row_a_clip(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from PIL import Image

    dataset, _ = build(["gestures:3"], tmp_path / "out")
    sheet = tmp_path / "sheet.png"
    assert main(["data", "show", str(tmp_path / "out"), "--sheet", "2", "--out", str(sheet)]) == 0
    assert capsys.readouterr().out.splitlines() == [f"{i}: {dataset.captions(i)[0]}" for i in (0, 2)]
    with Image.open(sheet) as picture:
        assert picture.size == (896, 328)
        pixels = np.asarray(picture.convert("L")).astype(int)
    panels = pixels[24:164].reshape(140, 7, 128)
    assert np.abs(panels[:, 0] - panels[:, 3]).max() > 30  # something moves


def test_standing_still_has_no_spread_that_is_not_a_number(tmp_path: Path) -> None:
    save_motion(stand(), tmp_path / "stand.npz")
    (tmp_path / "captions.csv").write_text("file,caption\nstand.npz,stands\n")
    assert np.isfinite(build([f"folder:{tmp_path}"], tmp_path / "out")[0].head.std).all()
