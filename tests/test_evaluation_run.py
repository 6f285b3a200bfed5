"""A whole evaluation with judges whose answers are known, its report, and what it makes of bad input."""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motions import walk
from standing_clips import dataset

from motiongen.evaluation.report.page import FPS, page
from motiongen.evaluation.report.plots import plot
from motiongen.evaluation.run import evaluate as run
from motiongen.evaluation.run.judges import Judges
from motiongen.evaluation.run.results import Figure, Results, ResultsError, read_results, write_results
from motiongen.evaluation.run.sets import Plan, make_sets
from motiongen.evaluation.run.show import Wish
from motiongen.evaluation.subjects import open_subject
from motiongen.files import save_motion
from motiongen.generator import PromptError
from motiongen.motion import SMPL_JOINTS, Motion
from rigcast.__main__ import main

PLAN = Plan(
    clips=34,
    again_texts=2,
    again_times=10,
    content=2,
    language=1,
    gate=3,
    judge_steps={"guo": 1, "tmr": 1},
    content_steps=1,
)


class ByLength:
    """An evaluator that sees only how long a motion is, and believes captions that say so."""

    name = "length"

    def embed_texts(self, texts: Sequence[str]) -> np.ndarray:
        return np.array([[float(text.split()[2]), 0.0] for text in texts])

    def embed_motions(self, motions: Sequence[Motion]) -> np.ndarray:
        return np.array([[float(len(motion)), 0.0] for motion in motions])


class AlwaysBow:
    contents = ("bow", "nod")

    def judge_motions(self, motions: Sequence[Motion]) -> list[str]:
        return ["bow"] * len(motions)


JUDGES = Judges(
    evaluators=(ByLength(),),  # type: ignore[arg-type]
    contents=AlwaysBow(),  # type: ignore[arg-type]
    style=None,
    real_contents={"bow": (8, 10), "nod": (10, 10)},
    digests={"length": "0"},
)


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Results, tuple[run.Example, ...], list[str]]:
    """Held-out clips, standing still and a generator that refuses nearly everything, evaluated twice over."""
    folder = tmp_path_factory.mktemp("evaluated")
    told: list[str] = []
    wish = Wish(PLAN, folder, folder / "motions")

    def gate(motions: Sequence[Motion]) -> tuple[str, int]:
        return "rig, stand", len(motions) - 1

    def evaluate() -> tuple[Results, tuple[run.Example, ...]]:
        names = ("real", "mean-pose", "gestures")
        results, _, examples = run.evaluate(names, dataset(folder), wish, lambda what, *_: told.append(what), gate)
        return results, examples

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "open_judges", lambda *_: JUDGES)
        first, examples = evaluate()
        assert evaluate()[0] == first
    write_results(first, folder / "results.json")
    assert read_results(folder / "results.json") == first
    return first, examples, told


def test_figures_are_those_that_the_judges_answers_come_to(evaluated: Any) -> None:
    results, examples, told = evaluated
    real, still, gestures = results.subjects

    def value(subject: Any, group: str, name: str) -> float:
        return subject.figure(group, name).value

    assert value(real, "evaluator length", "R-precision, top 1") == 1.0
    assert value(real, "evaluator length", "MM-Dist") == 0.0
    assert value(still, "evaluator length", "R-precision, top 1") < 0.5  # whole seconds: many are equally long
    # Every answer is "bow": right for bows, wrong for nods; real clips scored 0.9.
    assert value(real, "content", "right, macro average") == 0.5
    assert value(still, "content", "share of real clips' score") == pytest.approx(0.5 / 0.9)
    assert value(still, "content by content", "nod") == 0.0
    # Two of two and none of two: variances at 3/4 and 1/4, both 3/16 over two prompts.
    macro = still.figure("content", "right, macro average")
    assert macro.high - macro.value == pytest.approx(1.96 * (2 * 3 / 16 / 2) ** 0.5 / 2)
    assert value(still, "motion", "foot skate") == 0.0
    assert value(still, "gate", "passes on rig, stand") == pytest.approx(2 / 3)
    assert value(still, "language", "counts") == 0.0
    assert value(still, "language", "out of scope: warned") == 1.0
    assert real.figure("speed", "times faster than real time") is None
    assert still.figure("evaluator length", "multimodality") is None
    # "dwells for 57 frames" names no gesture; what a generator refuses counts as wrong.
    assert gestures.refused >= PLAN.clips
    assert value(gestures, "content", "right, macro average") == 0.0
    counted = next(items for items in gestures.items if (items.group, items.name) == ("content", "right"))
    assert len(results.texts[counted.texts]) == len(counted.values) == 2 * PLAN.content
    assert {example.subject for example in examples} == {"real", "mean-pose", "gestures"}
    assert "mean-pose: held-out captions" in told


class Page(HTMLParser):
    """Tags that are open, links, and the data of the stick figures."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.joints: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "meta":
            self.open.append(tag)
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]
        self.joints += [value or "" for name, value in attrs if name == "data-joints"]

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in ("line", "circle")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_report_stands_alone_and_holds_the_motions(evaluated: Any) -> None:
    results, examples, _ = evaluated
    strange = replace(examples[0], text="</canvas><script>alert('x & y')</script>")
    html = page(results, (strange, *examples[1:]))
    found = Page()
    found.feed(html)
    assert found.open == []
    assert found.links == []
    assert "http" not in html
    assert "<script>alert" not in html
    joints = np.frombuffer(b64decode(found.joints[0]), "<i2").reshape(-1, len(SMPL_JOINTS), 3) / 1000
    assert np.abs(joints - strange.motion.resampled(FPS).positions()[: len(joints)]).max() < 0.001
    assert "prefers-color-scheme: dark" in html


def test_a_dot_lies_where_its_value_is() -> None:
    def dots(*values: float) -> list[float]:
        html = plot("x", [Figure("language", "x", v, v, v, 9) for v in values])
        return [float(part.partition('"')[0]) for part in html.split('cx="')[1:]]

    left, middle, right = dots(0.0, 0.5, 1.0)
    assert middle == pytest.approx((left + right) / 2, abs=0.1)
    low, high = dots(0.25, 0.25)
    assert low == high == pytest.approx(left + (right - left) / 4, abs=0.1)


def test_sets_do_not_overlap_and_depend_on_the_seed_alone(tmp_path: Path) -> None:
    data = dataset(tmp_path)
    one, same, other = (make_sets(data, ["bow", "nod"], PLAN, seed, styles=False) for seed in (0, 0, 1))
    assert not set(one.reference.captions) & set(one.clips.captions)
    assert len(one.clips.captions) == len(one.reference.captions) == PLAN.clips
    assert one.clips.captions == same.clips.captions != other.clips.captions
    assert not any(prompt.style for prompt in one.language)
    assert [content for _, content in one.contents] == ["bow", "bow", "nod", "nod"]


def clips(folder: Path, count: int) -> Path:
    """A folder with one motion under `count` captions."""
    folder.mkdir()
    save_motion(walk(seconds=2.0), folder / "walk.npz")
    lines = "".join(f"walk.npz,walks {i}\n" for i in range(count))
    (folder / "captions.csv").write_text("file,caption\n" + lines)
    return folder


def test_a_folder_is_scored_by_its_own_captions(tmp_path: Path) -> None:
    subject = open_subject(str(clips(tmp_path / "rival", 40)), dataset(tmp_path))
    assert (subject.name, subject.generator) == ("rival", None)
    assert subject.clips is not None
    assert subject.clips.captions[3] == "walks 3"


def test_a_subject_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(PromptError, match="no subject 'mdn'; there are mdm, free, motiondiffuse, diffusionphase, live"):
        open_subject("mdn", dataset(tmp_path))


@pytest.mark.parametrize(
    ("names", "tested", "said"),
    [
        (("gestures",), 63, "63 held-out clips; an evaluation needs 64, 32 to ask for and 32 to compare with"),
        (("mean-pose", "mean-pose"), 70, "two subjects 'mean-pose'"),
        (("few",), 70, "few: 31 clips; an evaluation needs at least 32"),
    ],
)
def test_too_little_to_evaluate_is_told_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: tuple[str, ...], tested: int, said: str
) -> None:
    clips(tmp_path / "few", 31)
    monkeypatch.chdir(tmp_path)
    wish = Wish(PLAN, tmp_path, tmp_path / "motions")
    with pytest.raises(ResultsError, match=said):
        run.evaluate(names, dataset(tmp_path, tested), wish, lambda *_: None)


def _blank_line(folder: Path) -> None:
    (folder / "captions.csv").write_text("file,caption\nwalk.npz,walks\n\nwalk.npz,walks on\n")


def _unmatched(folder: Path) -> None:
    (folder / "captions.csv").write_text("file,caption\nwalk.npz,walks\nrun.npz,runs\n")


def _not_finite(folder: Path) -> None:
    with np.load(folder / "walk.npz") as archive:
        arrays = dict(archive)
    arrays["root_pos"][7] = np.nan
    np.savez(folder / "walk.npz", **arrays)


def _other_skeleton(folder: Path) -> None:
    clip = walk(seconds=1.0)
    body = replace(clip.skeleton, names=(*clip.skeleton.names[:-1], "tail"))
    save_motion(replace(clip, skeleton=body), folder / "walk.npz")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_blank_line, "captions.csv: line 3: blank"),
        (_unmatched, "line 3: no file 'run.npz'"),
        (_not_finite, "walk.npz: .*frame 7 holds NaN"),
        (_other_skeleton, "walk.npz: .*skeleton without right_wrist"),
    ],
)
def test_bad_files_are_one_line_that_names_them(tmp_path: Path, spoil: Any, said: str) -> None:
    folder = clips(tmp_path / "rival", 40)
    spoil(folder)
    with pytest.raises(ValueError, match=said):
        open_subject(str(folder), dataset(tmp_path))


def test_command_says_what_is_wrong_and_exits_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for args, said in (
        (["eval", "mdm", "--data", str(tmp_path), "--out", str(tmp_path / "out")], "not a data set"),
        (["eval", "--data", str(tmp_path), "--out", str(tmp_path / "out")], "nothing to evaluate"),
        (["eval", "compare", str(tmp_path / "a.json"), str(tmp_path)], "a.json: no such file"),
    ):
        assert main(args) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1
