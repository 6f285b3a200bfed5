"""BVH in: any skeleton whose joints can be told, brought to the canonical 22.

A BVH file may draw its zero pose any way it likes: in Bandai-Namco's every bone lies along ±x. To turn a file's joint
frames to the canonical ones (all along the world's axes in the T-pose) one must know where they point in a T-pose:

1. a skeleton in `motiongen.skeletons.TABLES` says so, joint by joint;
2. else joints are matched by name, and where the zero pose or the first frame is near a T-pose, it is taken from there,
   legs and arms straightened;
3. else (LAFAN1) the names give positions, and rotations are fitted to them (`formats.fit`).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from motiongen.formats.bvh_raw import BvhError, RawBvh, read_raw
from motiongen.formats.fit import fill_joints, motion_from_positions, skipped_joints
from motiongen.formats.ground import on_floor
from motiongen.formats.joint_names import match_joints
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion, Skeleton, Source
from motiongen.rotation import (
    Array,
    axis_angle_to_quat,
    matrix_to_quat,
    quat_continuous,
    quat_to_matrix,
    shortest_arc,
)
from motiongen.skeletons import TABLES, SkeletonTable
from motiongen.smpl import SMPL_SKELETON

_DIRECTIONS = {"F": (1, 0, 0), "B": (-1, 0, 0), "L": (0, 1, 0), "R": (0, -1, 0), "U": (0, 0, 1), "D": (0, 0, -1)}
_Y_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # x, y, z of ours from z, x, y
_UNITS = {"metres": 1.0, "inches": 0.0254, "centimetres": 0.01, "millimetres": 0.001}
_LEG_M = (0.5, 1.2)  # what thigh and shin of a person measure together, from child to giant
# Bones that a T-pose draws straight: canonical joint → where the bone to the next joint points.
_STRAIGHT = {"hip": "D", "knee": "D", "shoulder": "L", "elbow": "L"}
_NEXT = {"hip": "knee", "knee": "ankle", "shoulder": "elbow", "elbow": "wrist"}
_SHOWN = 40  # names of the file in an error
_NEAR = np.cos(np.radians(60))  # an A-pose with arms 45° down still counts


def read_bvh(path: str | Path) -> Motion:
    """Read a BVH file and return it on the canonical 22 joints, in metres, z up.

    Raises BvhError where the file is not BVH, is cut short, holds NaN, zero frames or a frame time that is not above
    0, or where a needed joint cannot be told by its name (the message lists them); OSError where it cannot be opened.
    """
    raw = read_raw(path)
    try:
        return canonical(raw, f"file {Path(path).name}")
    except ValueError as error:
        raise BvhError(f"{path}: {error}") from None


def canonical(raw: RawBvh, name: str) -> Motion:
    """The motion in `raw`, in metres, z up; `name` becomes its source.

    Raises ValueError where a needed joint finds no match or the figure's size fits no unit.
    """
    turn, where = forward(raw)
    for table in TABLES.values():
        if set(table.joints.values()) <= set(raw.names) and (table.own_names or _limbs_fit(raw, table)):
            motion = _from_frames(raw, table.joints, _table_rest(table), _Y_UP, table.unit, turn, where)
            motion = _described(motion, table.foot_height, name, table.licence)
            return motion if table.floor else on_floor(motion)
    joints, missing = match_joints(raw.names, raw.parents)
    if missing:
        some = ", ".join(raw.names[:_SHOWN]) + (", …" if len(raw.names) > _SHOWN else "")
        raise ValueError(f"unknown skeleton: no joint by name for {', '.join(missing)} among {some}")
    at = {joint: raw.names.index(n) for joint, n in joints.items()}
    world = _world_axes(where, at)
    unit_name, unit = _unit(where, at)
    heights = SMPL_SKELETON.foot_height
    source = f"{name} (joints by name, {unit_name})"
    rest = _pose_rest(raw, turn, where, at)
    if rest is not None:
        return on_floor(_described(_from_frames(raw, joints, rest, world, unit, turn, where), heights, source))
    places = fill_joints(where @ world.T * unit, at)
    return on_floor(motion_from_positions(places, raw.fps, Source(f"{source}; rotations fitted")))


def forward(raw: RawBvh) -> tuple[Array, Array]:
    """World rotations (T, J, 3, 3) and positions (T, J, 3) in the file's frame and unit."""
    local = quat_to_matrix(raw.quats)
    turn, where = local.copy(), raw.positions.copy()
    for j, parent in enumerate(raw.parents):
        if parent >= 0:
            turn[:, j] = turn[:, parent] @ local[:, j]
            where[:, j] = where[:, parent] + np.einsum("tij,tj->ti", turn[:, parent], raw.positions[:, j])
    return turn, where


def _described(motion: Motion, heights: tuple[float, float], name: str, licence: str = "") -> Motion:
    skeleton = replace(motion.skeleton, foot_height=heights)
    return replace(motion, skeleton=skeleton, source=Source(name, licence=licence))


def _table_rest(table: SkeletonTable) -> dict[str, Array]:
    """Matrix (3, 3) by file name, whose columns are the joint's local axes in canonical coordinates in the T-pose."""
    frames = {}
    for name, letters in table.axes.items():
        axes = np.array([_DIRECTIONS[c] for c in letters], float).T
        pitch = quat_to_matrix(axis_angle_to_quat([0.0, 1.0, 0.0], table.pitch.get(name, 0.0)))
        frames[name] = pitch @ axes
    return frames


def _limbs_fit(raw: RawBvh, table: SkeletonTable) -> bool:
    """Whether arms and legs lie in the file's joint frames as they must for the table's T-pose to be one."""
    rest = _table_rest(table)
    for joint, name in table.joints.items():
        side, _, part = joint.partition("_")
        if part in _STRAIGHT:
            bone = rest[name] @ raw.offsets[raw.names.index(table.joints[f"{side}_{_NEXT[part]}"])]
            if bone @ _straight(side, part) <= _NEAR * np.linalg.norm(bone):
                return False
    return True


def _straight(side: str, part: str) -> Array:
    """Where the bone that starts at a limb's joint points in a T-pose."""
    letter = _STRAIGHT[part]
    return np.array(_DIRECTIONS["R" if (side, letter) == ("right", "L") else letter], float)


def _from_frames(
    raw: RawBvh, joints: dict[str, str], rest: dict[str, Array], world: Array, unit: float, turn: Array, where: Array
) -> Motion:
    """The motion, given each joint's axes in the T-pose (`rest`) and the file's world axes in ours (`world`).

    A canonical joint without one in the file turns with its parent and shares the bone that skips it.
    """
    turns: dict[str, Array] = {}
    offsets = np.zeros((len(SMPL_JOINTS), 3))
    for j, name in enumerate(SMPL_JOINTS):
        if name not in joints:
            turns[name] = turns[SMPL_JOINTS[SMPL_PARENTS[j]]]
            continue
        here = raw.names.index(joints[name])
        turns[name] = world @ turn[:, here] @ rest[joints[name]].T
        if j:
            skipped = skipped_joints(j, joints)
            above = SMPL_JOINTS[SMPL_PARENTS[skipped[0]]]
            bone = (where[:, here] - where[:, raw.names.index(joints[above])]) @ world.T * unit
            offsets[skipped] = np.einsum("tji,tj->ti", turns[above], bone).mean(0) / len(skipped)
    matrices = np.stack([turns[n] for n in SMPL_JOINTS], axis=1)
    local = matrices.copy()
    for j, parent in enumerate(SMPL_PARENTS[1:], start=1):
        local[:, j] = np.swapaxes(matrices[:, parent], -1, -2) @ matrices[:, j]
    root = where[:, raw.names.index(joints["pelvis"])] @ world.T * unit
    skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, offsets)
    return Motion(root, quat_continuous(matrix_to_quat(local)), raw.fps, skeleton)


def _world_axes(where: Array, at: dict[str, int]) -> Array:
    """Ours out of the file's axes: y or z is up, whichever the trunk follows over the clip; y up is BVH's habit."""
    trunk = np.abs((where[:, at["neck"]] - where[:, at["pelvis"]]).mean(0))
    return np.eye(3) if trunk[2] > trunk[1] else _Y_UP


def _unit(where: Array, at: dict[str, int]) -> tuple[str, float]:
    leg = sum(
        np.linalg.norm(where[:, at[f"left_{a}"]] - where[:, at[f"left_{b}"]], axis=-1).mean()
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    )
    for name, metres in _UNITS.items():
        if _LEG_M[0] <= leg * metres <= _LEG_M[1]:
            return name, metres
    raise ValueError(f"a leg of {leg:.4g} is no person's in {', '.join(_UNITS)}")


def _pose_rest(raw: RawBvh, turn: Array, where: Array, at: dict[str, int]) -> dict[str, Array] | None:
    """Joint axes in the T-pose, by file name, from the zero pose or else the first frame; None where none is near."""
    unturned = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(raw.names), 1))
    zero = replace(raw, positions=raw.offsets[None], quats=unturned)
    for turns, places in (forward(zero), (turn[:1], where[:1])):
        found = _straightened(turns[0], places[0], at)
        if found is not None:
            return {raw.names[at[joint]]: axes for joint, axes in found.items()}
    return None


def _straightened(turns: Array, places: Array, at: dict[str, int]) -> dict[str, Array] | None:
    """Axes (3, 3) by canonical joint in a pose that is near a T-pose, made exactly one; None where it is not near."""
    left = places[at["left_hip"]] - places[at["right_hip"]]
    up = places[at["neck"]] - places[at["pelvis"]]
    up = np.eye(3)[np.abs(up).argmax()] * np.sign(up[np.abs(up).argmax()])
    left = left - up * (left @ up)
    if np.linalg.norm(left) < 1e-6 * np.abs(places).max():
        return None
    left = left / np.linalg.norm(left)
    body = np.stack([np.cross(left, up), left, up])
    out = {joint: body @ turns[j] for joint, j in at.items()}
    for joint in at:
        side, _, part = joint.partition("_")
        if part in _STRAIGHT:
            want = _straight(side, part)
            bone = body @ (places[at[f"{side}_{_NEXT[part]}"]] - places[at[joint]])
            bone = bone / max(np.linalg.norm(bone), 1e-12)
            if bone @ want < _NEAR:
                return None
            out[joint] = quat_to_matrix(shortest_arc(bone, want)) @ out[joint]
    return out
