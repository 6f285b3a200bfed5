"""How far the ends of a rig (hands, feet, head) can be from each joint at most, read from the model's file alone.

A small computer inside a rig has no MuJoCo. The distances between bodies along a limb do not change when it moves, so
their sum from a joint to the end of the limb is the furthest that the end can ever be from it.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from retarget.rig import Rig

Array = NDArray[np.float64]


def lever_arms(rig: Rig) -> Array:
    """(ends, nj) m: how far each end of the rig is at most from the axis of each joint that moves it, else 0.

    A model that is no plain tree of bodies in one file (parts included from others, a URDF) gets one end, which every
    joint moves, as far away as the root is high: more than any real rig has, so it only moves more slowly.
    """
    joints = {name: column for column, name in enumerate(rig.joint_names())}
    try:
        world = ET.parse(rig.model).getroot().find("worldbody")
    except (OSError, ET.ParseError):
        world = None
    rows = [] if world is None else [row for row, _ in _ends(world, joints) if row.any()]
    arms = np.array(rows).reshape(-1, len(joints))
    if not len(rows) or not (arms > 0).any(axis=0).all():
        return np.full((1, len(joints)), rig.nominal.height)
    return arms


def _ends(body: ET.Element, joints: dict[str, int]) -> Iterator[tuple[Array, float]]:
    """For each end at or below `body`: its row, and how far it is from the frame of `body` at most."""
    children = list(_children(body, 0.0))
    ends = [(row, way + far) for child, way in children for row, far in _ends(child, joints)]
    if not children:
        ends = [(np.zeros(len(joints)), max(map(_extent, body.findall("geom")), default=0.0))]
    for row, far in ends:
        for joint in body.findall("joint"):
            if joint.get("name") in joints:
                row[joints[joint.get("name", "")]] = _norm(joint.get("pos")) + far
        yield row, far


def _children(body: ET.Element, way: float) -> Iterator[tuple[ET.Element, float]]:
    for part in body:
        if part.tag == "body":
            yield part, way + _norm(part.get("pos"))
        elif part.tag == "frame":
            yield from _children(part, way + _norm(part.get("pos")))


def _extent(geom: ET.Element) -> float:
    size = max(map(float, (geom.get("size") or "0").split()))
    if ends := geom.get("fromto"):
        numbers = [float(x) for x in ends.split()]
        return max(math.hypot(*numbers[:3]), math.hypot(*numbers[3:])) + size
    return _norm(geom.get("pos")) + size


def _norm(pos: str | None) -> float:
    return math.hypot(*(float(x) for x in (pos or "0 0 0").split()))
