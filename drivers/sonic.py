"""Frames as GEAR-SONIC's whole-body controller takes them over ZeroMQ: version 1 of its `pose` messages.

A message is the topic, a JSON header padded with zeros to 1280 bytes that names each field with its type and shape, and
the fields one after the other, little-endian: `joint_pos` and `joint_vel` (N, 29), `body_quat` (N, 4) w x y z and
`frame_index` (N,), at 50 frames a second. The joints are Unitree G1's, in the order in which Isaac Lab counts them.
"""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import ArrayLike

from drivers.endpoint import StreamError
from retarget.rig import Rig

TOPIC = b"pose"
HEADER_BYTES = 1280
RATE_HZ = 50.0
# Isaac Lab counts joints by their depth in the tree, MuJoCo leg by leg and arm by arm. Column k of a SONIC message is
# column ISAAC_ORDER[k] of MuJoCo's.
ISAAC_ORDER = (
    0, 6, 12, 1, 7, 13, 2, 8, 14, 3, 9, 15, 22, 4, 10, 16, 23, 5, 11, 17, 24, 18, 25, 19, 26, 20, 27, 21, 28,
)  # fmt: skip


def require_g1(rig: Rig) -> None:
    """Raise StreamError unless `rig` has the joints of which SONIC speaks."""
    if len(rig.joints) != len(ISAAC_ORDER) or not rig.joints[0].name.startswith("left_hip_pitch"):
        raise StreamError(f"SONIC takes the {len(ISAAC_ORDER)} joints of unitree_g1; rig {rig.name!r} has others")


def sonic_message(first_index: int, pos: ArrayLike, vel: ArrayLike, quat: ArrayLike) -> bytes:
    """The message for N frames, the first of which is number `first_index` since the stream began.

    `pos` (N, 29) rad and `vel` (N, 29) rad/s in MuJoCo's order, `quat` (N, 4) the pelvis' orientation in the world, w x
    y z. Raises StreamError where a shape differs.
    """
    pos, vel, quat = (np.asarray(a, "<f4") for a in (pos, vel, quat))
    count = len(pos)
    if pos.shape != (count, len(ISAAC_ORDER)) or vel.shape != pos.shape or quat.shape != (count, 4):
        raise StreamError(f"SONIC message: positions {pos.shape}, velocities {vel.shape}, quaternions {quat.shape}")
    order = list(ISAAC_ORDER)
    fields = {
        "joint_pos": pos[:, order],
        "joint_vel": vel[:, order],
        "body_quat": quat,
        "frame_index": first_index + np.arange(count, dtype="<i8"),
    }
    kinds = {"<f4": "f32", "<i8": "i64"}
    described = [{"name": n, "dtype": kinds[a.dtype.str], "shape": list(a.shape)} for n, a in fields.items()]
    header = json.dumps({"v": 1, "endian": "le", "count": len(fields), "fields": described}).encode()
    return (
        TOPIC + header.ljust(HEADER_BYTES, b"\0") + b"".join(np.ascontiguousarray(a).tobytes() for a in fields.values())
    )
