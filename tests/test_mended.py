"""Gestures as if they had been drawn for another text: what can be put right is, the rest stays."""

from functools import cache, partial

import numpy as np
import pytest

from motiongen.diffusion.mended import mended
from motiongen.features import features_to_motion, mirror, motion_to_features
from motiongen.generator import load_generator
from motiongen.measure.clip import observe
from motiongen.motion import Label, Motion
from motiongen.nn import Floats
from motiongen.text.asking import asked_of
from motiongen.text.claims import holds, slowness


@cache
def gesture(text: str) -> Motion:
    return load_generator("gestures").generate(text, seed=2)


def drawn_as(x: Floats, text: str = "") -> Motion:
    label = Label(0.0, (len(x) - 1) / 30, text)
    return features_to_motion(x.astype(float), gesture("nod").skeleton, labels=(label,))


def told(text: str, drawn: str, *, as_long: bool = False) -> Motion:
    """What comes of a text for which the gesture `drawn` was drawn."""
    return mended(motion_to_features(gesture(drawn)), text, partial(drawn_as, text=text), mirror, as_long=as_long)


@pytest.mark.parametrize(
    ("text", "drawn"),
    [
        ("wave with the right hand", "wave with the left hand"),
        ("raise the left arm", "raise the right arm"),
        ("wave three times with the right hand", "wave twice with the left hand"),
        ("clap twice", "clap four times"),
        ("nod slowly", "nod"),
        ("wave the left hand quickly", "wave with the left hand"),
        ("wave the left hand slowly", "wave with the right hand"),
        ("turn to the left", "turn right 90 degrees"),
    ],
)
def test_what_is_asked_for_is_done(text: str, drawn: str) -> None:
    asked = asked_of(text)
    assert asked is not None
    assert not holds(asked, observe(gesture(drawn)))
    assert holds(asked, observe(told(text, drawn)))


@pytest.mark.parametrize(
    ("text", "drawn"),
    [
        ("wave with the right hand", "wave with the right hand"),
        ("clap", "wave with the right hand"),
        ("bow, then wave three times with the left hand", "wave twice with the left hand"),
        ("nod slowly", "clap"),
        ("look confused", "nod"),
    ],
)
def test_what_is_right_or_past_mending_stays_as_it_is(text: str, drawn: str) -> None:
    as_drawn = drawn_as(motion_to_features(gesture(drawn)))
    np.testing.assert_array_equal(told(text, drawn).joint_quat, as_drawn.joint_quat)


def test_a_length_that_was_asked_for_stays() -> None:
    for text in ("clap six times", "clap slowly"):
        out = told(text, "clap twice", as_long=True)
        assert (len(out), out.labels[-1].end_s) == (len(gesture("clap twice")), out.duration)


@pytest.mark.parametrize(("pace", "times"), [("slowly", 1.25), ("quickly", 0.8)])
def test_a_pace_is_the_one_that_is_said(pace: str, times: float) -> None:
    text = f"squat {pace}"
    asked = asked_of(text)
    assert asked is not None
    assert slowness(asked.claims[0], observe(told(text, "squat"))) == pytest.approx(times, abs=0.06)
