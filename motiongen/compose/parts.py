"""The parts of the body by name: which of the 22 joints of SMPL belong to each."""

from __future__ import annotations

from collections.abc import Sequence

from motiongen.motion import SMPL_JOINTS


def _joints(*names: str) -> tuple[int, ...]:
    return tuple(sorted(SMPL_JOINTS.index(name) for name in names))


def _arm(side: str) -> tuple[int, ...]:
    return _joints(*(f"{side}_{joint}" for joint in ("collar", "shoulder", "elbow", "wrist")))


def _leg(side: str) -> tuple[int, ...]:
    return _joints(*(f"{side}_{joint}" for joint in ("hip", "knee", "ankle", "foot")))


_ARMS = (*_arm("left"), *_arm("right"))
_LEGS = (*_leg("left"), *_leg("right"))
_TORSO, _HEAD = _joints("spine1", "spine2", "spine3"), _joints("neck", "head")

# The pelvis, whose turn is the heading of all, goes with the legs.
PARTS: dict[str, tuple[int, ...]] = {
    "left_arm": _arm("left"),
    "right_arm": _arm("right"),
    "arms": tuple(sorted(_ARMS)),
    "head": _HEAD,
    "torso": _TORSO,
    "upper_body": tuple(sorted((*_TORSO, *_HEAD, *_ARMS))),
    "left_leg": _leg("left"),
    "right_leg": _leg("right"),
    "legs": tuple(sorted(_LEGS)),
    "lower_body": tuple(sorted((0, *_LEGS))),
    "whole_body": tuple(range(len(SMPL_JOINTS))),
}


def joints_of(parts: Sequence[str]) -> tuple[int, ...]:
    """Rows of the joints of all `parts`, in order, each once; raises ValueError for none or an unknown one."""
    if not parts:
        raise ValueError(f"no part of the body named; there are {', '.join(PARTS)}")
    for part in parts:
        if part not in PARTS:
            raise ValueError(f"unknown part of the body {part!r}; there are {', '.join(PARTS)}")
    return tuple(sorted({joint for part in parts for joint in PARTS[part]}))
