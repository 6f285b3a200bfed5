"""Captions that say the numbers of a clip: "a person walks", and it was eight steps → "a person walks, taking eight
steps"; nothing where the measurement is not clear-cut.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from motiongen.gestures.phrases import NUMBERS
from motiongen.measure import Measured

MOST = 20  # beyond, nobody counts
TURN_STEP, TURN_OFF = 15, 4.0  # degrees: turns are said in steps of 15, and only within 4 of one; gait sways by 3
LEAST_TURN = 30  # degrees: a walk along a slight curve is no turn
SECONDS_OFF = 0.1  # s within which a clip lasts a whole number of seconds
METRES_OFF = 0.1  # m within which a way is a whole number of metres
WALKED = 1.0  # m from which a way is worth saying

_SMALL = (
    *NUMBERS, "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen",
)  # fmt: skip
_PARTICIPLE = r"\w+ing\b"
_TENS = ("", "", "twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
_NUMBER = re.compile(rf"\d|\b(once|twice|{'|'.join(_SMALL[1:])}|{'|'.join(_TENS[2:])})\b")


@dataclass(frozen=True)
class Said:
    """One measured fact: `clause` of its own ("walks four steps"), `after` for a caption ("taking four steps"), and
    `needs`, a pattern of which the caption must have something for `after` to fit; empty fits any."""

    clause: str
    after: str
    needs: str = ""


def in_words(number: int) -> str:
    """0 … 999 in English, hyphenated: 45 is "forty-five". Raises ValueError for another number."""
    if not 0 <= number <= 999:
        raise ValueError(f"no words for {number}; 0 to 999 have some")
    if number < len(_SMALL):
        return _SMALL[number] if number else "zero"
    if number < 100:
        tens, ones = divmod(number, 10)
        return _TENS[tens] + (f"-{_SMALL[ones]}" if ones else "")
    hundreds, rest = divmod(number, 100)
    return f"{_SMALL[hundreds]} hundred" + (f" {in_words(rest)}" if rest else "")


def facts(measured: Measured) -> tuple[Said, ...]:
    """What may be said of a motion, in a fixed order.

    Of somebody who takes steps only the way is said: the head and the arms of walkers bob along.
    """
    said = _of_the_way(measured) if measured.steps else _of_the_body(measured)
    seconds = round(measured.duration_s)
    if 1 <= seconds <= MOST and abs(measured.duration_s - seconds) <= SECONDS_OFF:
        span = f"for {_counted(seconds, 'second')}"
        said.append(Said(f"moves {span}", span))
    return tuple(said)


def clauses(measured: Measured) -> tuple[str, ...]:
    """Every fact as a clause in the third person, without a subject: "waves the left hand three times"."""
    return tuple(said.clause for said in facts(measured))


def has_number(caption: str) -> bool:
    """Whether a caption says a number, in figures or in words."""
    return _NUMBER.search(caption) is not None


def with_numbers(caption: str, measured: Measured) -> tuple[str, ...]:
    """`caption` with each fact that fits it, one at a time; a caption that has numbers already gets none."""
    if has_number(caption):
        return ()
    fitting = [said.after for said in facts(measured) if re.search(said.needs, caption)]
    return tuple(f"{caption}{',' if re.match(_PARTICIPLE, after) else ''} {after}" for after in fitting)


def _of_the_way(m: Measured) -> list[Said]:
    said = []
    going = r"\b(walk|run|march|step|jog|dash|sprint|stroll|strid|mov)"
    if m.steps <= MOST:
        steps = _counted(m.steps, "step")
        said.append(Said(f"takes {steps}", f"taking {steps}", going))
    turn = TURN_STEP * round(abs(m.turn_deg) / TURN_STEP)
    if turn >= LEAST_TURN and turn <= 999 and abs(abs(m.turn_deg) - turn) <= TURN_OFF:
        way = f"{'left' if m.turn_deg > 0 else 'right'} {in_words(turn)} degrees"
        said.append(Said(f"turns {way}", f"turning {way}", going + r"|\bturn"))
    metres = round(m.path_m)
    if WALKED <= metres <= MOST and abs(m.path_m - metres) <= METRES_OFF:
        said.append(Said(f"covers {_counted(metres, 'metre')}", f"covering {_counted(metres, 'metre')}", going))
    return said


def _of_the_body(m: Measured) -> list[Said]:
    said = []

    def times(count: float, verb: str, needs: str, least: int = 1) -> None:
        if least <= count <= MOST and count == int(count):
            often = {1: "once", 2: "twice"}.get(int(count), f"{in_words(int(count))} times")
            said.append(Said(f"{verb} {often}", often, needs))

    # A hand that goes up and down may swing in once on its way.
    waving = r"\b(wav|hello|goodbye|greet|bye)"
    if m.left_waves == m.right_waves:
        times(m.left_waves, "waves both hands", waving, least=2)
    elif not (m.left_waves and m.right_waves):
        side = "left" if m.left_waves else "right"
        times(m.left_waves + m.right_waves, f"waves the {side} hand", waving, least=2)
    times(m.nods, "nods", r"\bnod")
    times(m.head_shakes, "shakes the head", r"\b(shak|shook)\w* .*head")
    times(m.claps, "claps", r"\b(clap|applau)")
    times(m.squats, "squats", r"\bsquat")
    times(m.jumps, "jumps", r"\b(jump|hop)")
    bow = TURN_STEP * round(m.bow_deg / TURN_STEP)
    if m.bows == 1 and bow and abs(m.bow_deg - bow) <= TURN_OFF:
        said.append(Said(f"bows {in_words(bow)} degrees", f"by {in_words(bow)} degrees", r"\bbow"))
    times(m.bows, "bows", r"\bbow")
    return said


def _counted(number: int, unit: str) -> str:
    return f"{in_words(number)} {unit}{'' if number == 1 else 's'}"
