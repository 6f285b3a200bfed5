"""What can be done at once, and which of it no model is trained on."""

from __future__ import annotations

import re

from motiongen.measure.clip import Measured
from motiongen.text.captions import swap_sides

# Gaits carry another clip's upper body. Those that go on evenly can be made longer; a turn would become another one.
EVEN_GAITS = ("walk", "run", "dash", "walk-back", "walk-left", "walk-right")
FAST_GAITS = ("run", "dash")  # nobody stops from, or starts with, one of these within a step
GAITS = (*EVEN_GAITS, "walk-turn-left", "walk-turn-right", "march")

_ONE_ARM = (
    "wave", "raise-arm", "raise-arm-sideways", "point", "point-forward", "point-up", "salute", "stop-sign", "beckon",
    "facepalm", "hand-on-heart", "listen", "blow-kiss", "fist-pump",
)  # fmt: skip
_BOTH_ARMS = ("check-watch", "think", "shrug", "arms-forward", "t-pose", "flap-arms", "conduct", "welcome")
_TRUNK_TOO = ("clap", "hands-on-hips", "cross-arms", "stretch", "celebrate", "rub-hands", "pray")
_HEAD = ("nod", "shake-head", "look", "look-up", "look-down", "look-around", "tilt-head")
_EYES_TOO = ("point", "point-up", "facepalm", "hand-on-heart", "listen", "think", "check-watch")

_AT_MOST_TURNED, _AT_MOST_BOWED = 30.0, 15.0  # degrees that an upper body may go along with its own legs
_AT_MOST_BENT = 45.0  # degrees that the chest of the carrier may be bent
_ARMS = {"left": ("left_arm", "arms", "upper_body"), "right": ("right_arm", "arms", "upper_body")}


def _with_mirrors(*pairs: tuple[str, str]) -> tuple[tuple[str, str], ...]:
    mirrored = [(swap_sides(gait), swap_sides(action)) for gait, action in pairs]
    return tuple(dict.fromkeys(pair for both in zip(pairs, mirrored, strict=True) for pair in both))


# Never composed for training, so that prompts about parts of the body can be judged on what nobody has learnt by heart.
# Every gait and every action of theirs is trained on with others; a pair and its mirror image go together.
HELD_OUT_PAIRS = _with_mirrors(
    ("walk", "salute-left"),
    ("walk", "raise-up-both-hands"),
    ("run", "wave-left-hand"),
    ("run", "clap"),
    ("walk-back", "wave-both-hands"),
    ("walk-back", "raise-up-left-hand"),
    ("walk-left", "wave-left-hand"),
    ("walk-left", "raise-up-right-hand"),
    ("walk-turn-left", "raise-up-left-hand"),
    ("walk-turn-left", "wave-right-hand"),
    ("march", "point-forward-left"),
    ("march", "celebrate"),
)
# Another name for what is held out would let it in by the back door.
_AS_GOOD_AS = {"dash": "run", "wave-both": "wave-both-hands", "raise-arm-both": "raise-up-both-hands"} | {
    f"{name}-{side}": f"{action}-{side}-hand"
    for side in ("left", "right")
    for name, action in (("wave", "wave"), ("raise-arm", "raise-up"), ("raise-arm-sideways", "raise-up"))
} | {"raise-arm-sideways-both": "raise-up-both-hands"}  # fmt: skip


def plain_name(content: str) -> str:
    """The one name of a content that goes by several, gestures' and motion capture's."""
    return _AS_GOOD_AS.get(content, content)


def held_out(gait: str, action: str) -> bool:
    """Whether the contents `gait` and `action` at once are kept for testing, by whatever name they go."""
    return (plain_name(gait), plain_name(action)) in HELD_OUT_PAIRS


def parts_for(action: str) -> tuple[str, ...]:
    """The parts of the body that the content `action` needs of its clip, by the names of `compose.parts`; none where it
    needs the legs, or says nothing about the hands."""
    side = re.search(r"-(left|right)(-hand)?$", action)
    family = re.sub(r"-(left|right|both)$", "", action)
    if re.match(r"(wave|raise-up)-.*-hands?$", action) or family in _ONE_ARM:
        arm = f"{side[1]}_arm" if side else "arms"
        return (arm, "head") if family in _EYES_TOO else (arm,)
    if family in _BOTH_ARMS:
        return ("arms", "head") if family in _EYES_TOO else ("arms",)
    if family in _TRUNK_TOO:
        return ("upper_body",)
    return ("head",) if family in _HEAD else ()


def why_not(lower: Measured, upper: Measured, parts: tuple[str, ...]) -> str:
    """Why the `parts` of one clip do not go on the legs of the other, by what both were measured to do, or ""."""
    if upper.steps or upper.jumps or upper.squats:
        return "the upper clip needs its own legs: it steps, jumps or squats"
    if abs(upper.turn_deg) > _AT_MOST_TURNED:
        return f"the upper clip turns by {upper.turn_deg:.0f} degrees"
    if upper.bow_deg > _AT_MOST_BOWED and "head" not in parts[:1]:
        return f"the upper clip bows by {upper.bow_deg:.0f} degrees"
    if lower.chest_pitch_deg > _AT_MOST_BENT:
        return f"the lower clip is bent over by {lower.chest_pitch_deg:.0f} degrees"
    if lower.jumps or lower.squats:
        return "the lower clip jumps or squats"
    for side, raises, waves in (
        ("left", lower.left_raises, lower.left_waves),
        ("right", lower.right_raises, lower.right_waves),
    ):
        if (raises or waves) and not any(part in _ARMS[side] for part in parts):
            return f"the lower clip's {side} hand does something of its own"
    return ""
