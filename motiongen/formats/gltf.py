"""glTF 2.0 binary (`.glb`) out: the skeleton as nodes, its motion as an animation, a skinned figure so that it is seen.

The file's axes are glTF's: y up, +z front, metres, seconds, quaternions x y z w. All joint frames lie along them in the
bind pose, a T-pose with the soles on the floor. Section numbers are those of the Khronos glTF 2.0 specification. The
format is a JSON document and one block of numbers; no library is needed for these parts of it.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from motiongen.files import replacing
from motiongen.motion import FOOT_JOINTS, Motion, Skeleton
from motiongen.rotation import Array, quat_continuous

_TO_FILE = [1, 2, 0]  # the file's x (left), y (up), z (front) out of our x (front), y (left), z (up)
_FLOAT, _BYTE = 5126, 5121  # component types, 3.6.2.2
_TAIL, _SHORTEST = 0.5, 0.10  # how far the figure goes on past a leaf joint: share of the bone before it, least metres
_WAIST, _GIRTH, _THINNEST = 0.2, 0.12, 0.035  # where a bone is widest, and half its width there, at least 0.035 m


def write_glb(motion: Motion, path: str | Path) -> None:
    """Write `motion` with a linear sampler for every joint's rotation and the root's translation.

    Contacts and all of the labels but their text have no place there. Raises ValueError where the skeleton lacks a foot
    joint, OSError where `path` cannot be written.
    """
    document, blob = _document(motion)
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    with replacing(path) as temporary, temporary.open("wb") as file:  # 4.4: header, then chunks of multiples of 4 bytes
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(blob)))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(blob), b"BIN\0") + blob)


class _Buffer:
    """The block of numbers, and the accessors that say where in it each array lies (3.6)."""

    def __init__(self) -> None:
        self.blob = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: Array, kind: str, component: int = _FLOAT) -> int:
        """Index of a new accessor for `values` (n, …), of which each row is one element of type `kind`."""
        rows = np.ascontiguousarray(values, np.float32 if component == _FLOAT else np.uint8)
        self.views.append({"buffer": 0, "byteOffset": len(self.blob), "byteLength": rows.nbytes})
        self.blob += rows.tobytes()
        flat = rows.reshape(len(rows), -1)
        accessor = {"bufferView": len(self.views) - 1, "componentType": component, "count": len(rows), "type": kind}
        if component == _FLOAT:  # needed for positions and times (3.6.2.5), harmless elsewhere
            accessor |= {"min": flat.min(0).tolist(), "max": flat.max(0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _document(motion: Motion) -> tuple[dict[str, Any], bytes]:
    skeleton, buffer = motion.skeleton, _Buffer()
    rest = _rest(skeleton)
    joints = len(skeleton.names)
    local = skeleton.offsets[:, _TO_FILE]
    local[0] = rest[0]
    nodes: list[dict[str, Any]] = [
        {"name": name, "translation": local[j].tolist(), "rotation": [0, 0, 0, 1]}
        for j, name in enumerate(skeleton.names)
    ]
    for j, parent in enumerate(skeleton.parents[1:], start=1):
        nodes[parent].setdefault("children", []).append(j)
    nodes.append({"name": "figure", "mesh": 0, "skin": 0})
    places, normals, owners = _figure(skeleton, rest)
    bind = np.tile(np.eye(4), (joints, 1, 1))
    bind[:, 3, :3] = -rest  # matrices are stored by columns (3.6.2.4)
    attributes = {
        "POSITION": buffer.add(places, "VEC3"),
        "NORMAL": buffer.add(normals, "VEC3"),
        "JOINTS_0": buffer.add(np.outer(owners, [1, 0, 0, 0]), "VEC4", _BYTE),
        "WEIGHTS_0": buffer.add(np.tile([1.0, 0, 0, 0], (len(owners), 1)), "VEC4"),
    }
    skin = {"joints": list(range(joints)), "skeleton": 0, "inverseBindMatrices": buffer.add(bind, "MAT4")}
    animation = _animation(motion, buffer)
    document = {
        "asset": {"version": "2.0", "generator": "rigcast"},
        "scene": 0,
        "scenes": [{"nodes": [0, joints]}],
        "nodes": nodes,
        "meshes": [{"name": "figure", "primitives": [{"attributes": attributes, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.75, 0.75, 0.8, 1], "metallicFactor": 0}}],
        "skins": [skin],
        "animations": [animation],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.blob)}],
    }
    if motion.source.licence:
        document["asset"] = {**document["asset"], "copyright": motion.source.licence}  # type: ignore[dict-item]
    return document, bytes(buffer.blob)


def _animation(motion: Motion, buffer: _Buffer) -> dict[str, Any]:
    """Samplers and channels (3.11): key frames at the motion's own."""
    times = buffer.add(np.arange(len(motion)) / motion.fps, "SCALAR")
    turns = quat_continuous(motion.joint_quat)[..., [2, 3, 1, 0]]  # x y z w, their axes the file's
    samplers = [{"input": times, "output": buffer.add(motion.root_pos[:, _TO_FILE], "VEC3")}]
    channels: list[dict[str, Any]] = [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
    for j in range(len(motion.skeleton.names)):
        samplers.append({"input": times, "output": buffer.add(turns[:, j], "VEC4")})
        channels.append({"sampler": j + 1, "target": {"node": j, "path": "rotation"}})
    name = "; ".join(label.text for label in motion.labels) or motion.source.generator
    return {"name": name, "samplers": samplers, "channels": channels}


def _rest(skeleton: Skeleton) -> Array:
    """Joint positions (J, 3) of the T-pose in the file's axes, the root over the origin, the soles on the floor."""
    rest = np.zeros_like(skeleton.offsets)
    for j, parent in enumerate(skeleton.parents[1:], start=1):
        rest[j] = rest[parent] + skeleton.offsets[j]
    feet = rest[[skeleton.index(name) for name in FOOT_JOINTS], 2]
    rest[:, 2] -= (feet - np.tile(skeleton.foot_height, 2)).min()
    return rest[:, _TO_FILE]


def _figure(skeleton: Skeleton, rest: Array) -> tuple[Array, Array, Array]:
    """Triangles of a spindle along every bone: corners (n, 3), normals (n, 3), and the joint (n,) that carries each."""
    bones = [(parent, rest[parent], rest[j]) for j, parent in enumerate(skeleton.parents) if parent >= 0]
    for j in range(len(skeleton.names)):
        if j not in skeleton.parents and j:
            before = rest[j] - rest[skeleton.parents[j]]
            bones.append(
                (j, rest[j], rest[j] + before * max(_TAIL, _SHORTEST / max(float(np.linalg.norm(before)), 1e-6)))
            )
    bones = [bone for bone in bones if np.linalg.norm(bone[2] - bone[1]) > 1e-6]
    corners = np.array([_spindle(start, end) for _, start, end in bones])
    normals = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    owners = np.repeat([owner for owner, _, _ in bones], corners.shape[1] * 3)
    return corners.reshape(-1, 3), np.repeat(normals, 3, axis=1).reshape(-1, 3), owners


def _spindle(start: Array, end: Array) -> Array:
    """Eight triangles (8, 3, 3) of a four-sided spindle, counter-clockwise seen from outside."""
    along = end - start
    aside = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    length = float(np.linalg.norm(along))
    aside *= max(_GIRTH * length, _THINNEST) / np.linalg.norm(aside)
    across = np.cross(along, aside) / length
    ring = start + _WAIST * along + np.array([aside, across, -aside, -across])
    after = np.roll(ring, -1, axis=0)
    top = [(a, b, end) for a, b in zip(ring, after, strict=True)]
    bottom = [(b, a, start) for a, b in zip(ring, after, strict=True)]
    return np.array(top + bottom)
