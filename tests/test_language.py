"""What a text asks for, and whether a motion does it; truth known by construction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import motions
import numpy as np
import pytest
from motions import does

from motiongen.evaluation.language.prompts import CATEGORIES, Prompt, prompts
from motiongen.evaluation.language.ruler import gesture_cases, trust
from motiongen.evaluation.language.run import interval, language_table, main, rows
from motiongen.gestures.catalogue import perform
from motiongen.gestures.generator import GestureGenerator
from motiongen.measure.clip import observe
from motiongen.motion import Motion
from motiongen.text.asking import asked_of
from motiongen.text.captions import kept_for_testing, swap_sides
from motiongen.text.claims import Asked, Claim, shortfall


def after(first: Motion, second: Motion) -> Motion:
    """One motion and then the other, on the same body, cut together where both stand."""
    return replace(
        first,
        root_pos=np.concatenate([first.root_pos, second.root_pos]),
        joint_quat=np.concatenate([first.joint_quat, second.joint_quat]),
        contacts=None,
    )


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


def test_the_command_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--dataset", str(tmp_path)]) == 2
    assert "not a data set" in capsys.readouterr().err


def test_held_out_phrasings_hold_both_sides_out() -> None:
    """The content prompts are of the tenth that no model is trained on, but for those written by hand."""
    said = [p.text for p in prompts(150) if p.category == "content: gestures"]
    assert all(kept_for_testing(text) for text in said)
    assert all(kept_for_testing(swap_sides(text)) for text in said)
