"""The grammar of captions: a verb phrase, conjugated, in a frame, with what is not as usual said after it.

A verb phrase has its verb in brackets: "[raise] the right arm and [hold] it".
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import product

_SUBJECTS = ("a person", "someone", "the robot", "he", "she")
ASKING = (
    "{}", "please {}", "now {}", "can you {}?", "{} for me", "{}!", "could you {}", "would you {}?", "try to {}",
    "I'd like you to {}", "ok, {}", "and now {}", "you should {}", "{} if you can", "do this: {}",
)  # fmt: skip
NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
SLOW, FAST = 0.9, 1.1  # factors from which a speed is worth saying
SMALL, LARGE = 0.85, 1.15


@dataclass(frozen=True)
class Said:
    """What a caption may have to say; `degrees` and `count` are 0 where the gesture has no such thing, and the `usual`
    count needs no word."""

    degrees: int
    preposition: str
    count: int
    usual: int
    unit: str
    speed: float
    amplitude: float


def captions(verbs: tuple[str, ...], said: Said) -> tuple[str, ...]:
    """Every verb phrase in every frame with every way to say the rest, in a fixed order, each once.

    Where a verb phrase has a place for `{steps}` the count is said there, elsewhere behind it.
    """
    out = []
    told = [
        (verb.replace("{steps}", steps), count)
        for verb in verbs
        for steps, count in ([(s, "") for s in _steps(said)] if "{steps}" in verb else [("", c) for c in _counts(said)])
    ]
    for (verb, count), angle, size, speed in product(told, _angles(said), _sizes(said), _speeds(said)):
        tail = " ".join(word for word in (angle, count, size, speed) if word)
        out += [f"{subject} {third_person(verb)} {tail}".strip() for subject in _SUBJECTS]
        out += [frame.format(f"{plain(verb)} {tail}".strip()) for frame in ASKING]
    return tuple(dict.fromkeys(out))


def third_person(phrase: str) -> str:
    """ "[raise] the arm and [hold] it" → "raises the arm and holds it"; "my" and "your" become "their"."""
    said = re.sub(r"\[(\w+)\]", lambda found: _conjugated(found[1]), phrase)
    return re.sub(r"\b(my|your)\b", "their", said)


def plain(phrase: str) -> str:
    """ "[raise] the arm" → "raise the arm"."""
    return re.sub(r"\[(\w+)\]", r"\1", phrase)


def _conjugated(verb: str) -> str:
    if re.search(r"(ch|sh|s|x|z|o)$", verb):
        return verb + "es"
    return re.sub(r"([^aeiou])y$", r"\1ie", verb) + "s"


def _angles(said: Said) -> tuple[str, ...]:
    if not said.degrees:
        return ("",)
    exact = (f"{said.preposition} {said.degrees} degrees", f"{said.preposition} about {said.degrees} degrees")
    return exact if not SMALL < said.amplitude < LARGE else ("", *exact)


def _counts(said: Said) -> tuple[str, ...]:
    if not said.count:
        return ("",)
    unit = said.unit or "times"
    word = f"{NUMBERS[said.count]} {unit}" if said.count < len(NUMBERS) else f"{said.count} {unit}"
    words = {"two times": "twice", "one times": "once"}.get(word, word), f"{said.count} {unit}"
    exact = words if said.count > 1 else words[:1] if not said.unit else (f"one {unit.removesuffix('s')}",)
    return exact if said.count != said.usual else ("", *exact)


def _steps(said: Said) -> tuple[str, ...]:
    if said.count == 1:
        return ("a step", "one step")
    return (*((f"{NUMBERS[said.count]} steps",) if said.count < len(NUMBERS) else ()), f"{said.count} steps")


def _sizes(said: Said) -> tuple[str, ...]:
    if said.degrees or SMALL < said.amplitude < LARGE:
        return ("",)
    return ("slightly", "a little") if said.amplitude < 1 else ("widely", "with large movements")


def _speeds(said: Said) -> tuple[str, ...]:
    if SLOW < said.speed < FAST:
        return ("",)
    return ("slowly", "at a slow pace") if said.speed < 1 else ("quickly", "fast")
