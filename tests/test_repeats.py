"""Counts that are made right: gestures of a known count are measured again after cycles were repeated or left out."""

import numpy as np
import pytest

from motiongen.diffusion.repeats import repeated
from motiongen.features import HEIGHT, features_to_motion, motion_to_features
from motiongen.generator import load_generator
from motiongen.measure.clip import Seen, observe
from motiongen.motion import Motion
from motiongen.nn import Floats
from motiongen.text.claims import Asked, Claim, holds

GESTURES = load_generator("gestures")


def drawn(text: str) -> tuple[Motion, Floats, Seen]:
    """A gesture, its features, each column by its own spread, and what is measured in it."""
    motion = GESTURES.generate(text, seed=3)
    x = motion_to_features(motion)
    return motion, (x - x.mean(0)) / SPREAD, observe(motion)


SPREAD = 0.3
"""What a data set's spread is like."""


def counted(text: str, claim: Claim) -> Motion:
    motion, x, seen = drawn(text)
    mean = motion_to_features(motion).mean(0)
    return features_to_motion((repeated(x, claim, seen) * SPREAD + mean).astype(float), motion.skeleton)


@pytest.mark.parametrize("to", [1, 2, 3, 5])
@pytest.mark.parametrize("of", [2, 4])
@pytest.mark.parametrize(
    ("text", "action", "side"),
    [
        ("wave {} times with the left hand", "wave", "left"),
        ("clap {} times", "clap", ""),
        ("nod {} times", "nod", ""),
        ("shake your head {} times", "shake", ""),
        ("squat {} times", "squat", ""),
        ("bow {} times", "bow", ""),
        ("jump {} times", "jump", ""),
    ],
)
def test_as_many_as_are_asked_for(text: str, action: str, side: str, of: int, to: int) -> None:
    claim = Claim(action, side, count=to)
    assert holds(Asked((Claim(action, side, count=of),)), observe(GESTURES.generate(text.format(of), seed=3)))
    assert holds(Asked((claim,)), observe(counted(text.format(of), claim)))


@pytest.mark.parametrize("claim", [Claim("clap", count=3), Claim("wave", "left", count=2)])
def test_what_is_right_or_not_there_at_all_stays_as_it_is(claim: Claim) -> None:
    _, x, seen = drawn("clap 3 times")
    assert repeated(x, claim, seen) is x


@pytest.mark.parametrize("to", [2, 6])
def test_no_cut_can_be_felt(to: int) -> None:
    """The pelvis rises evenly; where cycles are left out or come again, what it is off by is made up bit by bit."""
    _, x, seen = drawn("wave 4 times with the right hand")
    rise = 0.02
    x[:, HEIGHT] = rise * np.arange(len(x))
    out = repeated(x, Claim("wave", "right", count=to), seen)
    step = rise * abs(len(out) - len(x)) / (1 if to < 4 else to - 4)  # what one cut would be without a blend
    assert step > 10 * rise
    assert np.abs(np.diff(out[:, HEIGHT])).max() < rise + 0.2 * step
