"""Where the feet of a rig tread: the rectangle that each covers of the floor, and how two are kept from overlapping."""

from __future__ import annotations

from itertools import product

import mujoco
import numpy as np

from motiongen.rotation import Array, quat_rotate

MESH = mujoco.mjtGeom.mjGEOM_MESH


def tread_of(model: mujoco.MjModel, body: int, turn: Array) -> Array:
    """(2, 2) least and greatest x and y, in metres from the origin of `body`, of what of it can touch anything, where
    `turn` (4,) takes the body's axes to those of a sole that is flat and faces +x. All 0 where nothing can.
    """
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
    solid = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
    points = [model.geom_pos[g] + quat_rotate(model.geom_quat[g], _hull(model, g)) for g in solid]
    if not points:
        return np.zeros((2, 2))
    spread = quat_rotate(turn, np.concatenate(points))[:, :2]
    return np.array([spread.min(0), spread.max(0)])


def _hull(model: mujoco.MjModel, geom: int) -> Array:
    """(n, 3) points around the geom, in its own frame."""
    if model.geom_type[geom] == MESH:
        mesh = model.geom_dataid[geom]
        first = model.mesh_vertadr[mesh]
        return np.array(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], float)
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    return middle + half * np.array(list(product((-1, 1), repeat=3)))


def kept_apart(spot: Array, tread: Array, other: Array, its: Array, gap: float) -> Array:
    """(2,) the shortest way in metres that takes a foot at `spot` (x, y, yaw) off one at `other`, `gap` m apart, where
    they cover `tread` and `its` (2, 2): zero where they are.

    Two rectangles are apart where a side of one separates them (the separating axis theorem).
    """
    mine, theirs = _corners(spot, tread), _corners(other, its)
    least, way = np.inf, np.zeros(2)
    for yaw in (spot[2], spot[2] + np.pi / 2, other[2], other[2] + np.pi / 2):
        axis = np.array([np.cos(yaw), np.sin(yaw)])
        a, b = mine @ axis, theirs @ axis
        for lacks, side in ((b.max() + gap - a.min(), axis), (a.max() + gap - b.min(), -axis)):
            if lacks <= 0:
                return np.zeros(2)
            if lacks < least:
                least, way = lacks, lacks * side
    return way


def _corners(spot: Array, tread: Array) -> Array:
    x, y = np.array([(tread[i, 0], tread[j, 1]) for i in (0, 1) for j in (0, 1)]).T
    cosine, sine = np.cos(spot[2]), np.sin(spot[2])
    return spot[:2] + np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=1)
