"""Data sets: shards against the features themselves, statistics, splits, mirror images, resuming."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from motions import stand, wave

from motiongen.data.build import build
from motiongen.data.clip import Clip, Sample, split_of
from motiongen.data.dataset import DatasetError, open_dataset
from motiongen.data.read_clips import read_clips
from motiongen.data.sources import find_clips
from motiongen.features import motion_to_features
from motiongen.files import load_motion, save_motion
from motiongen.text.captions import kept_for_testing, swap_sides
from rigcast.__main__ import main

ROOT = Path(__file__).parent.parent
SHARD = 30_000  # bytes: about one clip of four seconds


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


def test_standing_still_has_no_spread_that_is_not_a_number(tmp_path: Path) -> None:
    save_motion(stand(), tmp_path / "stand.npz")
    (tmp_path / "captions.csv").write_text("file,caption\nstand.npz,stands\n")
    assert np.isfinite(build([f"folder:{tmp_path}"], tmp_path / "out")[0].head.std).all()
