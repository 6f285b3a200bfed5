"""Takes a text for several things apart: "walk while clapping, then bow" is two parts of the body at once, then all.

Only where every part says something that can be measured (`asking.py`), and where no two at once need the same part of
the body: all else is better left to the network as it stands.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import combinations

from motiongen.compose.parts import joints_of
from motiongen.text.asking import AND, AT_ONCE, THEN, WHILE, claim_of
from motiongen.text.claims import Claim

_ARMS = ("wave", "raise", "arm", "hand")
_HEAD = ("nod", "shake")


@dataclass(frozen=True)
class Piece:
    """One thing: its `text`, and the `parts` of the body that do it, none for the whole."""

    text: str
    parts: tuple[str, ...]


def plan_of(text: str) -> tuple[tuple[Piece, ...], ...]:
    """What happens one after the other, and of each what happens at once; () where that is one thing, or not clear."""
    text = " ".join(text.lower().split())
    steps = [_at_once(step) for step in THEN.split(text) if step]
    if not all(steps) or sum(map(len, steps)) < 2:
        return ()
    return tuple(steps)


def _at_once(text: str) -> tuple[Piece, ...]:
    """The pieces of one step; () where they cannot be told apart, or need the same part of the body."""
    parts = [part for part in WHILE.split(text) if part]
    if len(parts) == 1 and AT_ONCE.search(text):
        parts = [part for part in AND.split(AT_ONCE.sub("", text)) if claim_of(part)]
    pieces = [_piece(part) for part in parts]
    known = tuple(piece for piece in pieces if piece is not None)
    if len(known) < len(pieces) or sum(not piece.parts for piece in known) > 1:
        return ()
    limbs = [set(joints_of(piece.parts)) for piece in known if piece.parts]
    return () if any(a & b for a, b in combinations(limbs, 2)) else known


def _piece(text: str) -> Piece | None:
    claim = claim_of(text)
    return None if claim is None else Piece(re.sub(r"\s+(?=,|\s)", "", text).strip(" ,."), _parts(claim))


def _parts(claim: Claim) -> tuple[str, ...]:
    if claim.action in _HEAD:
        return ("head",)
    if claim.action == "clap" or (claim.action in _ARMS and claim.side == "both"):
        return ("arms",)
    if claim.action in _ARMS:
        return (f"{claim.side or 'right'}_arm",)
    return ()
