"""Data sets: what each kind of source gives, and in which split."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from motions import walk, wave

from motiongen.data.build import build
from motiongen.data.clip import SourceError
from motiongen.data.sources import find_clips
from motiongen.formats.bvh_write import write_bvh
from motiongen.formats.humanml_npy import write_humanml
from motiongen.gestures.reading import read
from motiongen.measure.clip import measure
from motiongen.text.captions import phrasings
from motiongen.text.say_numbers import says_number


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
