"""What of a human motion a rig cannot show, because it has no such parts."""

from __future__ import annotations

import numpy as np

from motiongen.motion import Motion
from motiongen.rotation import quat_mul
from retarget.rig import Rig

PARTS = {
    "legs": ("left_knee", "right_knee", "left_ankle", "right_ankle"),
    "left leg": ("left_knee", "left_ankle"),
    "right leg": ("right_knee", "right_ankle"),
    "arms": ("left_elbow", "right_elbow", "left_wrist", "right_wrist"),
    "left arm": ("left_elbow", "left_wrist"),
    "right arm": ("right_elbow", "right_wrist"),
    "head": ("head",),
}
STILL = 0.35  # rad: parts that turn less than this over the whole of a motion are not what it is about


def missing_parts(rig: Rig) -> tuple[str, ...]:
    """Parts of a human of which nothing in the rig follows anything; both arms or legs count as one."""
    follows = {f.human for f in rig.follow if f.position or f.rotation}
    gone = [part for part, joints in PARTS.items() if not follows & set(joints)]
    return tuple(part for part in gone if not any(part.endswith(whole[:-1]) and part != whole for whole in gone))


def cannot_show(what: object, rig: Rig) -> tuple[str, ...]:
    """One line for each missing part that `what`, where it is a human motion, moves: what will not be visible."""
    if not isinstance(what, Motion):
        return ()
    said = ", ".join(dict.fromkeys(repr(label.text) for label in what.labels)) or "what it does here"
    return tuple(
        f"rig {rig.name!r} has no {part}: {said} will not be visible there"
        for part in missing_parts(rig)
        if _turns(what, part) > STILL
    )


def _turns(motion: Motion, part: str) -> float:
    """Largest angle (rad) between any frame and the first of what carries `part`, such as hip and knee."""
    local = {name: motion.joint_quat[:, motion.skeleton.index(name)] for name in motion.skeleton.names}
    limb = {"arm": ("shoulder", "elbow"), "leg": ("hip", "knee")}
    word = part.removesuffix("s").split()[-1]
    sides = [side for side in ("left", "right") if part.endswith("s") or part.startswith(side)]
    turning = [local[f"{side}_{joint}"] for side in sides for joint in limb.get(word, ())]
    quat = np.stack(turning or [quat_mul(local["neck"], local["head"])], axis=1)  # a nod is shared by neck and head
    dot = np.abs(np.sum(quat * quat[:1], axis=-1))
    return float(2 * np.arccos(np.clip(dot, 0, 1)).max())
