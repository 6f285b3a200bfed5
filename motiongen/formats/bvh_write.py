"""BVH out: the canonical skeleton in its T-pose, centimetres, y up, facing z, as Blender and every other tool opens."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from motiongen.files import replacing
from motiongen.motion import Motion, Skeleton
from motiongen.rotation import Array, quat_to_matrix

_TO_FILE = [1, 2, 0]  # the file's x (left), y (up), z (front) out of our x (front), y (left), z (up)
_CM = 100.0
_END_SITE = 0.5  # how far a leaf bone goes on past its joint, as a share of the bone before it; for drawing only


def write_bvh(motion: Motion, path: str | Path) -> None:
    """Write `motion` with six channels on the root and Z X Y rotations (degrees) on every joint.

    Labels, contacts and source have no place in a BVH file and are left out. Raises OSError where `path` cannot be
    written.
    """
    order = _depth_first(motion.skeleton)
    turns = np.degrees(_euler_zxy(quat_to_matrix(motion.joint_quat)))[:, order]
    rows = np.hstack([motion.root_pos[:, _TO_FILE] * _CM, turns.reshape(len(motion), -1)])
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="\n") as file:
        file.write("HIERARCHY\n" + "\n".join(_joint_lines(motion.skeleton, 0, 0)) + "\n")
        file.write(f"MOTION\nFrames: {len(motion)}\nFrame Time: {1 / motion.fps:.10g}\n")
        np.savetxt(file, rows, "%.6f")


def _depth_first(skeleton: Skeleton, joint: int = 0) -> list[int]:
    """Joints in the order in which the file's braces name them."""
    return [joint, *(j for child in _children(skeleton, joint) for j in _depth_first(skeleton, child))]


def _children(skeleton: Skeleton, joint: int) -> list[int]:
    return [j for j, parent in enumerate(skeleton.parents) if parent == joint]


def _joint_lines(skeleton: Skeleton, joint: int, depth: int) -> list[str]:
    pad = "  " * depth
    offset = skeleton.offsets[joint][_TO_FILE] * _CM
    place = "" if joint else "Xposition Yposition Zposition "
    lines = [
        f"{pad}{'JOINT' if joint else 'ROOT'} {skeleton.names[joint]}",
        f"{pad}{{",
        f"{pad}  OFFSET {_numbers(offset)}",
        f"{pad}  CHANNELS {3 if joint else 6} {place}Zrotation Xrotation Yrotation",
    ]
    children = _children(skeleton, joint)
    for child in children:
        lines += _joint_lines(skeleton, child, depth + 1)
    if not children:
        lines += [f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {_numbers(_END_SITE * offset)}", f"{pad}  }}"]
    return [*lines, f"{pad}}}"]


def _numbers(vector: Array) -> str:
    return " ".join(f"{v:.6f}" for v in vector)


def _euler_zxy(matrix: Array) -> Array:
    """Angles (T, J, 3) in radians with R = Rz(a) Rx(b) Ry(c) in the file's axes, of our rotations (T, J, 3, 3).

    Continuous in time except where b passes ±90°, where a and c share one freedom.
    """
    r = matrix[..., _TO_FILE, :][..., :, _TO_FILE]
    b = np.arcsin(np.clip(r[..., 2, 1], -1, 1))
    a = np.arctan2(-r[..., 0, 1], r[..., 1, 1])
    c = np.arctan2(-r[..., 2, 0], r[..., 2, 2])
    return np.unwrap(np.stack([a, b, c], axis=-1), axis=0)
