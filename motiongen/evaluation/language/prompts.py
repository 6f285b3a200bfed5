"""What the language tests ask for: a fixed list of prompts by category, each with what a motion must show.

No prompt was trained on: contents are asked for with the captions that the grammars keep for testing, everything else
in hand-written frames that no grammar has.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from motiongen.evaluation.language.scope import OUT_OF_SCOPE
from motiongen.gestures.catalogue import gestures
from motiongen.text.captions import CONTENTS, kept_for_testing, phrasings
from motiongen.text.claims import Asked, Claim, Pace, Side
from motiongen.text.say_numbers import in_words

STYLES = ("active", "elderly", "exhausted", "feminine", "masculine", "youthful")  # those with enough motion capture
RARE = ("call", "respond", "kick", "punch", "slash", "dance-short")  # one or two clips each
_FRAMES = ("{}, please", "go ahead and {}", "I want you to {}", "let's see you {}", "could you {} now", "just {}")
_SIDES: tuple[Side, ...] = ("left", "right")
_PACES: tuple[tuple[Pace, str], ...] = (
    ("slow", "slowly"), ("slow", "very slowly"), ("quick", "quickly"), ("quick", "fast"),
)  # fmt: skip


@dataclass(frozen=True)
class Prompt:
    """One test. `asked` is measured in the motion; `content` and `style` are what classifiers must find in it; `known`
    says whether the generator is to take the text for one that it knows. What is None or "" is not tested."""

    text: str
    category: str
    asked: Asked | None = None
    content: str = ""
    style: str = ""
    known: bool | None = None


def family(content: str) -> str:
    """What a content is told apart by: sides are measured, and a goodbye or a hello is a wave."""
    if content.startswith(("wave", "bye")):
        return "wave"
    if content.startswith(("raise-up", "raise-arm")):
        return "raise-arm"
    if content.startswith("walk-turn"):
        return "walk-turn"
    return {"walk-left": "walk-aside", "walk-right": "walk-aside", "dash": "run", "call": "beckon"}.get(
        content, content
    )


def prompts(each: int, seed: int = 0) -> tuple[Prompt, ...]:
    """`each` prompts of every category, shuffled; where a category has fewer texts they come again, to be drawn from
    other seeds. The same arguments give the same prompts."""
    rng = np.random.default_rng(seed)
    chosen: list[Prompt] = []
    for build in CATEGORIES.values():
        every = list(build())
        rounds = [every[i] for _ in range(each // len(every) + 1) for i in rng.permutation(len(every))]
        chosen += rounds[:each]
    return tuple(chosen)


def _framed(category: str, cases: Iterator[tuple[str, Asked]]) -> Iterator[Prompt]:
    """Every case in every frame."""
    for (text, asked), frame in product(cases, _FRAMES):
        yield Prompt(frame.format(text), category, asked)


def _one(claim: Claim) -> Asked:
    return Asked((claim,))


def _mocap() -> Iterator[Prompt]:
    """Contents of the motion capture, in captions that are kept for testing and in a user's words; equally often."""
    for content in CONTENTS:
        if content in RARE:
            continue
        said = [caption for caption in phrasings(content) if kept_for_testing(caption)][:8]
        for text in (*said, *_USERS.get(content, ())):
            yield Prompt(text, "content: motion capture", _side_of(content), family(content))


def _side_of(content: str) -> Asked | None:
    side: Side = "left" if "left" in content else "right"
    if content.endswith("-hand"):
        return _one(Claim("hand", side))
    if content.startswith("walk-turn"):
        return _one(Claim("turn", side))
    return _one(Claim("aside", side)) if content in ("walk-left", "walk-right") else None


_USERS = {
    "walk": ("go straight on", "take a stroll", "start walking"),
    "run": ("go for a jog", "start running", "jog ahead"),
    "dash": ("sprint as fast as you can", "run for your life"),
    "walk-back": ("walk in reverse", "take some steps back", "go backwards"),
    "walk-left": ("sidestep left", "move over to your left"),
    "walk-right": ("sidestep right", "move over to your right"),
    "walk-turn-left": ("walk round the corner on your left", "walk and then go left"),
    "walk-turn-right": ("walk round the corner on your right", "walk and then go right"),
    "wave-left-hand": ("give me a wave with your left", "say hi with your left hand", "wave left-handed"),
    "wave-right-hand": ("give me a wave with your right", "say hi with your right hand", "wave right-handed"),
    "wave-both-hands": ("wave at them with your two hands", "wave like crazy with both arms"),
    "raise-up-left-hand": ("stick your left hand up", "left hand in the air"),
    "raise-up-right-hand": ("stick your right hand up", "right hand in the air"),
    "raise-up-both-hands": ("put your hands in the air", "stick both arms up"),
    "bow": ("give a polite bow", "bow to the audience"),
    "bye": ("wave someone off", "say your goodbyes"),
    "byebye": ("bye bye", "wave bye-bye to the kids"),
    "guide": ("show the visitor where to go", "usher the guest in"),
}


def _gestures() -> Iterator[Prompt]:
    """Gestures as they usually are, in captions that are kept for testing, equally many of each."""
    for name, gesture in gestures().items():
        kept = [caption for caption in gesture.captions(gesture.params()) if kept_for_testing(caption)]
        for caption in kept[:4]:
            yield Prompt(caption, "content: gestures", content=family(name))


def _sides() -> Iterator[tuple[str, Asked]]:
    for side in _SIDES:
        for text, action in (
            ("wave with the {} hand", "wave"), ("wave your {} hand", "wave"), ("raise the {} hand", "raise"),
            ("put your {} arm up", "raise"), ("turn {}", "turn"), ("turn to the {}", "turn"),
            ("sidestep to the {}", "aside"), ("walk sideways to the {}", "aside"), ("kick with the {} leg", "leg"),
            ("lift your {} knee", "leg"), ("salute with your {} hand", "hand"), ("point up with the {} hand", "hand"),
            ("put your {} hand on your heart", "hand"), ("beckon with the {} hand", "hand"),
            ("listen with your {} hand at the ear", "hand"), ("say hello with the {} hand", "wave"),
            ("balance on one leg, the {} foot up", "leg"),
        ):  # fmt: skip
            yield text.format(side), _one(Claim(action, side))


def _counts() -> Iterator[tuple[str, Asked]]:
    """One to five, equally often."""
    for count in range(1, 6):
        often = {1: "once", 2: "twice"}.get(count, f"{in_words(count)} times")
        for text, action in (
            ("nod {}", "nod"), ("nod your head {}", "nod"), ("shake your head {}", "shake"), ("clap {}", "clap"),
            ("clap your hands {}", "clap"), ("squat {}", "squat"), ("jump {}", "jump"), ("bow {}", "bow"),
        ):  # fmt: skip
            yield text.format(often), _one(Claim(action, count=count))
        for side in _SIDES:
            yield f"wave {often} with the {side} hand", _one(Claim("wave", side, count))
        steps = f"{in_words(count)} step{'s' if count > 1 else ''}"
        for text in ("take {}", "walk {} forward"):
            yield text.format(steps), _one(Claim("step", count=count))


def _degrees() -> Iterator[tuple[str, Asked]]:
    """A third each: turns, bows, arms."""
    for side, degrees in product(_SIDES, (45, 60, 90, 120, 135, 180)):
        for text in ("turn {side} {d} degrees", "turn {d} degrees to the {side}"):
            yield text.format(side=side, d=in_words(degrees)), _one(Claim("turn", side, degrees=degrees))
    for degrees, text in product(
        (20, 30, 40, 45, 50, 60), ("bow {} degrees", "bow by {} degrees", "bow down {} degrees")
    ):
        yield text.format(in_words(degrees)), _one(Claim("bow", degrees=degrees))
    for side, degrees in product(_SIDES, (45, 60, 75, 90, 105, 120, 135, 150)):
        said = f"raise the {side} arm to {in_words(degrees)} degrees"
        yield said, _one(Claim("arm", side, degrees=degrees))


def _speeds() -> Iterator[tuple[str, Asked]]:
    for (pace, adverb), (text, action) in product(
        _PACES,
        (("wave", "wave"), ("nod your head", "nod"), ("shake your head", "shake"), ("clap your hands", "clap"),
         ("bow", "bow"), ("squat", "squat"), ("walk", "walk"), ("walk straight ahead", "walk"), ("run", "run")),
    ):  # fmt: skip
        yield f"{text} {adverb}", _one(Claim(action, pace=pace))


def _styles() -> Iterator[Prompt]:
    for content, style in product(("walk", "run", "wave-left-hand", "wave-right-hand", "raise-up-both-hands"), STYLES):
        for caption in [each for each in phrasings(content, style) if kept_for_testing(each)][:7]:
            yield Prompt(caption, "style", content=family(content), style=style)


def _together() -> Iterator[tuple[str, Asked]]:
    """An upper body on a lower one; none of these was captured, and no grammar says them so."""
    going = (("walk", "walk"), ("march in place", "step"), ("take some steps", "step"), ("squat", "squat"))
    doing = [("nod your head", Claim("nod")), ("clap your hands", Claim("clap")), ("shake your head", Claim("shake"))]
    for side in _SIDES:
        doing += [(f"wave your {side} hand", Claim("wave", side)), (f"raise the {side} arm", Claim("raise", side))]
    for (below, action), (above, claim) in product(going, doing):
        yield f"{below} and {above} at the same time", Asked((Claim(action), claim), "while")
        yield f"{above} and meanwhile {below}", Asked((claim, Claim(action)), "while")


def _sequences() -> Iterator[tuple[str, Asked]]:
    parts = [
        ("bow", Claim("bow")), ("nod twice", Claim("nod", count=2)), ("clap three times", Claim("clap", count=3)),
        ("squat", Claim("squat")), ("jump once", Claim("jump", count=1)), ("shake your head", Claim("shake")),
        ("wave with the right hand", Claim("wave", "right")), ("wave with the left hand", Claim("wave", "left")),
        ("raise the left hand", Claim("raise", "left")), ("walk", Claim("walk")), ("turn left", Claim("turn", "left")),
    ]  # fmt: skip
    for (first, one), (second, other) in product(parts, parts):
        if one.action != other.action:
            yield f"{first}, then {second}", Asked((one, other), "then")


def _out_of_scope() -> Iterator[Prompt]:
    for text in OUT_OF_SCOPE:
        yield Prompt(text, "out of scope: warned", known=False)


def _in_scope() -> Iterator[Prompt]:
    """The captions of both contents: is any of them taken for unknown?"""
    for prompt in (*_mocap(), *_gestures()):
        yield Prompt(prompt.text, "in scope: not warned", known=True)


CATEGORIES: dict[str, Callable[[], Iterator[Prompt]]] = {
    "content: motion capture": _mocap,
    "content: gestures": _gestures,
    "left and right": lambda: _framed("left and right", _sides()),
    "counts": lambda: _framed("counts", _counts()),
    "degrees": lambda: _framed("degrees", _degrees()),
    "speed": lambda: _framed("speed", _speeds()),
    "style": _styles,
    "two at once": lambda: _framed("two at once", _together()),
    "sequences": lambda: _framed("sequences", _sequences()),
    "out of scope: warned": _out_of_scope,
    "in scope: not warned": _in_scope,
}
