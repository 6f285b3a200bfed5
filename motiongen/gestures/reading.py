"""What gesture a text asks for, by plain rules: names of gestures, sides, numbers, degrees, fast and slow.

Each gesture has keywords, sets of words. A set counts where all its words are in the text, and the more the fewer
gestures share them; the gesture with the best set is the one that is meant, or of equals the one named first.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass

from motiongen.gestures.catalogue import gestures
from motiongen.gestures.phrases import NUMBERS

_FACTORS = {
    "speed": {
        0.7: ("slow", "slowly", "gently", "calmly", "leisurely"),
        1.4: ("fast", "quick", "quickly", "rapidly", "briskly", "hastily"),
    },
    "amplitude": {
        0.7: ("slightly", "little", "small", "subtly", "bit"),
        1.3: ("widely", "wide", "large", "big", "deeply", "deep", "high"),
    },
}
_TENS = ("twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
_TEENS = ("eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen")
_VALUES = (
    {word: i for i, word in enumerate(NUMBERS) if i}
    | {word: 11 + i for i, word in enumerate(_TEENS)}
    | {word: 20 + 10 * i for i, word in enumerate(_TENS)}
)
_ANGLE = r"(\d+(?:\.\d+)?) ?(?:degrees?\b|deg\b|°)"
_NAMED_ANGLES = (  # of turns, the first that is found
    (r"\beighth", 45), (r"\b(?:3|three)[- ]quarter", 270), (r"\bquarter", 90),
    (r"\bfull (?:turn|circle)|\ball the way (?:a?round)|\bspin\w* a?round|\bcomplete turn", 360),
    (r"\bhalf (?:left|right)\b", 45), (r"\bhalf\b|\ba?round\b|\babout[- ]face|\bother way\b", 180),
)  # fmt: skip
_TIMES = (
    r"\b(\d+) (?:more )?(?:times|steps?|bars?|squats?|jumps?|claps?|nods?|bows?|kicks?|punch(?:es)?|waves?|shrugs?)\b"
)


@dataclass(frozen=True)
class Request:
    """What a text asks for; what it says nothing of is None. `name` is None where no gesture is named.

    `nearest`: names of gestures, best first. `speed` and `amplitude` are factors of the usual.
    """

    name: str | None
    nearest: tuple[str, ...]
    side: str | None
    count: int | None
    degrees: float | None
    speed: float | None
    amplitude: float | None


def read(text: str) -> Request:
    """What `text` asks for, in English, in any wording that has a keyword of a gesture in it."""
    said = _with_digits(text.lower().replace(" for me", ""))
    words = re.findall(r"[a-z]+", said)
    ranked = _ranked(words)
    return Request(
        name=ranked[0] if ranked else None,
        nearest=tuple(ranked[:3]) or _USUAL,
        side=_side(words),
        count=_count(said),
        degrees=_degrees(said, turning=ranked[:1] == ["turn"]),
        speed=_factor(words, "speed"),
        amplitude=_factor(words, "amplitude"),
    )


def stem(word: str) -> str:
    """A word without its ending, so that "nods", "nodding" and "nod" are one; no English word of its own."""
    for ending in ("ing", "ed", "es", "s"):
        if word.endswith(ending) and len(word) > len(ending) + 2:
            word = word.removesuffix(ending)
            break
    word = word.rstrip("e") if len(word) > 3 else word
    return word[:-1] if len(word) > 3 and word[-1] == word[-2] else word


_KEYWORDS = {name: [tuple(map(stem, key.split())) for key in g.keywords] for name, g in gestures().items()}
_SHARED = Counter(word for keys in _KEYWORDS.values() for word in {w for key in keys for w in key})
_USUAL = ("wave", "nod", "bow")


def _ranked(words: list[str]) -> list[str]:
    """Names of the gestures that have a keyword in `words`, best first."""
    first = {stem(word): i for i, word in reversed(list(enumerate(words)))}
    scores = []
    for name, keys in _KEYWORDS.items():
        found = [key for key in keys if all(word in first for word in key)]
        if found:
            score = max(sum(1 / _SHARED[word] for word in key) for key in found)
            scores.append((-score, min(first[word] for key in found for word in key), name))
    return [name for *_, name in sorted(scores)]


def _with_digits(text: str) -> str:
    """Number words as digits: "forty-five" → "45", "one hundred twenty" → "120"."""
    tens = "|".join(_TENS)
    text = re.sub(rf"\b({tens})[- ]({'|'.join(NUMBERS[1:10])})\b", lambda m: str(_VALUES[m[1]] + _VALUES[m[2]]), text)
    text = re.sub(r"\b[a-z]+\b", lambda m: str(_VALUES.get(m[0], m[0])), text)
    return re.sub(
        r"\b([1-9]) hundred\b(?:(?: and)? (\d{1,2})\b)?", lambda m: str(100 * int(m[1]) + int(m[2] or 0)), text
    )


def _side(words: list[str]) -> str | None:
    if "both" in words:
        return "both"
    return next((word for word in words if word in ("left", "right")), None)


def _count(said: str) -> int | None:
    if re.search(r"\btwice\b", said):
        return 2
    if re.search(r"\bonce\b|\ba step\b", said):
        return 1
    found = re.search(_TIMES, said)
    return int(found[1]) if found else None


def _degrees(said: str, *, turning: bool) -> float | None:
    """The number of degrees, or, of a turn, the angle that its name says."""
    if angle := re.search(_ANGLE, said):
        return float(angle[1])
    named = _NAMED_ANGLES if turning else ()
    return next((float(degrees) for pattern, degrees in named if re.search(pattern, said)), None)


def _factor(words: list[str], what: str) -> float | None:
    return next((factor for factor, names in _FACTORS[what].items() if set(names) & set(words)), None)
