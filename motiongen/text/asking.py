"""Reads from a text what a motion can be measured for: "bow, then wave twice with the left hand" → `Asked`.

Gestures are recognised as the gesture generator does; going, and turning on the way, by their verbs.
"""

from __future__ import annotations

import re

from motiongen.gestures.reading import Request, read
from motiongen.text.claims import COUNTED, NEAR_DEG, UNTIMED, USUAL_S, USUAL_SPEED, Asked, Claim, Order, Pace, Side

# Gestures, by name, as actions that can be measured; of those not listed only the side is.
_ACTIONS = {
    "wave": "wave", "nod": "nod", "shake-head": "shake", "clap": "clap", "bow": "bow", "squat": "squat", "jump": "jump",
    "march": "step", "raise-arm": "raise", "raise-arm-sideways": "raise",
    "turn": "turn", "step-forward": "step", "step-back": "step", "sidestep": "step",
}  # fmt: skip
_BY_LEG = ("stand-on-one-leg", "raise-knee", "kick")
_BY_HAND = (
    "point", "point-forward", "point-up", "salute", "stop-sign", "beckon", "facepalm", "hand-on-heart", "listen",
    "blow-kiss", "fist-pump",
)  # fmt: skip

_SIDED = ("wave", "raise", "arm", "turn", "hand", "leg", "aside")

THEN = re.compile(r",?\s*\b(?:and )?(?:then|after that|afterwards|followed by|before)\b\s*")
WHILE = re.compile(r",?\s*\b(?:while|as (?=\w+ (?:walk|march|run|go)))\b\s*")
_ORDERS: tuple[tuple[re.Pattern[str], Order], ...] = ((THEN, "then"), (WHILE, "while"))
AT_ONCE = re.compile(r"\b(?:at the same time|meanwhile|simultaneously)\b")
AND = re.compile(r"\s+and\s+")
_RUN = re.compile(r"\b(?:run|jog|sprint|dash)\w*")
_WALK = re.compile(r"\b(?:walk|stroll|march)\w*")
_UP = re.compile(r"\b(?:arms?|hands?)\b.*\b(?:up|in the air)\b")
_TURN = re.compile(r"\b(?:turn|rotat|spin|corner|curve)\w*\b(?!.*\b(?:head|body|eyes|face)\b)")
_ASIDE = re.compile(r"\bsidestep\w*|\bshuffles?\b|\b(?:walk|step|mov)\w* sideways|\bwithout turning\b")


def asked_of(text: str) -> Asked | None:
    """What can be measured of what `text` asks for, as far as these rules understand it; None where nothing can."""
    text = " ".join(text.lower().split())
    for pattern, order in _ORDERS:
        parts = [part for part in pattern.split(text) if part]
        if len(parts) > 1:
            return _together([claim_of(part) for part in parts], order)
    halves = [claim for part in AND.split(text) if (claim := claim_of(part))]
    if len({claim.action for claim in halves}) == len(halves) > 1:
        return _together([*halves], "while" if AT_ONCE.search(text) else "any")
    return _together([claim_of(text)], "any")


def _together(claims: list[Claim | None], order: Order) -> Asked | None:
    """Those that can be measured; in order only where it is told of all of them when they are done."""
    known = tuple(claim for claim in claims if claim is not None)
    if not known:
        return None
    timed = len(known) == len(claims) and not any(claim.action in UNTIMED for claim in known)
    return Asked(known, order if timed else "any")


def claim_of(text: str) -> Claim | None:
    """What a text that asks for one thing asks for."""
    said = read(text)
    action = _action(text, said)
    if action is None:
        return None
    side: Side = said.side if said.side in ("left", "right", "both") and action in _SIDED else ""  # type: ignore[assignment]
    if action in UNTIMED and side not in ("left", "right"):
        return None
    if action == "raise" and said.degrees is not None:
        action = "arm"
    count = said.count if action in COUNTED and not (action == "raise" and said.count == 1) else None
    degrees = said.degrees if action in NEAR_DEG else None
    return Claim(action, side, count, degrees, _pace(said) if action in (*USUAL_S, *USUAL_SPEED) else "")


def _action(text: str, said: Request) -> str | None:
    if said.name == "sidestep" and said.count is not None:
        return "step"
    if _ASIDE.search(text):
        return "aside"
    if _TURN.search(text):
        return "turn"
    if said.name in _ACTIONS:
        return _ACTIONS[said.name]
    if said.name in _BY_HAND:
        return "hand"
    if said.name in _BY_LEG:
        return "leg"
    if said.name is None and _UP.search(text):
        return "raise"
    if _RUN.search(text):
        return "run"
    return "walk" if _WALK.search(text) else None


def _pace(said: Request) -> Pace:
    if said.speed is None:
        return ""
    return "slow" if said.speed < 1 else "quick"
