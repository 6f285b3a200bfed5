"""Judges are trained on first use, kept, trained on where a plan wants more, and read without training."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from standing_clips import dataset

from motiongen.data.dataset import Dataset
from motiongen.evaluation.judges.contents import on_body
from motiongen.evaluation.judges.judge import JudgeError
from motiongen.evaluation.run import judges as run_judges
from motiongen.evaluation.run.judges import CONTENTS, Judges, open_judges
from motiongen.evaluation.run.sets import QUICK
from motiongen.features import motion_to_features

PLAN = replace(QUICK, judge_steps={"guo": 1, "tmr": 1}, content_steps=2)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, Path, Judges]:
    folder = tmp_path_factory.mktemp("judges")
    data = dataset(folder, tested=6, trained=66)
    return data, folder, open_judges(data, folder, PLAN, lambda what: None)


def test_judges_that_are_there_are_read_and_say_the_same(
    trained: tuple[Dataset, Path, Judges], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, folder, first = trained

    def untrained(*_: object) -> None:
        raise AssertionError("trained again")

    monkeypatch.setattr(run_judges, "train", untrained)
    monkeypatch.setattr(run_judges, "train_contents", untrained)
    again = open_judges(data, folder, PLAN, lambda what: None)
    assert again.digests == first.digests
    assert set(first.digests) == {"guo", "tmr", "contents"}
    clips = [data.motion(i) for i in range(3)]
    assert again.content(clips) == first.content(clips)
    for one, other in zip(first.evaluators, again.evaluators, strict=True):
        assert np.array_equal(one.embed_motions(clips), other.embed_motions(clips))


def test_right_answers_on_held_out_clips_are_counted_by_content(trained: tuple[Dataset, Path, Judges]) -> None:
    data, _, judges = trained
    held_out = [(i, entry.content) for i, entry in enumerate(data.entries) if entry.split == "test"]
    for content, (right, clips) in judges.real_contents.items():
        rows = [i for i, its in held_out if its == content]
        assert clips == 2 * len(rows)  # and their mirror images
        shown = [data.motion(i, mirrored) for i in rows for mirrored in (False, True)]
        assert right == judges.content(shown).count(content)


def test_a_data_set_with_one_content_needs_no_classifier(trained: tuple[Dataset, Path, Judges], tmp_path: Path) -> None:
    _, folder, _ = trained
    data = dataset(tmp_path, tested=6, trained=66, contents=("bow",))
    judges = open_judges(data, folder, PLAN, lambda what: None)
    assert (judges.contents, judges.style, judges.real_contents) == (None, None, {})
    assert judges.content([data.motion(0)]) == [""]


def test_a_damaged_classifier_is_one_line(trained: tuple[Dataset, Path, Judges], tmp_path: Path) -> None:
    data, folder, _ = trained
    for kind in ("guo", "tmr"):
        (tmp_path / kind).symlink_to(folder / kind)
    (tmp_path / CONTENTS).write_bytes(b"no tensors")
    with pytest.raises(JudgeError, match=r"contents\.safetensors: damaged"):
        open_judges(data, tmp_path, PLAN, lambda what: None)


def test_a_giant_is_taken_for_what_it_does(trained: tuple[Dataset, Path, Judges]) -> None:
    data, _, judges = trained
    motion = data.motion(0)
    skeleton = replace(motion.skeleton, offsets=1.3 * motion.skeleton.offsets)
    giant = replace(motion, root_pos=1.3 * motion.root_pos, skeleton=skeleton)
    own = motion_to_features(motion)
    assert not np.allclose(motion_to_features(giant)[:, :4], own[:, :4], atol=0.05)
    seen = on_body(giant, motion.skeleton.offsets)
    assert np.allclose(seen[:, :-4], own[:, :-4], atol=1e-6)  # contacts are of speeds in the world
    assert judges.content([giant]) == judges.content([motion])
