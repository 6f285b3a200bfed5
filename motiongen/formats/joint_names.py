"""Which joint of an unknown skeleton is which, by its name: LeftUpLeg, thigh_l, mixamorig:LeftArm, Bip01 R Calf …"""

from __future__ import annotations

import re
from collections.abc import Sequence

from motiongen.motion import SMPL_JOINTS

_PREFIXES = {"bip", "cc", "base", "mixamorig", "def", "org", "b", "jnt", "joint", "character"}
_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
# First come, first served: a name taken as a shoulder is no longer there to be taken as a collar, nor a foot as toes.
_PARTS = {
    "head": ("head",),
    "neck": ("neck", "neck1", "neck01", "necktwist01"),
    "pelvis": ("hips", "pelvis", "hip"),
    "left_shoulder": ("upperarm", "arm", "uparm", "humerus", "shldr", "shoulder"),
    "left_collar": ("clavicle", "collar", "collarbone", "shoulder"),
    "left_elbow": ("forearm", "lowerarm", "lowarm", "elbow", "radius"),
    "left_wrist": ("hand", "wrist"),
    "left_hip": ("upleg", "upperleg", "thigh", "femur", "hip", "leg"),
    "left_knee": ("leg", "lowerleg", "lowleg", "calf", "shin", "tibia", "knee"),
    "left_ankle": ("ankle", "foot"),
    "left_foot": ("toebase", "toes", "toe", "toe0", "ball", "foot"),
}
OPTIONAL = ("spine1", "spine2", "left_collar", "right_collar")


def match_joints(names: Sequence[str], parents: Sequence[int]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Canonical name → name in the file, and the canonical joints that are needed and found no match.

    Case, prefixes and the place of the side in a name do not matter. The spine goes by the tree, not by names: what
    lies between pelvis and neck, its last joint the chest. Collars and the lower spine may be missing.
    """
    free: dict[tuple[str, str], str] = {}
    for name in names:
        free.setdefault(_read(name), name)
    found: dict[str, str] = {}
    for joint, parts in _PARTS.items():
        for side in ("left", "right") if joint.startswith("left") else ("",):
            for part in parts:
                if (side, part) in free:
                    found[joint.replace("left", side)] = free.pop((side, part))
                    break
    if "pelvis" in found and "neck" in found:
        found |= _spine(list(names), parents, found["pelvis"], found["neck"])
    missing = tuple(j for j in SMPL_JOINTS if j not in found and j not in OPTIONAL)
    return {joint: found[joint] for joint in SMPL_JOINTS if joint in found}, missing


def _spine(names: list[str], parents: Sequence[int], pelvis: str, neck: str) -> dict[str, str]:
    between: list[str] = []
    at = parents[names.index(neck)]
    while at >= 0 and names[at] != pelvis:
        between.insert(0, names[at])
        at = parents[at]
    if at < 0 or not between:
        return {}
    if len(between) == 1:
        return {"spine3": between[0]}
    lower = {"spine1": between[0], "spine3": between[-1]}
    return lower if len(between) == 2 else lower | {"spine2": between[len(between) // 2]}


def _read(name: str) -> tuple[str, str]:
    """Side ("left", "right" or "") and the rest of a name in lower case."""
    words = [w.lower() for w in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name.rpartition(":")[2])]
    while words and (words[0] in _PREFIXES or words[0].isdigit()):
        words.pop(0)
    side = next((_SIDES[w] for w in words if w in _SIDES), "")
    return side, "".join(w for w in words if w not in _SIDES)
