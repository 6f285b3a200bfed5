"""Joint positions to a `Motion`: rotations by plain geometry, joint by joint from the pelvis out.

Positions do not say how a bone is turned about itself. Pelvis and chest have three neighbours each, which fixes them.
A thigh or an upper arm is turned so that knee or elbow bends about its hinge, the more the more it is bent; the spine
shares the twist between pelvis and chest; every other bone takes the shortest way from its parent.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion, Skeleton, Source
from motiongen.rotation import (
    Array,
    matrix_to_quat,
    quat_conj,
    quat_continuous,
    quat_mul,
    quat_rotate,
    shortest_arc,
    slerp,
)
from motiongen.smpl import SMPL_SKELETON

_CLUSTERS = {"pelvis": ("left_hip", "right_hip", "spine1"), "spine3": ("neck", "left_collar", "right_collar")}
_NEXT = {SMPL_JOINTS[p]: SMPL_JOINTS[j] for j, p in enumerate(SMPL_PARENTS) if p >= 0 and p not in (0, 9)}
# Bone → the joint at the end of the next bone, and where in the T-pose frame bone × next bone points when it bends.
_HINGES = {
    "left_hip": ("left_ankle", (0.0, 1.0, 0.0)),
    "right_hip": ("right_ankle", (0.0, 1.0, 0.0)),
    "left_shoulder": ("left_wrist", (0.0, 0.0, -1.0)),
    "right_shoulder": ("right_wrist", (0.0, 0.0, 1.0)),
}
_STRAIGHT = 0.2  # sine of the bend at which hinge and shortest way count alike


def motion_from_positions(positions: ArrayLike, fps: float, source: Source, skeleton: Skeleton | None = None) -> Motion:
    """The motion whose 22 joints pass through `positions` (T, 22, 3) in metres, z up.

    Bone lengths are the means over the clip, unless `skeleton` (canonical joints) gives them; where lengths change
    over time, directions are kept. Raises ValueError on another shape, NaN, or bones of no length.
    """
    where = np.asarray(positions, float)
    if where.ndim != 3 or where.shape[1:] != (len(SMPL_JOINTS), 3) or not len(where):
        raise ValueError(f"joint positions {where.shape}, expected (T, {len(SMPL_JOINTS)}, 3)")
    if not np.isfinite(where).all():
        raise ValueError(f"frame {int(np.isfinite(where).all((1, 2)).argmin())} holds NaN or infinity")
    bones = where[:, 1:] - where[:, SMPL_PARENTS[1:]]
    lengths = np.linalg.norm(bones, axis=-1)
    if lengths.min() < 1e-4:
        frame, j = np.argwhere(lengths < 1e-4)[0]
        raise ValueError(f"frame {frame}: the bone to {SMPL_JOINTS[j + 1]} has no length")
    body = skeleton or _sized(lengths.mean(0))
    turns: dict[str, Array] = {name: _cluster(where, name, body) for name in _CLUSTERS}
    if skeleton is None:
        body = _with_clusters(body, where, turns)
    for j, name in enumerate(SMPL_JOINTS):
        if name not in turns:
            turns[name] = _turn(name, _before(name, SMPL_JOINTS[SMPL_PARENTS[j]], turns), where, body)
    world = np.stack([turns[name] for name in SMPL_JOINTS], axis=1)
    local = world.copy()
    for j, parent in enumerate(SMPL_PARENTS[1:], start=1):
        local[:, j] = quat_mul(quat_conj(world[:, parent]), world[:, j])
    return Motion(where[:, 0], quat_continuous(local), fps, body, source=source)


def fill_joints(places: Array, at: Mapping[str, int]) -> Array:
    """Positions (T, 22, 3) out of `places` (T, n, 3), `at` its rows by canonical name; joints without one are spread
    evenly along the bone that skips them.
    """
    out = np.zeros((len(places), len(SMPL_JOINTS), 3))
    for j, name in enumerate(SMPL_JOINTS):
        if name in at:
            out[:, j] = places[:, at[name]]
            chain = skipped_joints(j, at) if j else []
            for k, missing in enumerate(chain[:-1], start=1):
                start = out[:, SMPL_PARENTS[chain[0]]]
                out[:, missing] = start + (out[:, j] - start) * k / len(chain)
    return out


def skipped_joints(joint: int, known: Collection[str]) -> list[int]:
    """`joint` and the canonical joints above it that are not among the `known` names, the highest first."""
    chain = [joint]
    while SMPL_JOINTS[SMPL_PARENTS[chain[0]]] not in known:
        chain.insert(0, SMPL_PARENTS[chain[0]])
    return chain


def _sized(lengths: Array) -> Skeleton:
    """The canonical T-pose with bones of these lengths (21,)."""
    offsets = SMPL_SKELETON.offsets.copy()
    offsets[1:] *= (lengths / np.linalg.norm(offsets[1:], axis=1))[:, None]
    return replace(SMPL_SKELETON, offsets=offsets)


def _cluster(where: Array, name: str, body: Skeleton) -> Array:
    """Best rotation (T, 4) of a joint's rest offsets onto its neighbours (Kabsch 1976)."""
    at, around = SMPL_JOINTS.index(name), [SMPL_JOINTS.index(n) for n in _CLUSTERS[name]]
    found = where[:, around] - where[:, at, None]
    u, _, vt = np.linalg.svd(np.einsum("tni,nj->tij", found, body.offsets[around]))
    vt[:, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return matrix_to_quat(u @ vt)


def _with_clusters(body: Skeleton, where: Array, turns: dict[str, Array]) -> Skeleton:
    """Offsets within pelvis and chest as the clip has them on average."""
    offsets = body.offsets.copy()
    for name, neighbours in _CLUSTERS.items():
        for j in (SMPL_JOINTS.index(n) for n in neighbours):
            offsets[j] = quat_rotate(quat_conj(turns[name]), where[:, j] - where[:, SMPL_PARENTS[j]]).mean(0)
    return replace(body, offsets=offsets)


def _before(name: str, parent: str, turns: dict[str, Array]) -> Array:
    """What a joint is turned by before its own bone is aimed: as its parent is, the spine with a share of twist."""
    share = {"spine1": 1 / 3, "spine2": 1 / 2}.get(name)
    return turns[parent] if share is None else slerp(turns[parent], turns["spine3"], np.array(share))


def _turn(name: str, before: Array, where: Array, body: Skeleton) -> Array:
    if name not in _NEXT:
        return before
    at, end = SMPL_JOINTS.index(name), SMPL_JOINTS.index(_NEXT[name])
    bone = _unit(where[:, end] - where[:, at])
    rest = _unit(body.offsets[end])
    swung = quat_mul(shortest_arc(quat_rotate(before, rest), bone), before)
    if name not in _HINGES:
        return swung
    tip, axis = SMPL_JOINTS.index(_HINGES[name][0]), np.array(_HINGES[name][1])
    hinge = np.cross(bone, _unit(where[:, tip] - where[:, end])) + _STRAIGHT * quat_rotate(swung, axis)
    return matrix_to_quat(_frame(bone, hinge) @ _frame(rest, axis).T)


def _frame(bone: Array, hinge: Array) -> Array:
    """Matrix (..., 3, 3) whose first column is `bone` and whose last is `hinge` as far as it is across the bone."""
    side = _unit(np.cross(hinge, bone))
    return np.stack([bone, side, np.cross(bone, side)], axis=-1)


def _unit(v: Array) -> Array:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)
