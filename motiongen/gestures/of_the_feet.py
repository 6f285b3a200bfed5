"""Gestures that go somewhere: turning on the spot, and counted steps forward, back and aside."""

from __future__ import annotations

from math import ceil, radians

from motiongen.gestures.gesture import Gesture, Params
from motiongen.gestures.pose import Step
from motiongen.gestures.stepping import Place, beside, stepping

SIDES = ("right", "left")
WIDEST = radians(60)  # by which one foot turns before the other follows
AHEAD, BACK, ASIDE = 0.40, 0.30, 0.28  # m from foot to foot
SINGLE = 0.25  # m of a step that no other foot follows: who has taken it stands at ease


def _turn(p: Params) -> list[Step]:
    """To the right: the right foot opens, the left one follows, as often as the angle needs."""
    pairs = ceil(p.angle / WIDEST - 1e-9)
    middles = [Place(0, 0, -p.angle * (i + 1) / pairs) for i in range(pairs)]
    return stepping([(side, beside(middle, side)) for middle in middles for side in SIDES], 0.46)


def _forward(p: Params) -> list[Step]:
    return stepping(_in_line(p.count, AHEAD * p.amplitude, SINGLE * p.amplitude), 0.62)


def _back(p: Params) -> list[Step]:
    return stepping(_in_line(p.count, -BACK * p.amplitude, -SINGLE * p.amplitude), 0.66)


def _in_line(count: int, stride: float, single: float) -> list[tuple[str, Place]]:
    """One foot past the other, the right one first; the last comes down beside the one before."""
    reached = [stride * (i + 1) for i in range(count - 1)] if count > 1 else [single]
    if count > 1:
        reached.append(reached[-1])
    return [(SIDES[i % 2], beside(Place(x, 0), SIDES[i % 2])) for i, x in enumerate(reached)]


def _aside(p: Params) -> list[Step]:
    """To the right: the right foot out, the left one after it."""
    falls = []
    for i in range(p.count):
        alone = i % 2 == 0 and i + 1 == p.count
        out = p.amplitude * (ASIDE * (i // 2) + (SINGLE if alone else ASIDE))
        falls.append((SIDES[i % 2], beside(Place(0, -out), SIDES[i % 2])))
    return stepping(falls, 0.58)


FEET = (
    Gesture(
        "turn", _turn, sides=SIDES, degrees=90, amplitudes=(1 / 3, 4),
        verbs=("[turn] to the {side}", "[turn] {side}", "[turn] on the spot to the {side}", "[rotate] to the {side}",
               "[rotate] on the spot to the {side}", "[turn] in place to the {side}"),
        named={
            30: (),
            45: ("[make] an eighth turn to the {side}", "[turn] half {side}"),
            60: (),
            90: ("[make] a quarter turn to the {side}", "[do] a quarter turn {side}"),
            120: (),
            135: (),
            180: ("[turn] around to the {side}", "[make] a half turn to the {side}",
                  "[turn] {side} to face the other way", "[do] an about-face to the {side}"),
            270: ("[make] a three-quarter turn to the {side}",),
            360: ("[make] a full turn to the {side}", "[spin] around once to the {side}",
                  "[turn] all the way around to the {side}"),
        },
        keywords=("turn", "rotate", "spin", "pivot", "about face", "face other way"),
    ),
    Gesture(
        "step-forward", _forward, repeats=True, amplitudes=(0.86, 1.14), speeds=(0.6, 1.6),
        verbs=("[take] {steps} forward", "[take] {steps}", "[walk] {steps} forward", "[step] forward",
               "[go] forward {steps}", "[walk] {steps}", "[take] {steps} ahead", "[move] {steps} forward"),
        keywords=("step", "step forward", "step ahead", "step forward foot"),
    ),
    Gesture(
        "step-back", _back, repeats=True, amplitudes=(0.86, 1.14), speeds=(0.6, 1.6),
        verbs=("[take] {steps} back", "[step] back", "[go] {steps} backwards", "[walk] {steps} backwards",
               "[take] {steps} backwards", "[step] backwards", "[walk] back {steps}", "[move] {steps} back"),
        keywords=("step back", "step backward", "step back foot", "step behind"),
    ),
    Gesture(
        "sidestep", _aside, sides=SIDES, repeats=True, usual=4, amplitudes=(0.86, 1.14), speeds=(0.6, 1.6),
        verbs=("[sidestep] to the {side}", "[sidestep] {side}", "[take] {steps} to the {side}",
               "[step] to the {side}", "[step] sideways to the {side}", "[take] {steps} sideways to the {side}",
               "[move] {steps} to the {side}"),
        keywords=("sidestep", "step left", "step right", "step sideway", "step side"),
    ),
)  # fmt: skip
