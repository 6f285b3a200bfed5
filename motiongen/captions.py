"""Captions for clips of known content and style: a small grammar of natural phrasings.

Every phrasing is a template, an adverb or adjective and a verb phrase. One in ten, by hash, is kept out of training and
used for testing only.
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Content:
    """How people name an action: third person ("waves …") and imperative ("wave …") verb phrases in step, and nouns."""

    third: tuple[str, ...]
    plain: tuple[str, ...]
    nouns: tuple[str, ...] = ()


def _hand(side: str) -> Content:
    """Who just says "wave" means the right hand."""
    return Content(
        third=(
            f"waves with the {side} hand", f"waves the {side} hand", f"is waving their {side} hand",
            f"waves hello with the {side} hand", f"lifts the {side} arm and waves",
            f"greets someone by waving the {side} hand", f"waves using the {side} arm",
            *(("waves", "waves hello", "says hello", "waves at someone") if side == "right" else ()),
        ),
        plain=(
            f"wave with the {side} hand", f"wave the {side} hand", f"wave your {side} hand",
            f"wave hello with the {side} hand", f"lift the {side} arm and wave",
            f"greet me by waving your {side} hand", f"wave using the {side} arm",
            *(("wave", "wave hello", "say hello", "wave at me") if side == "right" else ()),
        ),
        nouns=(f"a wave with the {side} hand", f"{side} hand waving", f"{side} hand wave"),
    )  # fmt: skip


def _raise(side: str) -> Content:
    return Content(
        third=(
            f"raises the {side} hand", f"lifts up the {side} hand", f"puts the {side} hand up",
            f"raises the {side} arm in the air", f"is raising their {side} hand once",
            f"holds up the {side} hand", f"raises the {side} hand like a pupil in class",
            *(("raises a hand", "puts one hand up") if side == "right" else ()),
        ),
        plain=(
            f"raise the {side} hand", f"lift up the {side} hand", f"put your {side} hand up",
            f"raise the {side} arm in the air", f"raise your {side} hand once",
            f"hold up the {side} hand", f"raise the {side} hand like a pupil in class",
            *(("raise a hand", "put one hand up") if side == "right" else ()),
        ),
        nouns=(f"{side} hand up", f"a raised {side} hand"),
    )  # fmt: skip


def _sidestep(side: str) -> Content:
    return Content(
        third=(
            f"walks sideways to the {side}", f"sidesteps to the {side}", f"steps sideways to the {side}",
            f"walks to the {side} without turning", f"moves sideways to the {side}", f"shuffles to the {side}",
        ),
        plain=(
            f"walk sideways to the {side}", f"sidestep to the {side}", f"step sideways to the {side}",
            f"walk to the {side} without turning", f"move sideways to the {side}", f"shuffle to the {side}",
        ),
        nouns=(f"a sidestep to the {side}", f"sidestepping {side}"),
    )  # fmt: skip


def _turn(side: str) -> Content:
    return Content(
        third=(
            f"walks and turns {side}", f"walks forward and turns to the {side}", f"turns {side} while walking",
            f"walks around a corner to the {side}", f"takes a {side} turn", f"walks then turns to the {side}",
            f"walks in a curve to the {side}",
        ),
        plain=(
            f"walk and turn {side}", f"walk forward and turn to the {side}", f"turn {side} while walking",
            f"walk around a corner to the {side}", f"take a {side} turn", f"walk then turn to the {side}",
            f"walk in a curve to the {side}",
        ),
        nouns=(f"a walk with a {side} turn", f"a {side} turn", f"turning {side}"),
    )  # fmt: skip


CONTENTS: dict[str, Content] = {
    "walk": Content(
        ("walks", "walks forward", "is walking", "walks straight ahead", "strolls along", "takes a walk",
         "steps forward", "goes for a walk"),
        ("walk", "walk forward", "keep walking", "walk straight ahead", "stroll along", "take a walk",
         "step forward", "go for a walk"),
        ("walking", "a walk", "walking forward"),
    ),
    "run": Content(
        ("runs", "runs forward", "is running", "jogs", "goes jogging", "jogs forward", "runs along"),
        ("run", "run forward", "keep running", "jog", "go jogging", "jog forward", "run along"),
        ("running", "a run", "jogging"),
    ),
    "dash": Content(
        ("dashes", "sprints", "dashes forward", "sprints forward", "runs at full speed", "rushes ahead", "bolts"),
        ("dash", "sprint", "dash forward", "sprint forward", "run at full speed", "rush ahead", "bolt"),
        ("a dash", "sprinting", "a sprint"),
    ),
    "walk-back": Content(
        ("walks backwards", "steps back", "walks back", "backs away", "retreats", "moves backwards"),
        ("walk backwards", "step back", "walk back", "back away", "retreat", "move backwards"),
        ("walking backwards", "a backward walk"),
    ),
    "walk-left": _sidestep("left"),
    "walk-right": _sidestep("right"),
    "walk-turn-left": _turn("left"),
    "walk-turn-right": _turn("right"),
    "wave-left-hand": _hand("left"),
    "wave-right-hand": _hand("right"),
    "wave-both-hands": Content(
        ("waves both hands", "waves with both hands", "is waving both arms", "waves both hands in the air",
         "greets someone by waving both hands", "lifts both arms and waves"),
        ("wave both hands", "wave with both hands", "wave both your arms", "wave both hands in the air",
         "greet me by waving both hands", "lift both arms and wave"),
        ("waving with both hands", "a two-handed wave", "both hands waving"),
    ),
    "raise-up-left-hand": _raise("left"),
    "raise-up-right-hand": _raise("right"),
    "raise-up-both-hands": Content(
        ("raises both hands", "lifts up both hands", "puts both hands up", "raises both arms in the air",
         "throws both hands up", "holds up both hands", "raises the arms overhead"),
        ("raise both hands", "lift up both hands", "put both your hands up", "raise both arms in the air",
         "throw both hands up", "hold up both hands", "raise the arms overhead"),
        ("both hands up", "hands up", "arms up"),
    ),
    "bow": Content(
        ("bows", "takes a bow", "bows down", "bows politely at the waist", "bends forward in a bow",
         "makes a deep bow", "bows to greet"),
        ("bow", "take a bow", "bow down", "bow politely at the waist", "bend forward in a bow", "make a deep bow",
         "bow to greet"),
        ("a bow", "bowing"),
    ),
    "bye": Content(
        ("says goodbye", "says farewell", "waves goodbye", "says goodbye and leaves", "bids farewell",
         "gestures goodbye"),
        ("say goodbye", "say farewell", "wave goodbye", "say goodbye and leave", "bid farewell", "gesture goodbye"),
        ("a goodbye", "a farewell", "goodbye"),
    ),
    "byebye": Content(
        ("says bye-bye", "waves bye-bye", "waves bye bye to a friend", "says bye bye", "does a bye-bye wave"),
        ("say bye-bye", "wave bye-bye", "wave bye bye to a friend", "say bye bye", "do a bye-bye wave"),
        ("bye-bye", "a bye-bye wave", "bye bye"),
    ),
    "guide": Content(
        ("guides someone", "shows the way", "gestures this way please", "leads a guest along",
         "points out the way with an open hand", "guides a visitor", "invites someone to come along"),
        ("guide someone", "show the way", "gesture this way please", "lead a guest along",
         "point out the way with an open hand", "guide a visitor", "invite someone to come along"),
        ("guiding", "a guiding gesture", "showing the way"),
    ),
    "call": Content(
        ("calls someone over", "calls out to someone", "beckons", "calls a friend with a gesture"),
        ("call someone over", "call out to someone", "beckon", "call a friend with a gesture"),
    ),
    "respond": Content(
        ("responds to a call", "answers someone's call", "reacts to someone"),
        ("respond to a call", "answer someone's call", "react to someone"),
    ),
    "kick": Content(
        ("kicks", "throws a kick", "kicks with the leg", "does a fighting kick"),
        ("kick", "throw a kick", "kick with the leg", "do a fighting kick"),
        ("a kick", "kicking"),
    ),
    "punch": Content(
        ("punches", "throws a punch", "boxes", "hits with the fist"),
        ("punch", "throw a punch", "box", "hit with the fist"),
        ("a punch", "punching"),
    ),
    "slash": Content(
        ("slashes with a sword", "swings a sword", "makes a slashing attack"),
        ("slash with a sword", "swing a sword", "make a slashing attack"),
        ("a sword slash", "slashing"),
    ),
    "dance-short": Content(
        ("dances", "is dancing", "does a dance", "dances to music"),
        ("dance", "keep dancing", "do a dance", "dance to music"),
        ("a dance", "dancing"),
    ),
}  # fmt: skip

# Style → (adverbs, adjectives for "a … person"). An empty string is "say nothing of it".
STYLES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "normal": (("", "", "normally", "at a normal pace"), ("", "")),
    "active": (("actively", "energetically", "with energy", "briskly"), ("energetic", "active", "lively")),
    "elderly": (("like an old person", "slowly with age"), ("old", "elderly", "frail old")),
    "exhausted": (("exhaustedly", "wearily", "as if exhausted"), ("exhausted", "tired", "worn-out")),
    "feminine": (("in a feminine way", "gracefully"), ("feminine",)),
    "masculine": (("in a masculine way", "like a tough man"), ("masculine", "manly")),
    "youthful": (("youthfully", "like a young person"), ("young", "youthful")),
    "angry": (("angrily", "in anger"), ("angry", "furious")),
    "childish": (("childishly", "like a child"), ("childish", "childlike")),
    "chimpira": (("like a thug", "with a swagger"), ("thuggish", "cocky")),
    "giant": (("like a giant", "heavily"), ("giant", "huge")),
    "happy": (("happily", "cheerfully", "joyfully"), ("happy", "cheerful")),
    "musical": (("as in a musical", "theatrically"), ("theatrical",)),
    "not-confident": (("timidly", "without confidence", "shyly"), ("timid", "shy", "insecure")),
    "proud": (("proudly", "with pride"), ("proud", "confident")),
    "sad": (("sadly", "in a sad way"), ("sad", "unhappy")),
}
_SAME_STYLE = {"masculinity": "masculine", "old": "elderly", "tired": "exhausted"}

_SUBJECTS = ("a person", "someone", "the person", "a man", "a woman", "the robot", "he", "she", "the figure")
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
    out: list[str] = []
    for verb in what.third:
        for adjective in adjectives:
            if adjective:
                article = "an" if adjective[0] in "aeiou" else "a"
                out += [f"{article} {adjective} person {verb}", f"{article} {adjective} figure {verb}"]
        for adverb in adverbs:
            out += [f"{subject} {verb} {adverb}".strip() for subject in _SUBJECTS]
    for verb in what.plain:
        for adverb in adverbs:
            out += [f"{verb} {adverb}".strip(), f"please {verb} {adverb}".strip()]
    for noun in what.nouns:
        out += [f"{noun} {adverb}".strip() for adverb in adverbs]
    return tuple(dict.fromkeys(out))


def kept_for_testing(caption: str) -> bool:
    """Whether a caption is of the tenth that no model is trained on. A caption and its mirror image go together."""
    key = min(caption, swap_sides(caption))
    return int.from_bytes(hashlib.sha256(key.encode()).digest()[:4], "little") % _TESTED_SHARE == 0
