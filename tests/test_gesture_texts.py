"""Gestures in words: their captions, how texts are read, and the generator that finds gestures in them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from motions import at, excursions

from motiongen.generator import PromptError, load_generator
from motiongen.gestures.catalogue import gestures
from motiongen.gestures.reading import read
from motiongen.text.captions import swap_sides

FAMILIES = tuple(gestures())
SIDED = tuple(name for name, family in gestures().items() if "left" in family.sides)


@pytest.mark.parametrize("name", FAMILIES)
def test_captions_are_many_and_are_read_back_as_what_they_say(name: str) -> None:
    family = gestures()[name]
    for i, side in enumerate(family.sides or (None,)):
        for count in (1, 2) if family.repeats else (1,):
            params = family.params(
                side=side, count=count, speed=family.speeds[i % 2], amplitude=family.amplitudes[i % 2]
            )
            said = family.captions(params)
            assert len(said) >= 20
            for caption in said:
                request = read(caption)
                assert caption == " ".join(caption.split())
                assert request.name == name, caption
                assert request.side == side or (not side and request.side == "both"), caption
                assert (request.count or 1) == count, caption
                if family.degrees and params.amplitude != 1:
                    assert request.degrees == pytest.approx(family.degrees * params.amplitude, abs=0.51), caption
                if params.speed != 1:
                    assert request.speed is not None, caption
                    assert (request.speed > 1) == (params.speed > 1)


@pytest.mark.parametrize("name", SIDED)
def test_mirrored_captions(name: str) -> None:
    family = gestures()[name]
    right, left = (family.captions(family.params(side=side)) for side in ("right", "left"))
    assert tuple(map(swap_sides, right)) == left
    assert all("right" in (words := re.findall(r"\w+", caption)) and "left" not in words for caption in right)


def test_captions_without_sides_name_none() -> None:
    for name in set(FAMILIES) - set(SIDED):
        for caption in gestures()[name].captions(gestures()[name].params()):
            assert "left" not in caption
            assert "right" not in caption


@pytest.mark.parametrize(("text", "name", "side", "count", "degrees"), [
    ("nod twice", "nod", None, 2, None),
    ("Clap your hands five times!", "clap", None, 5, None),
    ("bow 30 degrees", "bow", None, None, 30),
    ("raise your left arm to forty-five degrees", "raise-arm", "left", None, 45),
    ("someone is waving with both hands", "wave", "both", None, None),
    ("put your hands on your hips", "hands-on-hips", None, None, None),
    ("do five squats", "squat", None, 5, None),
    ("kicking with the left leg", "kick", "left", None, None),
    ("look right", "look", "right", None, None),
    ("solve a cubic equation", None, None, None, None),
])  # fmt: skip
def test_text_is_read(text: str, name: str | None, side: str | None, count: int | None, degrees: float | None) -> None:
    request = read(text)
    assert (request.name, request.side, request.count, request.degrees) == (name, side, count, degrees)


def test_the_generator_does_what_the_text_says() -> None:
    model = load_generator("gestures")
    motion = model.generate("clap 4 times", seed=2)
    gap = np.linalg.norm(at(motion, "left_wrist") - at(motion, "right_wrist"), axis=1)
    assert excursions(-gap, -0.15, -0.22) == 4
    assert motion.labels[0].text == "clap 4 times"
    assert model.familiarity("clap 4 times").known
    assert not model.familiarity("salute twice").known
    strange = model.familiarity("solve a cubic equation")
    assert not strange.known
    assert strange.nearest


@pytest.mark.parametrize("text", ["wave", "nod three times", "bow"])
@pytest.mark.parametrize("seconds", [4.5, 8.0, 20.0])
def test_the_generator_fills_the_seconds(text: str, seconds: float) -> None:
    motion = load_generator("gestures").generate(text, seconds=seconds)
    assert motion.duration == pytest.approx(seconds, abs=0.02)


@pytest.mark.parametrize(("text", "says"), [
    ("solve a cubic equation", r"names no gesture; there are nod, "),
    ("bow 120 degrees", r"bow: amplitude 3; .*10 to 70 degrees"),
    ("nod 99 times", r"nod: count 99; 1 to 20"),
    ("sit down in one second", ""),
])  # fmt: skip
def test_texts_that_cannot_be_done(text: str, says: str) -> None:
    with pytest.raises(PromptError, match=says or "too short for sit; it takes"):
        load_generator("gestures").generate(text, seconds=None if says else 1.0)


def test_the_page_lists_every_family() -> None:
    page = (Path(__file__).parent.parent / "docs" / "gestures.md").read_text(encoding="utf-8")
    for name, family in gestures().items():
        row = next(line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
        assert all(side in row for side in family.sides)
        if family.degrees:
            low, high = (round(family.degrees * amplitude) for amplitude in family.amplitudes)
            assert f"{low}–{high}°" in row
