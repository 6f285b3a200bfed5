"""What a text asks for, whether a motion does it, and which of several comes nearest; truth known by construction."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import motions
import numpy as np
import pytest

from motiongen.candidates import MOST, choose
from motiongen.data.dataset import Dataset, Entry, Head
from motiongen.evaluation.baselines import MeanPose, Retrieval
from motiongen.evaluation.language.discriminants import Discriminant, content_judge
from motiongen.evaluation.language.prompts import CATEGORIES, Prompt, prompts
from motiongen.evaluation.language.ruler import gesture_cases, trust
from motiongen.evaluation.language.run import interval, language_table, main, rows
from motiongen.features import motion_to_features
from motiongen.generator import Familiarity, PromptError
from motiongen.gestures.catalogue import perform
from motiongen.gestures.generator import GestureGenerator
from motiongen.measure.clip import observe
from motiongen.motion import Motion
from motiongen.text.asking import asked_of
from motiongen.text.captions import kept_for_testing, swap_sides
from motiongen.text.claims import Asked, Claim, holds, shortfall


def after(first: Motion, second: Motion) -> Motion:
    """One motion and then the other, on the same body, cut together where both stand."""
    return replace(
        first,
        root_pos=np.concatenate([first.root_pos, second.root_pos]),
        joint_quat=np.concatenate([first.joint_quat, second.joint_quat]),
        contacts=None,
    )


def does(asked: Asked | Claim, motion: Motion) -> bool:
    return holds(asked if isinstance(asked, Asked) else Asked((asked,)), observe(motion))


# ---- What a text asks for


@pytest.mark.parametrize(
    ("text", "claims", "order"),
    [
        ("wave three times with the left hand", [Claim("wave", "left", 3)], "any"),
        ("bow, then wave twice with the right hand", [Claim("bow"), Claim("wave", "right", 2)], "then"),
        ("nod twice and clap four times", [Claim("nod", count=2), Claim("clap", count=4)], "any"),
        ("walk while waving your left hand", [Claim("walk"), Claim("wave", "left")], "while"),
        ("squat and nod at the same time", [Claim("squat"), Claim("nod")], "while"),
        ("turn left one hundred thirty-five degrees", [Claim("turn", "left", degrees=135)], "any"),
        ("raise the right arm to 90 degrees", [Claim("arm", "right", degrees=90)], "any"),
        ("raise your right hand once", [Claim("raise", "right")], "any"),
        ("a person walks slowly", [Claim("walk", pace="slow")], "any"),
        ("take four steps", [Claim("step", count=4)], "any"),
        ("walk sideways to the left", [Claim("aside", "left")], "any"),
        ("kick with the left leg", [Claim("leg", "left")], "any"),
    ],
)
def test_a_text_is_read(text: str, claims: list[Claim], order: str) -> None:
    assert asked_of(text) == Asked(tuple(claims), order)  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["dance to music", "solve a cubic equation", "look to the left", "", "left"])
def test_what_cannot_be_measured_is_not_asked(text: str) -> None:
    assert asked_of(text) is None


def test_the_prompts_are_read_as_they_were_written() -> None:
    """Prompts carry what was meant, written beside them by hand; the reader sees the text alone."""
    measured = [p for p in prompts(200) if p.asked is not None and not p.content]
    assert len(measured) == 6 * 200
    wrong = [p.text for p in measured if asked_of(p.text) != p.asked]
    assert len(wrong) <= 0.01 * len(measured), wrong


def test_prompts_are_fixed_and_as_many_as_asked() -> None:
    once = prompts(30, seed=4)
    assert once == prompts(30, seed=4) != prompts(30, seed=5)
    assert [sum(p.category == name for p in once) for name in CATEGORIES] == [30] * len(CATEGORIES)
    counts = [p.asked.claims[0].count for p in prompts(360) if p.category == "counts" and p.asked]
    assert {counts.count(n) for n in range(1, 6)} == {72}


def test_claims_that_cannot_be_measured_are_refused() -> None:
    for bad, word in (
        (lambda: Claim("juggle"), "juggle"),
        (lambda: Claim("turn", count=2), "turn has no count"),
        (lambda: Claim("nod", degrees=20), "nod has no degrees"),
        (lambda: Claim("jump", pace="slow"), "jump has no pace"),
        (lambda: Asked((Claim("hand", "left"), Claim("bow")), "then"), "in order"),
    ):
        with pytest.raises(ValueError, match=word):
            bad()


# ---- Whether a motion does it


def test_the_ruler_knows_right_from_wrong() -> None:
    """Gestures with all parameters drawn: each is asked for what it shows and for what it does not."""
    for each in trust(list(gesture_cases(2, seed=3))):
        assert (each.found, each.refused) == (1.0, 1.0), each


def test_order_is_heard() -> None:
    bow, wave = perform("bow"), perform("wave", side="left", count=2)
    then = Asked((Claim("bow"), Claim("wave", "left", 2)), "then")
    assert does(then, after(bow, wave))
    assert not does(then, after(wave, bow))
    assert does(replace(then, order="any"), after(wave, bow))
    assert not does(then, bow)


def test_two_at_once_are_told_from_one_after_the_other() -> None:
    asked = Asked((Claim("nod"), Claim("wave", "left")), "while")
    wave, nod = perform("wave", side="left", count=4), perform("nod", count=3)
    quat = wave.joint_quat.copy()
    nodding = nod.joint_quat[:, nod.skeleton.index("head")]
    quat[30 : 30 + len(nodding), wave.skeleton.index("head")] = nodding
    quat[30 : 30 + len(nodding), wave.skeleton.index("neck")] = nod.joint_quat[:, nod.skeleton.index("neck")]
    assert does(asked, replace(wave, joint_quat=quat))
    assert not does(asked, after(wave, nod))


def test_a_walk_is_a_walk_and_has_a_pace() -> None:
    assert does(Claim("walk"), motions.walk(speed=1.2))
    assert does(Claim("walk", pace="slow"), motions.walk(speed=0.7))
    assert not does(Claim("walk", pace="slow"), motions.walk(speed=1.2))
    assert not does(Claim("run"), motions.walk(speed=1.2))
    assert not does(Claim("walk"), motions.stand(3))
    assert does(Claim("step", count=8), motions.walk(seconds=4))


def test_the_other_hand_must_keep_out() -> None:
    both, left = perform("wave", side="both", count=2), perform("wave", side="left", count=2)
    assert does(Claim("wave", "both", 2), both)
    assert not does(Claim("wave", "left", 2), both)
    assert not does(Claim("wave", "both", 2), left)
    assert not does(Claim("raise", "left"), perform("raise-arm", side="both"))


def test_waves_from_the_wrist_count() -> None:
    """The forearm is still; the hand alone swings by ±0.5 rad at 2 Hz, six times in 3 s but for the ends."""
    t = np.arange(91) / 30
    held = motions.wave("left", seconds=3)
    quat = np.repeat(held.joint_quat[45:46], len(t), axis=0)
    swing = 0.25 * np.sin(4 * np.pi * t)
    quat[:, held.skeleton.index("left_wrist")] = np.stack([np.cos(swing), np.sin(swing), 0 * t, 0 * t], axis=1)
    root = np.repeat(held.root_pos[45:46], len(t), axis=0)
    found = observe(replace(held, root_pos=root, joint_quat=quat)).totals
    assert 5 <= found.left_waves <= 6
    assert found.right_waves == 0


def test_nearer_falls_less_short() -> None:
    asked = Asked((Claim("wave", "left", 3),))
    short = [shortfall(asked, observe(perform("wave", side="left", count=n))) for n in (3, 2, 1, 5)]
    assert short[0] == 0 < short[1] < short[2]
    assert short[1] < short[3]
    other = shortfall(asked, observe(perform("wave", side="right", count=3)))
    assert other > short[1]


# ---- Candidates


@dataclass
class Waver:
    """Waves as often as the seed says, whatever the text; one after another, or all in one batch."""

    name: str = "waver"
    licence: str = "CC0"
    seeds: list[int] = field(default_factory=list)

    def familiarity(self, text: str) -> Familiarity:
        return Familiarity("wave" in text, 1.0, ("wave",))

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        self.seeds.append(seed)
        return perform("wave", side="left", count=seed)


class BatchWaver(Waver):
    def generate_batch(
        self, texts: list[str], *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> list[Motion]:
        return [self.generate(text, seed=seed + i) for i, text in enumerate(texts)]


@pytest.mark.parametrize("generator", [Waver(), BatchWaver()], ids=["one by one", "batch"])
def test_the_candidate_that_measures_right_is_kept(generator: Waver) -> None:
    generator.seeds.clear()
    kept = choose(generator, "wave three times with the left hand", candidates=4, seed=1)
    assert (kept.index, kept.drawn, kept.right) == (2, 4, True)
    assert observe(kept.motion).totals.left_waves == 3
    assert generator.seeds == [1, 2, 3, 4]
    assert str(kept) == "kept 3 of 4: waves three times (left)"


def test_nothing_more_is_drawn_than_is_needed() -> None:
    generator = Waver()
    assert choose(generator, "wave twice with the left hand", candidates=8, seed=2).drawn == 1
    assert choose(generator, "dance to music", candidates=8, seed=1).drawn == 1
    assert choose(generator, "wave five times with the left hand", candidates=1, seed=1).drawn == 1
    assert generator.seeds == [2, 1, 1]


def test_where_none_is_right_the_nearest_is_kept() -> None:
    kept = choose(Waver(), "wave five times with the left hand", candidates=3, seed=1)
    assert (kept.index, kept.right) == (2, False)
    assert str(kept) == "kept 3 of 3, which comes nearest to: waves five times (left)"


@pytest.mark.parametrize("count", [0, -1, MOST + 1])
def test_a_number_of_candidates_that_makes_no_sense_is_refused(count: int) -> None:
    with pytest.raises(PromptError, match=str(count)):
        choose(Waver(), "wave", candidates=count)


# ---- The table


def test_intervals_are_wilsons() -> None:
    """Against the roots of (p − x)² = z² x (1 − x) / n, which define the score interval."""
    for right, n in ((0, 20), (7, 20), (20, 20), (150, 200)):
        p, z2 = right / n, 1.96**2
        low, high = sorted(np.roots([1 + z2 / n, -(2 * p + z2 / n), p * p]).real)
        assert interval(right, n) == pytest.approx((max(low, 0), min(high, 1)), abs=1e-9)


def test_the_table_of_gestures() -> None:
    """The gesture generator nods as often as it is told; it refuses what is no gesture, and says so beforehand."""
    asked = (
        *(Prompt(f"nod {n} times", "counts", Asked((Claim("nod", count=n),))) for n in (2, 3, 4)),
        Prompt("nod 2 times", "wrong", Asked((Claim("nod", count=3),))),
        Prompt("swim in the ocean", "refused", content="swim"),
        Prompt("bow", "judged", content="bow"),
        Prompt("bow", "judged", content="wave"),
        Prompt("solve a cubic equation", "scope", known=False),
        Prompt("nod", "scope", known=True),
    )

    def judge(motions: list[Motion]) -> list[str]:
        return ["bow"] * len(motions)

    table = language_table(GestureGenerator(), asked, judge, judge)
    assert [(row.category, row.n, row.share) for row in table] == [
        ("counts", 3, 1.0), ("wrong", 1, 0.0), ("refused", 1, 0.0), ("judged", 2, 0.5), ("scope", 2, 1.0),
    ]  # fmt: skip
    assert rows(asked[:1], [True])[0].low == pytest.approx(interval(1, 1)[0])


def test_a_discriminant_tells_what_differs() -> None:
    rng = np.random.default_rng(0)
    means = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    which = rng.integers(0, 3, 600)
    x = means[which] + rng.standard_normal((600, 3)) * [1, 1, 50]
    tells = Discriminant(x[:300], [f"class {i}" for i in which[:300]])
    right = np.mean([said == f"class {i}" for said, i in zip(tells(x[300:]), which[300:], strict=True)])
    assert right > 0.85  # the best possible is 0.91
    with pytest.raises(ValueError, match="two classes"):
        Discriminant(x, ["one"] * 600)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Eight performances each of a bow, a nod and a wave with the left hand, all of the training split."""
    entries, parts, start = [], [], 0
    for name, text, other in (("bow", "bow", "bow"), ("nod", "nod", "nod"), ("wave", "wave left", "wave right")):
        for seed in range(8):
            clip = perform(name, side="left" if name == "wave" else None, seed=seed)
            parts.append(motion_to_features(clip).astype(np.float16))
            bones = tuple((x, y, z) for x, y, z in clip.skeleton.offsets.tolist())
            entries.append(
                Entry(
                    f"{name}/{seed}",
                    "gestures",
                    "",
                    "CC0",
                    "train",
                    start,
                    len(parts[-1]),
                    (text,),
                    (other,),
                    name,
                    "",
                    bones,
                    clip.skeleton.foot_height,
                )
            )
            start += len(parts[-1])
    rows = np.concatenate(parts)
    mean, std = (tuple(y.tolist()) for y in (rows.mean(0, float), rows.std(0, float)))
    head = Head(1, ("gestures",), len(entries), finished=True, mean=mean, std=std)
    return Dataset(tmp_path_factory.mktemp("data"), head, tuple(entries), (), (0,) * len(entries), (rows,))


def test_retrieval_finds_the_clip_of_a_caption(data: Dataset) -> None:
    retrieval = Retrieval(data)
    assert retrieval.generate("nod").source.generator.startswith("nod/")
    assert does(Claim("wave", "left"), retrieval.generate("wave left"))
    assert does(Claim("wave", "right"), retrieval.generate("wave right"))  # of the mirror image
    assert retrieval.familiarity("please nod").nearest[0] == "nod"
    assert retrieval.familiarity("nod").score == pytest.approx(1, abs=1e-4)
    assert not retrieval.familiarity("the stock market crashed").known
    assert len({retrieval.generate("nod", seed=seed).source.generator for seed in range(12)}) > 3


def test_the_mean_pose_stands_still(data: Dataset) -> None:
    still = MeanPose(data).generate("wave", seconds=2)
    assert still.duration == pytest.approx(2)
    assert np.abs(np.diff(still.positions(), axis=0)).max() < 1e-9
    assert observe(still).events == ()


def test_judges_learn_contents(data: Dataset) -> None:
    new = [perform(name, seed=100) for name in ("bow", "nod", "wave")]
    assert content_judge(data)(new) == ["bow", "nod", "wave"]


def test_the_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--dataset", str(tmp_path)]) == 2
    assert "not a data set" in capsys.readouterr().err


def test_held_out_phrasings_hold_both_sides_out() -> None:
    """The content prompts are of the tenth that no model is trained on, but for those written by hand."""
    said = [p.text for p in prompts(150) if p.category == "content: gestures"]
    assert all(kept_for_testing(text) for text in said)
    assert all(kept_for_testing(swap_sides(text)) for text in said)
