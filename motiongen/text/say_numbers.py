"""Captions that say the numbers of a clip: "a person walks", and it was eight steps → "a person walks eight steps";
nothing where the measurement is not clear-cut.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from motiongen.gestures.phrases import NUMBERS
from motiongen.measure.clip import Measured

MOST = 20  # beyond, nobody counts
TURN_STEP, TURN_OFF = 15, 4.0  # degrees: turns are said in steps of 15, and only within 4 of one; gait sways by 3
LEAST_TURN = 30  # degrees: a walk along a slight curve is no turn
SECONDS_OFF = 0.1  # s within which a clip lasts a whole number of seconds
METRES_OFF = 0.1  # m within which a way is a whole number of metres
LONGEST_STEP = 2.0  # m, a sprinter's: where the steps would have to be longer, some were missed on uneven ground
WALKED = 1.0  # m from which a way is worth saying

_SMALL = (
    *NUMBERS, "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen", "nineteen",
)  # fmt: skip
_TENS = ("", "", "twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
_NUMBER = re.compile(rf"\d|\b(once|twice|{'|'.join(_SMALL[1:])}|{'|'.join(_TENS[2:])})\b")
_GOING = re.compile(r"\b(walk|run|ran|march|step|jog|dash|sprint|stroll|strid|shuffl)")
# A verb phrase that a number may follow at once: "walks forward" + "four steps".
_OPEN = re.compile(
    r"(?<!\ba )\b(walk|run|jog|march|dash|sprint)(s|es|ning|ging|ing)?"
    r"( forward| ahead| straight ahead| along| backwards| back| sideways)?( to the (left|right))?$"
)
_TURNED = re.compile(r"\bturn(s|ing)?( around)?( to (the|their))? (left|right)$")
_ANOTHER = re.compile(r"\b(and|then|before|after|while)\b|,")


@dataclass(frozen=True)
class Said:
    """One measured fact.

    `clause`: it alone, "takes four steps". `after(caption)`: what to put behind a caption to say it, with its comma or
    space; empty where it does not fit. `side`: "left" or "right" where it is of one.
    """

    clause: str
    after: Callable[[str], str]
    side: str = ""

    def added_to(self, caption: str) -> str:
        """The caption with this fact; empty where it does not fit or the caption names another side."""
        named = set(re.findall(r"\b(left|right|both)\b", caption))
        if self.side in ("left", "right") and named - {self.side}:
            return ""
        tail = self.after(caption)
        return caption + tail if tail else ""


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


def says_number(caption: str) -> bool:
    """Whether a caption has a number, which may hold for the whole clip only."""
    return bool(_NUMBER.search(caption))


def says_time(caption: str) -> bool:
    """Whether a caption says how many seconds its clip lasts."""
    return bool(re.search(r" seconds?[!?]?$", caption))


def facts(measured: Measured) -> tuple[Said, ...]:
    """What may be said of a motion, in a fixed order, each number in words and then in digits.

    Of somebody who takes steps only the way is said: the head and the arms of walkers bob along.
    """
    said = _of_the_way(measured) if measured.steps else _of_the_body(measured)
    seconds = round(measured.duration_s)
    if 2 <= seconds <= MOST and abs(measured.duration_s - seconds) <= SECONDS_OFF:
        said += [_for_seconds(span) for span in _both(seconds, "second")]
    return tuple(said)


def clauses(measured: Measured) -> tuple[str, ...]:
    """Every fact as a clause in the third person, without a subject: "waves the left hand three times"."""
    return tuple(said.clause for said in facts(measured) if not re.search(r"\d", said.clause))


def with_numbers(caption: str, measured: Measured) -> tuple[str, ...]:
    """`caption` with each fact that fits it, one at a time, before its ! or ?; none where it has numbers already."""
    words = caption.rstrip(" .!?")
    if says_number(words):
        return ()
    end = caption.rstrip()[-1:] if caption.rstrip().endswith(("!", "?")) else ""
    return tuple(new + end for said in facts(measured) if (new := said.added_to(words)))


def _for_seconds(span: str) -> Said:
    return Said(f"moves for {span}", lambda caption: f" for {span}")


def _of_the_way(m: Measured) -> list[Said]:
    said = []
    if m.steps <= MOST and m.path_m <= LONGEST_STEP * m.steps:
        said += [_stepped(steps) for steps in _both(m.steps, "step")]
    turn = TURN_STEP * round(abs(m.turn_deg) / TURN_STEP)
    if LEAST_TURN <= turn <= 999 and abs(abs(m.turn_deg) - turn) <= TURN_OFF:
        said += [_turned("left" if m.turn_deg > 0 else "right", degrees) for degrees in _both(turn, "degree")]
    metres = round(m.path_m)
    if WALKED <= metres <= MOST and abs(m.path_m - metres) <= METRES_OFF:
        said += [_went(way) for way in _both(metres, "metre")]
    return said


def _stepped(steps: str) -> Said:
    def after(caption: str) -> str:
        if not _GOING.search(caption) or re.search(r"step", caption):
            return ""
        if _OPEN.search(caption):
            return f" {steps}"
        return f", {'in' if re.search(r'tak(e|es|ing)', caption) else 'taking'} {steps}"

    return Said(f"takes {steps}", after)


def _turned(side: str, degrees: str) -> Said:
    def after(caption: str) -> str:
        if _TURNED.search(caption):
            return f" {degrees}"
        if re.search(r"\bturn$", caption):
            return f" of {degrees}"
        if re.search(r"\bturn", caption):
            return f", {degrees} in all"
        if re.search(r"\b(left|right)\b", caption):
            return f", turning {degrees}" if re.search("corner|curve", caption) else ""
        return f", turning {side} {degrees}" if _GOING.search(caption) else ""

    return Said(f"turns {side} {degrees}", after, side)


def _went(way: str) -> Said:
    def after(caption: str) -> str:
        return f" {way}" if _OPEN.search(caption) else f", covering {way}" if _GOING.search(caption) else ""

    return Said(f"covers {way}", after)


def _of_the_body(m: Measured) -> list[Said]:
    said: list[Said] = []

    def times(count: float, verb: str, stem: str, noun: str, least: int = 1, side: str = "") -> None:
        if least <= count <= MOST and count == int(count):
            said.extend(_repeated(verb, often, stem, noun, side) for often in _often(int(count)))

    # A hand that goes up and down may swing in once on its way.
    if m.left_waves == m.left_perhaps and m.right_waves == m.right_perhaps:
        if m.left_waves == m.right_waves:
            times(m.left_waves, "waves both hands", "wav", "wave", 2)
        elif not (m.left_waves and m.right_waves):
            side = "left" if m.left_waves else "right"
            times(m.left_waves + m.right_waves, f"waves the {side} hand", "wav", "wave", 2, side)
    times(m.nods, "nods", "nod", "nod")
    times(m.head_shakes, "shakes the head", r"shak\w* .*head", "shake")
    times(m.claps, "claps", "clap", "clap")
    times(m.squats, "squats", "squat", "squat")
    times(m.jumps, "jumps", "jump|hop", "jump|hop")
    bow = TURN_STEP * round(m.bow_deg / TURN_STEP)
    if m.bows == 1 and bow and abs(m.bow_deg - bow) <= TURN_OFF:
        said += [_bowed(degrees) for degrees in _both(bow, "degree")]
    times(m.bows, "bows", "bow", "bow")
    return said


def _repeated(verb: str, often: str, stem: str, noun: str, side: str) -> Said:
    def after(caption: str) -> str:
        found = list(re.finditer(rf"\b({stem})\w*", caption))
        # Behind another clause it would be the other that is done so often; and "a wave twice" is no English.
        another = not found or _ANOTHER.search(caption, found[-1].end())
        as_noun = re.search(rf"\b(a|hand|bye)( [\w-]+)? ({noun})\b", caption)
        return "" if another or as_noun else f" {often}"

    return Said(f"{verb} {often}", after, side)


def _bowed(degrees: str) -> Said:
    def after(caption: str) -> str:
        if not (found := list(re.finditer(r"\bbow\w*", caption))) or _ANOTHER.search(caption, found[-1].end()):
            return ""
        return f" of {degrees}" if re.search(r"\ba (\w+ )?bow$", caption) else f" by {degrees}"

    return Said(f"bows {degrees}", after)


def _often(count: int) -> tuple[str, ...]:
    return ({1: "once", 2: "twice"}.get(count, f"{in_words(count)} times"), *((f"{count} times",) if count > 1 else ()))


def _both(number: int, unit: str) -> tuple[str, str]:
    """In words and in digits, as people type both."""
    units = f"{unit}{'' if number == 1 else 's'}"
    return f"{in_words(number)} {units}", f"{number} {units}"
