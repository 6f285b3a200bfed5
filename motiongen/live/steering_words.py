"""Steering as it is typed: `heading 90`, `speed 0.5`, `path 1,0 1,1.5`, `left_hand 0.3,0.2,1.2`, `steer off`."""

from __future__ import annotations

import math
from dataclasses import replace

from motiongen.generator import PromptError
from motiongen.live.steering import Steer

FORMS = {
    "heading": "heading DEGREES, from where it began to the left",
    "speed": "speed METRES_A_SECOND",
    "path": "path X,Y X,Y … in metres: forward and left of where it began",
    "left_hand": "left_hand X,Y,Z in metres: forward and left of the pelvis, above the floor",
    "right_hand": "right_hand X,Y,Z in metres: forward and left of the pelvis, above the floor",
    "steer": "steer off",
}
OFF = "off"


def steered(text: str, was: Steer) -> Steer | None:
    """What `text` makes of the steering there `was`; None where its first word is none of `FORMS`.

    `off` after any of them ends it. A heading takes the place of a path, and the other way round. Raises PromptError
    naming the form where what follows does not fit it, and as `Steer` does.
    """
    name, *rest = text.split() or [""]
    if name not in FORMS:
        return None
    if rest == [OFF]:
        return Steer() if name == "steer" else Steer(**(vars(was) | {name: () if name == "path" else None}))
    if name in ("heading", "speed"):
        value = _numbers(name, rest, 1, 1)[0][0]
        return replace(was, speed=value) if name == "speed" else replace(was, heading=math.radians(value), path=())
    if name == "path":
        path = tuple((x, y) for x, y in _numbers(name, rest, None, 2))
        return replace(was, path=path, heading=None)
    x, y, z = _numbers(name, rest, 1, 3)[0]
    return replace(was, left_hand=(x, y, z)) if name == "left_hand" else replace(was, right_hand=(x, y, z))


def _numbers(name: str, words: list[str], count: int | None, width: int) -> list[list[float]]:
    """`count` words, None: any number of them above 0, of `width` numbers each."""
    try:
        found = [[float(number) for number in word.split(",")] for word in words]
    except ValueError:
        found = []
    if not found or len(found) != (count or len(found)) or any(len(numbers) != width for numbers in found):
        raise PromptError(f"{' '.join([name, *words])!r}: say {FORMS[name]}, or {name} {OFF}")
    return found
