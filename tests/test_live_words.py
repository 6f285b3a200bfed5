"""Steering as it is typed."""

from __future__ import annotations

import math

import pytest

from motiongen.generator import PromptError
from motiongen.live.steering import Steer
from motiongen.live.steering_words import steered


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        (["heading 90"], Steer(heading=math.pi / 2)),
        (["speed 0.5", "heading -45"], Steer(speed=0.5, heading=-math.pi / 4)),
        (["speed 1", "heading 30", "path 1,0 1,1.5"], Steer(speed=1.0, path=((1, 0), (1, 1.5)))),
        (["path 1,0 1,1.5", "heading 0"], Steer(heading=0.0)),
        (
            ["left_hand 0.3,0.2,1.2", "right_hand 0.4,-0.2,1.1"],
            Steer(left_hand=(0.3, 0.2, 1.2), right_hand=(0.4, -0.2, 1.1)),
        ),
        (["speed 1", "heading 30", "heading off"], Steer(speed=1.0)),
        (["path 1,0", "path off"], Steer()),
        (["speed 1", "steer off"], Steer()),
    ],
)
def test_each_word_goes_on_from_the_one_before(said: list[str], wanted: Steer) -> None:
    steer = Steer()
    for line in said:
        found = steered(line, steer)
        assert found is not None
        steer = found
    assert steer == wanted


@pytest.mark.parametrize("text", ["walk forward", "", "turn heading north", "left hand up"])
def test_what_is_no_steering_is_a_text(text: str) -> None:
    assert steered(text, Steer()) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("heading left", "'heading left': say heading DEGREES, from where it began to the left, or heading off"),
        ("speed", "'speed': say speed METRES_A_SECOND"),
        ("speed 1 2", "'speed 1 2': say speed"),
        ("speed 9", "speed 9 m/s; between 0 and 4 are possible"),
        ("heading nan", "finite numbers"),
        ("path 1,2,3", "say path X,Y"),
        ("path 1", "say path X,Y"),
        ("left_hand 0.3,0.2", "say left_hand X,Y,Z"),
        ("left_hand 3,0,1", "at most 0.9"),
        ("steer on", "'steer on': say steer off"),
    ],
)
def test_what_does_not_fit_is_one_line_that_names_the_form(text: str, message: str) -> None:
    with pytest.raises(PromptError) as error:
        steered(text, Steer())
    assert message in str(error.value)
    assert "\n" not in str(error.value)
