"""Captions for clips of known content and style: a small grammar of natural phrasings.

Every phrasing is a frame ("a person …", "can you …?", "gimme …"), an adverb or adjective and a verb phrase or noun. One
in ten, by hash, is kept out of training and used for testing only.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator

from motiongen.gestures.phrases import ASKING
from motiongen.text.words import CONTENTS, STYLES, Content

_SUBJECTS = ("a person", "someone", "the person", "a man", "a woman", "the robot", "he", "she", "the figure")
_WANTING = ("gimme {}", "give me {}", "show me {}", "let's see {}")  # of nouns with an article
_SAME_STYLE = {"masculinity": "masculine", "old": "elderly", "tired": "exhausted"}
# Whole words ("leftwards" and "counterclockwise" too), so that nobody ends up standing "upleft".
_SIDE = re.compile(r"\b(left|right|counterclockwise|clockwise)(?=(?:ward|wards|most|y)?\b)")
_OTHER_SIDE = {"left": "right", "right": "left", "clockwise": "counterclockwise", "counterclockwise": "clockwise"}
_TESTED_SHARE = 10  # one phrasing in ten is for testing only


def swap_sides(text: str) -> str:
    """`text` with left and right exchanged, for the mirrored clip."""
    return _SIDE.sub(lambda found: _OTHER_SIDE[found[1]], text)


def style_name(label: str) -> str:
    """The name under which a data set's style label stands in `STYLES`; raises ValueError for one not known."""
    name = _SAME_STYLE.get(label, label)
    if name not in STYLES:
        raise ValueError(f"unknown style {label!r}; known are {', '.join(STYLES)}")
    return name


def phrasings(content: str, style: str = "normal") -> tuple[str, ...]:
    """All captions of a content in a style, in a fixed order; raises ValueError for names not known."""
    if content not in CONTENTS:
        raise ValueError(f"unknown content {content!r}; known are {', '.join(CONTENTS)}")
    what, (adverbs, adjectives) = CONTENTS[content], STYLES[style_name(style)]
    said = (*_told(what, adverbs, adjectives), *_asked(what, adverbs), *_named(what, adverbs))
    return tuple(dict.fromkeys(said))


def _told(what: Content, adverbs: tuple[str, ...], adjectives: tuple[str, ...]) -> Iterator[str]:
    """In the third person."""
    for verb in what.third:
        for adjective in filter(None, adjectives):
            article = "an" if adjective[0] in "aeiou" else "a"
            yield f"{article} {adjective} person {verb}"
            yield f"{article} {adjective} figure {verb}"
        for adverb in adverbs:
            yield from (f"{subject} {verb} {adverb}".strip() for subject in _SUBJECTS)


def _asked(what: Content, adverbs: tuple[str, ...]) -> Iterator[str]:
    """As people ask for it, politely and less so."""
    for verb in what.plain:
        for adverb in adverbs:
            yield from (frame.format(f"{verb} {adverb}".strip()) for frame in ASKING)
            yield f"make the robot {verb} {adverb}".strip().replace(" your ", " its ")


def _named(what: Content, adverbs: tuple[str, ...]) -> Iterator[str]:
    """By a noun: "a wave happily", "gimme a wave happily"."""
    for noun in what.nouns:
        frames = ("{}", *_WANTING) if re.match("an? ", noun) else ("{}",)
        for adverb in adverbs:
            yield from (frame.format(f"{noun} {adverb}".strip()) for frame in frames)


def kept_for_testing(caption: str) -> bool:
    """Whether a caption is of the tenth that no model is trained on. A caption and its mirror image go together."""
    key = min(caption, swap_sides(caption))
    return int.from_bytes(hashlib.sha256(key.encode()).digest()[:4], "little") % _TESTED_SHARE == 0
