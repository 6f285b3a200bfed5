"""Captions of composed clips, out of those of their parts: "walks" and "waves the right hand" make "a person waves the
right hand while walking"; "walks" and "bows" make "a person walks, then bows".
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

from motiongen.gestures.phrases import ASKING, third_person

_SUBJECTS = ("a person", "someone", "the person", "the robot", "he", "she")
MOST_PHRASES = 5  # of a part, in the grammar of a combination: their product is hundreds
# "walks and turns left" cannot be joined with "and then" and still be understood.
_MANIFOLD = re.compile(r"\b(and|then|while|after|before|now)\b|,|^(is|are) ")
_THIRD = re.compile(r"(?:an? (?:[\w-]+ )*(?:person|man|woman|figure|robot)|someone|the \w+|he|she|they) (\w+s .+|\w+s)")
_ASKED = [
    re.compile(re.escape(frame.rstrip("?!")).replace(r"\{\}", "(.+)")) for frame in ASKING if frame.rstrip("?!") != "{}"
]
_NO_DOING = re.compile(r"(keep|go) \w+ing\b|be ")
_DOUBLED = (
    "bid", "clap", "cup", "flap", "get", "hit", "hop", "hug", "jog", "nod", "put", "rub", "run", "shrug", "sidestep",
    "signal", "sit", "spin", "squat", "step", "stop", "swim", "tap", "tip",
)  # fmt: skip


@dataclass(frozen=True)
class Phrases:
    """Verb phrases for one part: `third` ("waves the hand") and `plain` ("wave the hand")."""

    third: tuple[str, ...]
    plain: tuple[str, ...]


def phrases_of(captions: Iterable[str]) -> Phrases:
    """The verb phrases in `captions` that can be joined with others, at most 5 of a kind, each once.

    Raises ValueError where there is none.
    """
    captions = tuple(caption.rstrip("?!") for caption in captions)
    third = [found[1] for caption in captions if (found := _THIRD.fullmatch(caption))]
    plain = [found[1] for caption in captions for frame in _ASKED if (found := frame.fullmatch(caption))]
    third += [third_person(re.sub(r"^\w+", lambda verb: f"[{verb[0]}]", said)) for said in plain]
    phrases = Phrases(*(_simple(said) for said in (third, plain)))
    if not phrases.third:
        raise ValueError(f"no phrase to join with others in captions such as {captions[0] if captions else ''!r}")
    return phrases


def at_once(lower: Phrases, upper: Phrases) -> tuple[str, ...]:
    """Captions of two actions at the same time, each once: third person, imperative and casual."""
    out = []
    for walks, waves in product(lower.third, upper.third):
        out += [f"{subject} {walks} and {waves}" for subject in _SUBJECTS]
        out += [f"{subject} {walks} and {waves} at the same time" for subject in _SUBJECTS[:2]]
    for waves, walk in product(upper.third, _doable(lower)):
        out += [f"{subject} {waves} while {doing(walk)}" for subject in _SUBJECTS]
    for walks, wave in product(lower.third, _doable(upper)):
        out += [f"{subject} {walks} while {doing(wave)}" for subject in _SUBJECTS]
    for walk, wave in product(_doable(lower), _doable(upper)):
        wave_now, walk_now = doing(wave), doing(walk)
        out += [f"{wave} while {walk_now}", f"please {wave} while {walk_now}", f"can you {wave} while {walk_now}"]
        out += [f"{walk} and {wave}", f"please {walk} and {wave}", f"{walk} while {wave_now}", f"{wave} as you {walk}"]
        out += [f"{wave_now} while {walk_now}", f"{walk_now} and {wave_now}"]
    return tuple(dict.fromkeys(out))


def one_after_another(parts: Sequence[Phrases]) -> tuple[str, ...]:
    """Captions of two or more actions one after another, each once: third person, imperative and casual."""
    out = []
    for said in product(*(part.third for part in parts)):
        for joint in _joined(said):
            out += [f"{subject} {joint}" for subject in _SUBJECTS]
    for said in product(*(part.plain for part in parts)):
        for joint in _joined(said):
            out += [joint, f"please {joint}", f"can you {joint}"]
    if len(parts) == 2:
        first, second = parts
        for walk, bows in product(_doable(first), second.third):
            out += [f"after {doing(walk)}, {subject} {bows}" for subject in _SUBJECTS]
            out += [f"{subject} {bows} after {doing(walk)}" for subject in _SUBJECTS]
        for walk, bow in product(_doable(first), second.plain):
            out += [f"{bow} after {doing(walk)}"]
    return tuple(dict.fromkeys(out))


def doing(plain: str) -> str:
    """ "wave your hand" → "waving their hand": the verb at the start as a participle."""
    verb, space, rest = plain.partition(" ")
    if verb in _DOUBLED:
        stem = verb + verb[-1]
    elif verb.endswith("ie"):
        stem = verb[:-2] + "y"
    else:
        stem = verb[:-1] if re.search(r"[^eo]e$", verb) else verb
    return third_person(f"{stem}ing{space}{rest}")


def _simple(said: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(phrase for phrase in said if not _MANIFOLD.search(phrase)))[:MOST_PHRASES]


def _doable(phrases: Phrases) -> tuple[str, ...]:
    return tuple(phrase for phrase in phrases.plain if not _NO_DOING.match(phrase))


def _joined(said: Sequence[str]) -> list[str]:
    """ "walks, then bows", "first walks and then bows", …; of three, "walks, then bows and finally waves"."""
    if len(said) == 2:
        a, b = said
        return [f"{a}, then {b}", f"{a} and then {b}", f"first {a} and then {b}", f"first {a}, then {b}"]
    *most, last = said
    before = ", then ".join(most)
    return [f"{before}, then {last}", f"{before} and finally {last}", f"first {before} and finally {last}"]
