"""Captions say the content, keep their sides, and one in ten is kept for testing."""

import re

import pytest

from motiongen.gestures.catalogue import gestures
from motiongen.text.captions import CONTENTS, STYLES, kept_for_testing, phrasings, style_name, swap_sides


@pytest.mark.parametrize("content", CONTENTS)
def test_many_phrasings_of_every_kind_and_the_right_side(content: str) -> None:
    said = phrasings(content)
    assert len(said) >= 20
    verb = CONTENTS[content].plain[0]
    third, imperative, casual = f"a person {CONTENTS[content].third[0]}", f"please {verb}", f"can you {verb}?"
    assert {third, imperative, casual, f"{verb}!"} <= set(said)
    for caption in said:
        assert caption == " ".join(caption.split())
        for side, other in (("left", "right"), ("right", "left")):
            if side in content:
                assert other not in re.findall(r"\w+", caption)


@pytest.mark.parametrize("name", gestures())
def test_gestures_are_told_asked_for_and_asked_casually(name: str) -> None:
    said = gestures()[name].captions(gestures()[name].params())
    assert len(said) >= 20
    for start, end in (("a person ", ""), ("please ", ""), ("can you ", "?"), ("", "!")):
        assert any(c.startswith(start) and c.endswith(end) for c in said), (start, end)


@pytest.mark.parametrize("content", [name for name in CONTENTS if "left" in name])
def test_the_mirror_image_of_a_phrasing_is_a_phrasing_of_the_other_side(content: str) -> None:
    there = phrasings(swap_sides(content))
    for caption in phrasings(content):
        assert swap_sides(caption) in there


def test_what_people_type_is_there() -> None:
    wave = phrasings("wave-right-hand")
    for typed in (
        "wave",
        "wave!",
        "gimme a wave",
        "can you wave at me?",
        "wave hi",
        "make the robot wave its right hand",
    ):
        assert typed in wave
    assert {"wave bye-bye", "wave bye bye", "wave byebye", "byebye"} <= set(phrasings("byebye"))


def test_third_person_and_imperative_are_in_step() -> None:
    for name, content in CONTENTS.items():
        assert len(content.third) == len(content.plain), name
        assert len(set(content.third)) == len(content.third), name


def test_sides_swap_and_swap_back() -> None:
    for content in CONTENTS:
        for caption in phrasings(content):
            assert swap_sides(swap_sides(caption)) == caption
            assert kept_for_testing(caption) == kept_for_testing(swap_sides(caption))
    assert swap_sides("lifts the left arm, then the right") == "lifts the right arm, then the left"


def test_a_tenth_is_kept_for_testing() -> None:
    said = [c for content in CONTENTS for style in STYLES for c in phrasings(content, style)]
    assert 0.08 < sum(map(kept_for_testing, said)) / len(said) < 0.12


def test_unknown_names_list_the_known() -> None:
    with pytest.raises(ValueError, match=r"unknown content 'fly'.*walk"):
        phrasings("fly")
    with pytest.raises(ValueError, match=r"unknown style 'blue'.*happy"):
        style_name("blue")
