"""Reading the `ik_config` files of GMR, which say which body of a robot follows which human joint."""

from __future__ import annotations

import json
from pathlib import Path

from motiongen.motion import SMPL_JOINTS
from retarget.goals import LIMBS
from retarget.rig import Follow
from retarget.table import RigError

TOES = {"left_foot": "left_ankle", "right_foot": "right_ankle"}  # GMR's feet are what our ankles move
FIRMEST = 10.0  # our weight of a foot, which is what GMR weighs most


def read_gmr(path: Path, root: str, bodies: set[str]) -> tuple[tuple[Follow, ...], tuple[str, ...]]:
    """What follows what by the second pass of `path` (the first where it has no second), and what was changed.

    Weights are scaled so that the largest of a position is that of our feet. Offsets are left out: limbs are measured
    on the model. `root` is the model's root and `bodies` are its bodies. Raises RigError in one line, OSError.
    """
    try:
        config = json.loads(path.read_text())
        tables = [config.get("ik_match_table2"), config.get("ik_match_table1")]
        table = next(t for t in tables if t)
        rows = [(body, str(row[0]), float(row[1]), float(row[2])) for body, row in table.items()]
    except (ValueError, TypeError, LookupError, AttributeError, StopIteration, UnicodeDecodeError):
        raise RigError(f"{path}: not an ik_config of GMR: it has no ik_match_table1 or 2 to read") from None
    most = max((position for _, _, position, _ in rows), default=0.0) or FIRMEST
    leads = {joint for limb in LIMBS for joint in limb[1:]}
    follows, notes = {"pelvis": Follow(root, "pelvis", 1.0, 1.0)}, []
    for body, theirs, position, rotation in rows:
        human = TOES.get(theirs.lower(), theirs.lower())
        if human not in SMPL_JOINTS or body not in bodies:
            what = f"no such body: {body}" if body not in bodies else f"no joint of SMPL: {theirs}"
            notes.append(f"{path.name}: {body} follows {theirs}: left out, {what}")
        elif human != "pelvis":
            turned = rotation if human.endswith("ankle") or human in ("spine3", "head") else 0.0
            weight = position if human in leads else 0.0
            follows[human] = Follow(body, human, FIRMEST * weight / most, FIRMEST * turned / most)
    return tuple(follows.values()), tuple(notes)
