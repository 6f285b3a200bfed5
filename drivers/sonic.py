"""Frames as GEAR-SONIC's whole-body controller takes them over ZeroMQ, made and read: version 1 of its `pose` messages.

A message is the topic, a JSON header padded with zeros to 1280 bytes that names each field with its type and shape, and
the fields one after the other, little-endian: `joint_pos` and `joint_vel` (N, 29), `body_quat` (N, 4) w x y z and
`frame_index` (N,), at 50 frames a second. The joints are Unitree G1's, in the order in which Isaac Lab counts them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

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
ROBOT = "unitree_g1"
KINDS = {"f32": "<f4", "f64": "<f8", "i32": "<i4", "i64": "<i8"}
MOST_FRAMES = 64  # in a message: over a second of what is to come
UNIT = 1e-2  # by which the length of a quaternion may be off
FURTHEST = 10.0  # rad: no joint of the robot turns half as far


class SonicError(ValueError):
    """A message that is no version 1 of SONIC's; one line says why."""


@dataclass(frozen=True)
class Sonic:
    """N frames, 50 a second: `index` (N,) since the stream began, `pos` (N, 29) rad in MuJoCo's order; `quat` (N, 4) w
    x y z, the pelvis' orientation in the world.
    """

    index: NDArray[np.int64]
    pos: NDArray[np.float64]
    quat: NDArray[np.float64]


class _Field(msgspec.Struct):
    name: str
    dtype: str
    shape: tuple[int, ...]


class _Header(msgspec.Struct):
    v: int
    endian: str
    fields: tuple[_Field, ...]


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


def read_sonic(data: bytes) -> Sonic:
    """The frames of a message; fields that version 1 does not know are skipped. Raises SonicError."""
    body = len(TOPIC) + HEADER_BYTES
    if not data.startswith(TOPIC) or len(data) < body:
        raise SonicError(f"SONIC: {len(data)} bytes that begin with {data[:4]!r}: no message of {TOPIC.decode()!r}")
    try:
        header = msgspec.json.decode(data[len(TOPIC) : body].rstrip(b"\0"), type=_Header)
    except msgspec.DecodeError as error:
        raise SonicError(f"SONIC: header: {error}") from None
    if (header.v, header.endian) != (1, "le"):
        raise SonicError(f"SONIC: version {header.v}, endian {header.endian[:10]!r}; read is version 1, 'le'")
    fields = _fields(data, body, header.fields)
    if missing := [name for name in ("joint_pos", "body_quat", "frame_index") if name not in fields]:
        raise SonicError(f"SONIC: no field {', '.join(missing)}")
    index, pos, quat = (fields[name] for name in ("frame_index", "joint_pos", "body_quat"))
    count = len(index)
    if not 0 < count <= MOST_FRAMES or index.shape != (count,) or index.dtype.kind != "i":
        raise SonicError(f"SONIC: frame_index of {index.shape} {index.dtype}; integers (N,), N in 1…{MOST_FRAMES}")
    if pos.shape != (count, len(ISAAC_ORDER)) or quat.shape != (count, 4):
        raise SonicError(f"SONIC: joint_pos {pos.shape} and body_quat {quat.shape} beside {count} frames")
    if not (np.abs(pos) <= FURTHEST).all() or not (np.abs(np.linalg.norm(quat, axis=1) - 1) <= UNIT).all():
        raise SonicError(f"SONIC: frame {index[0]}: a joint beyond {FURTHEST:g} rad or a quaternion not of length 1")
    if (np.diff(index) != 1).any() or index[0] < 0:
        raise SonicError(f"SONIC: frame_index from {index[0]} to {index[-1]} is not one after the other")
    ordered = np.empty(pos.shape)
    ordered[:, list(ISAAC_ORDER)] = pos
    return Sonic(index.astype(np.int64), ordered, quat / np.linalg.norm(quat, axis=1, keepdims=True))


def _fields(data: bytes, at: int, described: tuple[_Field, ...]) -> dict[str, NDArray[np.generic]]:
    found: dict[str, NDArray[np.generic]] = {}
    for field in described:
        if field.dtype not in KINDS or len(field.shape) > 2 or any(not 0 <= n <= 1024 for n in field.shape):
            raise SonicError(f"SONIC: field {field.name[:40]!r} of {field.dtype[:10]} {field.shape}")
        count, kind = int(np.prod(field.shape)), np.dtype(KINDS[field.dtype])
        if at + count * kind.itemsize > len(data):
            raise SonicError(f"SONIC: field {field.name[:40]!r} goes beyond the {len(data)} bytes of the message")
        found[field.name] = np.frombuffer(data, kind, count, at).reshape(field.shape)
        at += count * kind.itemsize
    if at != len(data):
        raise SonicError(f"SONIC: {len(data) - at} bytes are left over")
    return found
