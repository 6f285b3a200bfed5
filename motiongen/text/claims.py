"""What a text asks for that a motion can be measured for: actions with their side, count, degrees and pace, in order.

The language tests ask whether a motion does it; `candidates` asks which of several comes nearest.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from motiongen.measure.clip import FPS, SIDES, Event, Seen
from motiongen.text.say_numbers import in_words

Order = Literal["any", "then", "while"]
Side = Literal["", "left", "right", "both"]
Pace = Literal["", "slow", "quick"]

VERBS = {
    "wave": "waves", "raise": "raises a hand", "nod": "nods", "shake": "shakes the head", "clap": "claps",
    "bow": "bows", "squat": "squats", "jump": "jumps", "step": "steps", "turn": "turns", "arm": "raises an arm",
    "hand": "uses a hand", "leg": "lifts a leg", "aside": "goes sideways", "walk": "walks", "run": "runs",
}  # fmt: skip
COUNTED = ("wave", "raise", "nod", "shake", "clap", "bow", "squat", "jump", "step")
GOING = ("walk", "run", "step")
UNTIMED = ("hand", "leg", "aside")  # measured over the whole motion

# What may be said in degrees, and by how much it may be off.
NEAR_DEG = {"turn": 20.0, "arm": 20.0, "bow": 15.0}
LEAST_TURN = 20.0  # degrees: gait sways by less
RAISED_DEG = 65.0  # degrees from hanging: some raise their hands not quite to their shoulders
LOWER_DEG = 15.0  # by which the other arm stays lower
MOSTLY = 2.0  # times as far as the other hand, or as high as the other foot, for being the one that does it
LIFTED = 0.04  # m off the floor: a leg that does something
FAR, STRIDES = 0.5, 2  # m and steps from which somebody walks
SLOWEST_RUN, FASTEST_WALK = 1.3, 1.8  # m/s; old people in motion capture run at 1.4, young ones walk at 1.6

# Seconds of half of one (`Event.seconds`) and metres a second that are usual, and the share of them by which what is
# slow or quick is off. Gestures at speed 1, and medians of motion capture.
USUAL_S = {"wave": 0.30, "nod": 0.30, "shake": 0.40, "clap": 0.19, "bow": 1.7, "squat": 0.97}
USUAL_SPEED = {"walk": 1.15, "run": 2.7}
PACE_OFF = 0.1


@dataclass(frozen=True)
class Claim:
    """One thing asked for; "" and None where nothing is said.

    Raises ValueError for an action not known, or one that is not counted, not said in degrees or has no pace.
    """

    action: str
    side: Side = ""
    count: int | None = None
    degrees: float | None = None
    pace: Pace = ""

    def __post_init__(self) -> None:
        if self.action not in VERBS:
            raise ValueError(f"no measure for {self.action!r}; there are {', '.join(VERBS)}")
        for what, said, able in (
            ("count", self.count is not None, COUNTED),
            ("degrees", self.degrees is not None, tuple(NEAR_DEG)),
            ("pace", bool(self.pace), (*USUAL_S, *USUAL_SPEED)),
        ):
            if said and self.action not in able:
                raise ValueError(f"{self.action} has no {what}; these have: {', '.join(able)}")


@dataclass(frozen=True)
class Asked:
    """Claims, and how they go together: in any order, each after the one before ("then"), or at once ("while").

    Raises ValueError where an order is asked of something of which nobody can tell when it is done.
    """

    claims: tuple[Claim, ...]
    order: Order = "any"

    def __post_init__(self) -> None:
        for claim in self.claims:
            if self.order != "any" and claim.action in UNTIMED:
                raise ValueError(f"nothing tells when a motion {VERBS[claim.action]}: it cannot be asked for in order")


def holds(asked: Asked, seen: Seen) -> bool:
    """Whether a motion does all that is asked: counts exactly, degrees within `NEAR_DEG`, with no other side."""
    return shortfall(asked, seen) == 0.0


def shortfall(asked: Asked, seen: Seen) -> float:
    """0 where a motion does all that is asked; else 1 to 2 for each thing that is wrong, the more the further off."""
    missing = sum(_missing(claim, asked, seen) for claim in asked.claims)
    if missing == 0 and not _in_order(asked, seen):
        return 1.0
    return missing


def describe(asked: Asked) -> str:
    """What is asked in few words: "waves three times (right), then bows"."""
    link = {"any": " and ", "then": ", then ", "while": " and meanwhile "}[asked.order]
    return link.join(_described(claim) for claim in asked.claims)


def _described(claim: Claim) -> str:
    words = [VERBS[claim.action]]
    if claim.count is not None:
        words.append({1: "once", 2: "twice"}.get(claim.count, f"{in_words(claim.count)} times"))
    if claim.degrees is not None:
        words.append(f"{claim.degrees:g} degrees")
    if claim.pace:
        words.append({"slow": "slowly", "quick": "quickly"}[claim.pace])
    return " ".join(words) + (f" ({claim.side})" if claim.side else "")


def _missing(claim: Claim, asked: Asked, seen: Seen) -> float:
    """0 where the claim holds, else 1 to 2 for every part of it that does not."""
    missing = 0.0
    if claim.count is not None:
        missing += _distance(_counts(claim, seen), float(claim.count), near=0.0)
    elif claim.degrees is not None:
        missing += _distance(_angles(claim, seen), claim.degrees, near=NEAR_DEG[claim.action])
    elif not _does(claim, seen):
        missing += 1.0
    if claim.side in SIDES and not _shared(claim, asked) and _other_side_too(claim, seen):
        missing += 1.0
    if claim.pace and not _paced(claim, seen):
        missing += 1.0
    return missing


def _distance(found: tuple[float, ...], wanted: float, *, near: float) -> float:
    """0 where all that was found is `near` what is wanted, else 1 to 2 by how far the worst is off."""
    off = max(abs(each - wanted) for each in found)
    return 0.0 if off <= near else 1.0 + off / (off + wanted)


def _counts(claim: Claim, seen: Seen) -> tuple[float, ...]:
    """How often it is done, by each side that is asked for; where none is, by the side that does it more."""
    m = seen.totals
    pairs = {"wave": (m.left_waves, m.right_waves), "raise": (m.left_raises, m.right_raises)}
    if claim.action in pairs:
        return _of(claim.side, pairs[claim.action])
    if claim.action == "step":
        return _of(claim.side, (m.left_steps, m.right_steps)) if claim.side else (m.steps,)
    totals = {
        "nod": m.nods, "shake": m.head_shakes, "clap": m.claps, "bow": m.bows, "squat": m.squats, "jump": m.jumps,
    }  # fmt: skip
    return (totals[claim.action],)


def _angles(claim: Claim, seen: Seen) -> tuple[float, ...]:
    """Degrees of a turn to the side that is asked for, of the arms that are, or of the deepest bow."""
    if claim.action == "bow":
        return (seen.totals.bow_deg,)
    if claim.action == "arm":
        return _of(claim.side, _lifted(seen))
    return (_turn(claim.side, seen),)


def _lifted(seen: Seen) -> tuple[float, float]:
    left, right = seen.lifted_deg.max(axis=0)
    return float(left), float(right)


def _turn(side: str, seen: Seen) -> float:
    turned = seen.totals.turn_deg
    return {"left": turned, "right": -turned}.get(side, abs(turned))


def _of(side: str, pair: tuple[float, float]) -> tuple[float, ...]:
    if side == "both":
        return pair
    return (pair[SIDES.index(side)],) if side else (max(pair),)


def _does(claim: Claim, seen: Seen) -> bool:
    """Whether the action is done at all, with no number asked for."""
    m = seen.totals
    if claim.action in ("raise", "arm"):
        return min(_of(claim.side, _lifted(seen))) >= RAISED_DEG
    if claim.action == "hand":
        return _does_most(claim.side, seen.hand_path_m)
    if claim.action == "leg":
        return _does_most(claim.side, seen.foot_high_m) and max(seen.foot_high_m) >= LIFTED
    if claim.action == "turn":
        return _turn(claim.side, seen) >= LEAST_TURN
    if claim.action == "aside":
        left = seen.ahead_m[1]
        return {"left": left, "right": -left}.get(claim.side, abs(left)) >= FAR
    if claim.action in ("walk", "run"):
        going = m.steps >= STRIDES and m.path_m >= FAR
        return going and (
            m.mean_speed_m_s >= SLOWEST_RUN if claim.action == "run" else m.mean_speed_m_s <= FASTEST_WALK
        )
    return min(_counts(claim, seen)) > 0


def _does_most(side: str, pair: tuple[float, float]) -> bool:
    left, right = pair
    return {"left": left > MOSTLY * right, "right": right > MOSTLY * left}.get(side, True)


def _other_side_too(claim: Claim, seen: Seen) -> bool:
    """Whether the hand of the other side joins in; turns, ways and legs have no such thing."""
    own, other = (SIDES.index(claim.side), 1 - SIDES.index(claim.side))
    if claim.action == "wave":
        return (seen.totals.left_waves, seen.totals.right_waves)[other] > 0
    if claim.action in ("raise", "arm"):
        return _lifted(seen)[other] > _lifted(seen)[own] - LOWER_DEG
    return False


def _shared(claim: Claim, asked: Asked) -> bool:
    """Whether something else is asked that may well move the other arm."""
    arms = ("wave", "raise", "arm", "clap")
    return any(each.action in arms and each is not claim for each in asked.claims)


def _paced(claim: Claim, seen: Seen) -> bool:
    """Whether it is done more slowly, or quickly, than is usual."""
    times = slowness(claim, seen)
    return times > 1 + PACE_OFF if claim.pace == "slow" else 0 < times < 1 - PACE_OFF


def slowness(claim: Claim, seen: Seen) -> float:
    """How many times as long as usual it takes, once; 0 where it is not done. Raises KeyError where none is usual."""
    if claim.action in USUAL_SPEED:
        speed = seen.totals.mean_speed_m_s
        return USUAL_SPEED[claim.action] / speed if speed > 0 else 0.0
    seconds = [event.seconds for event in _events(claim, seen)]
    return float(np.median(seconds)) / USUAL_S[claim.action] if seconds else 0.0


def _events(claim: Claim, seen: Seen) -> list[Event]:
    """The events that the claim is about; walking is made of steps."""
    action = "step" if claim.action in USUAL_SPEED else claim.action
    return [e for e in seen.events if e.action == action and (claim.side not in SIDES or e.side in ("", claim.side))]


def _in_order(asked: Asked, seen: Seen) -> bool:
    """Whether claims, all of which hold, do so in the order asked for."""
    if asked.order == "any":
        return True
    spans = [_span(claim, seen) for claim in asked.claims]
    if asked.order == "then":
        pairs = pairwise(zip(asked.claims, spans, strict=True))
        return all(_after(one.action, a, other.action, b) for (one, a), (other, b) in pairs)
    start, end = max(spans, key=lambda span: span[1] - span[0])
    return all(start <= (a + b) / 2 <= end for a, b in spans)


def _after(first: str, a: tuple[float, float], second: str, b: tuple[float, float]) -> bool:
    """Whether span `b` comes after span `a`. People walk on through a turn, and turn by stepping: of the two only one
    end of the walk is looked at."""
    if first in GOING and second == "turn":
        return a[0] <= b[0]
    if first == "turn" and second in GOING:
        return a[1] <= b[1]
    return a[1] <= b[0]


def _span(claim: Claim, seen: Seen) -> tuple[float, float]:
    """Seconds in which it is done: from its first event to its last, the middle half of a turn, an arm's time up."""
    if claim.action == "turn":
        share = seen.turned_deg / seen.turned_deg[-1]
        return float(np.argmax(share >= 0.25)) / FPS, float(np.argmax(share >= 0.75)) / FPS
    if claim.action in ("raise", "arm"):
        lifted = seen.lifted_deg.max(axis=1) if claim.side not in SIDES else seen.lifted_deg[:, SIDES.index(claim.side)]
        up = np.flatnonzero(lifted >= 0.8 * lifted.max())
        return float(up[0]) / FPS, float(up[-1]) / FPS
    events = _events(claim, seen)
    return events[0].at_s, events[-1].at_s
