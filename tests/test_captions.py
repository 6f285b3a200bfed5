"""Captions say the content, keep their sides, and one in ten is kept for testing."""

import pytest

from motiongen.captions import CONTENTS, STYLES, kept_for_testing, phrasings, style_name, swap_sides


@pytest.mark.parametrize("content", CONTENTS)
def test_at_least_twenty_phrasings_and_the_right_side(content: str) -> None:
    said = phrasings(content)
    assert len(said) >= 20
    for caption in said:
        assert caption == " ".join(caption.split())
        for side, other in (("left", "right"), ("right", "left")):
            if side in content:
                assert other not in caption.split()


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
