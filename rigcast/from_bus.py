"""`rigcast rigs new --from-bus`: a puppet that has no model, described by whoever stands before it, joint by joint."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from drivers.servos.setup import Found
    from retarget.capsules import Puppet
    from retarget.servos import ServoModel

T = TypeVar("T")
Ask = Callable[[str], str]
Move = Callable[[int], int]
START = """\
Put the puppet upright, its limbs hanging down, as it is when all angles are zero; have a ruler at hand.
Lengths are in metres along x forward, y left, z up. Each servo turns a little and comes back, weakly."""


def found_on(port: str, protocols: Sequence[str], bauds: Sequence[int], highest_id: int) -> list[Found]:
    """Who answers on `port`, each protocol and rate told on stderr."""
    from drivers.servos.setup import scan
    from drivers.servos.table import FAMILIES

    def told(name: str, rate: int) -> None:
        print(f"{name} at {rate} baud …", file=sys.stderr, flush=True)

    return list(
        scan(port, protocols=tuple(protocols) or tuple(FAMILIES), bauds=tuple(bauds), highest_id=highest_id, told=told)
    )


def told_by(file: Path, found: Sequence[Found]) -> Puppet:
    """The puppet of a file of answers; raises ValueError where other servos answered than it tells of."""
    from retarget.capsules import read_answers

    puppet = read_answers(file)
    here = {(f.id, f.model) for f in found}
    told = {(p.id, p.model.name) for p in puppet.parts}
    for what, rows in (("has no answer on the bus", told - here), ("is on the bus and not in the file", here - told)):
        for ident, model in sorted(rows):
            raise ValueError(f"{file}: servo {ident} ({model}) {what}")
    return puppet


def described(found: Sequence[Found], move: Move, ask: Ask) -> Puppet:
    """The puppet as somebody describes it: `move` turns a servo and says which way first, `ask` puts a question.

    What cannot be is told and asked again. Raises as `move` and `ask` do.
    """
    from retarget.capsules import AXES, BASE, Part, Point, puppet_of
    from retarget.rig import Bus
    from retarget.servos import servo_models
    from retarget.table import RigError

    names: dict[int, str] = {}
    axes: dict[int, str] = {}
    for servo in found:
        name, way = "", 1
        while not name:
            way = move(servo.id)
            question = f"servo {servo.id} ({servo.model}): which joint was it, such as left_elbow? (Enter: once more)"
            name = _answer(ask, question, lambda text: _new_name(text, [BASE, *names.values()]))
        axis = _choice(ask, f"{name}: about which axis did it turn first, by the right-hand rule?", tuple(AXES))
        names[servo.id], axes[servo.id] = name, axis if way > 0 else _turned(axis)
    parents = {}
    for ident, name in names.items():
        carriers = (BASE, *(n for n in names.values() if n != name))
        parents[ident] = _choice(ask, f"{name}: which joint carries it?", carriers)
    parts = []
    for servo in found:
        name = names[servo.id]
        axis = axes[servo.id]
        at = _answer(ask, f"{name}: where is it, from {_called(parents[servo.id])}? (such as 0 0.05 -0.1)", _point)
        model = servo_models()[servo.model]
        limits = _answer(
            ask,
            f"{name}: how far may it turn about {axis}, in degrees? (such as -90 45)",
            lambda text, most=model: _degrees(text, most),  # type: ignore[misc]
        )
        tip: Point | None = None
        if name not in parents.values():
            tip = _answer(ask, f"{name}: where does what it moves end, from the joint? (such as 0 0 -0.1)", _point)
        parts.append(Part(servo.id, model, name, parents[servo.id], axis, at, limits, tip))
    try:
        return puppet_of(Bus("main", found[0].protocol, found[0].baud), tuple(parts))
    except RigError as problem:
        raise ValueError(f"{problem}; begin anew") from None


def asked(question: str) -> str:
    """What somebody types on stdin; raises ValueError where it has ended."""
    print(question, end=" ", file=sys.stderr, flush=True)
    answer = sys.stdin.readline()
    if not answer:
        raise ValueError("an answer is awaited, and the input has ended")
    return answer.strip()


def _answer(ask: Ask, question: str, read: Callable[[str], T]) -> T:
    while True:
        try:
            return read(ask(question))
        except _Wrong as problem:
            print(f"  {problem}", file=sys.stderr, flush=True)


def _choice(ask: Ask, question: str, options: Sequence[str]) -> str:
    def read(text: str) -> str:
        if text not in options:
            raise _Wrong(f"{text!r} is none of {', '.join(options)}")
        return text

    return _answer(ask, f"{question} ({', '.join(options)})", read)


class _Wrong(Exception):
    """What was answered cannot be."""


def _turned(axis: str) -> str:
    return axis.removeprefix("-") if axis.startswith("-") else f"-{axis}"


def _called(parent: str) -> str:
    return "the middle of the base" if parent == "base" else parent


def _new_name(text: str, taken: Sequence[str]) -> str:
    if text in taken:
        raise _Wrong(f"{text!r} is taken")
    if text and not re.fullmatch(r"[a-z][a-z0-9_]*", text):
        raise _Wrong(f"{text!r}: a name has small letters, digits and _")
    return text


def _numbers(text: str, count: int) -> list[float]:
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise _Wrong(f"{text!r} is not {count} numbers")
    return numbers


def _point(text: str) -> tuple[float, float, float]:
    x, y, z = _numbers(text, 3)
    if max(abs(x), abs(y), abs(z)) > 2:
        raise _Wrong(f"{text!r}: metres, at most 2")
    return x, y, z


def _degrees(text: str, model: ServoModel) -> tuple[float, float]:
    from retarget.capsules import reach, reach_text

    lower, upper = _numbers(text, 2)
    if not lower <= 0 <= upper or lower == upper:
        raise _Wrong(f"{text!r}: from at most 0 to at least 0, for the pose it has now is 0")
    if math.radians(upper - lower) > reach(model):
        raise _Wrong(f"{text!r}: a {model.name} turns by {reach_text(model)}")
    return math.radians(lower), math.radians(upper)
