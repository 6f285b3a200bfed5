"""Forward kinematics and analytic Jacobians of a rig, for all frames of a trajectory at once.

MuJoCo walks the tree frame by frame; from the joint axes and anchors that it leaves, every Jacobian column of every
body is one cross product, taken here over whole arrays: axis × (point − anchor), and axis for the rotation.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array, cross, quat_mul, rotvec_to_quat

Indices = NDArray[np.intp]

ROOT_DOFS = 6  # of the free joint: metres along the world's axes, then radians about the root's own


@dataclass(frozen=True)
class Tree:
    """A rig's model, and which degrees of freedom carry which body: `carries` (nbody, nv) of 0 and 1."""

    model: mujoco.MjModel
    carries: Array


@dataclass(frozen=True)
class Meetings:
    """n places where two bodies are nearer than a gap: in `frame` (n,), `apart` (n,) metres (below 0: inside each
    other) along `normal` (n, 3), which points from the first of `bodies` (n, 2) to the second, at `place` (n, 3).
    """

    frame: Indices
    bodies: Indices
    apart: Array
    normal: Array
    place: Array

    def of(self, which: Indices) -> Meetings:
        """Those at the indices `which`."""
        return Meetings(self.frame[which], self.bodies[which], self.apart[which], self.normal[which], self.place[which])

    def carried(self, before: Poses, after: Poses) -> Meetings:
        """The same, found at the poses `before`, at nearby poses `after`: the two points stay on their bodies."""
        frame = self.frame[:, None]
        spot = self.place[:, None] - before.place[frame, self.bodies]
        spot = np.einsum("nbij,nbi->nbj", before.matrix[frame, self.bodies], spot)
        spot = np.einsum("nbij,nbj->nbi", after.matrix[frame, self.bodies], spot) + after.place[frame, self.bodies]
        apart = self.apart + np.einsum("ni,ni->n", spot[:, 1] - spot[:, 0], self.normal)
        return replace(self, apart=apart, place=spot.mean(1))


@dataclass(frozen=True)
class Poses:
    """World poses over T frames: `place` (T, nbody, 3) and `turn` (T, nbody, 4) of the bodies, `matrix` (T, nbody, 3,
    3) the same turn; `axis` and `anchor` (T, nv, 3) of the degrees of freedom, of which the first three slide and the
    others turn; `meetings` of bodies.
    """

    place: Array
    turn: Array
    matrix: Array
    axis: Array
    anchor: Array
    meetings: Meetings


def tree_of(model: mujoco.MjModel) -> Tree:
    """The tree of `model`, whose first joint is free and whose other joints are hinges (as `load_model` gives)."""
    carries = np.zeros((model.nbody, model.nv))
    for body in range(1, model.nbody):
        first, count = model.body_dofadr[body], model.body_dofnum[body]
        carries[body] = carries[model.body_parentid[body]]
        carries[body, first : first + count] = 1.0
    return Tree(model, carries)


def poses(tree: Tree, qpos: Array) -> Poses:
    """Poses of the configurations `qpos` (T, nq); bodies meet within the margins of the model's geoms."""
    model, frames = tree.model, len(qpos)
    data = _workspace(model, threading.get_ident())
    place, turn = np.empty((frames, model.nbody, 3)), np.empty((frames, model.nbody, 4))
    matrix = np.empty((frames, model.nbody, 9))
    axis, anchor = np.empty((frames, model.nv, 3)), np.empty((frames, model.nv, 3))
    wary, met = bool(model.geom_margin.any()), []
    now, xpos, xquat, xmat, xaxis, xanchor = (
        data.qpos,
        data.xpos,
        data.xquat,
        data.xmat,
        data.xaxis[1:],
        data.xanchor[1:],
    )
    for frame in range(frames):
        now[:] = qpos[frame]
        mujoco.mj_kinematics(model, data)
        place[frame], turn[frame], matrix[frame] = xpos, xquat, xmat
        axis[frame, ROOT_DOFS:], anchor[frame, ROOT_DOFS:] = xaxis, xanchor
        if wary:
            mujoco.mj_collision(model, data)
            if data.ncon:
                contacts = data.contact
                bodies, normal = model.geom_bodyid[contacts.geom], contacts.frame[:, :3].copy()
                met.append((np.full(data.ncon, frame), bodies, contacts.dist.copy(), normal, contacts.pos.copy()))
    none = (np.zeros(0, int), np.zeros((0, 2), int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
    meetings = Meetings(*(np.concatenate(part) for part in zip(none, *met, strict=True)))
    root = model.jnt_bodyid[0]
    axis[:, :3] = np.eye(3)
    matrix = matrix.reshape(frames, model.nbody, 3, 3)
    axis[:, 3:ROOT_DOFS] = matrix[:, root].swapaxes(1, 2)
    anchor[:, :ROOT_DOFS] = place[:, root, None]
    return Poses(place, turn, matrix, axis, anchor, meetings)


@lru_cache(maxsize=8)
def _workspace(model: mujoco.MjModel, thread: int) -> mujoco.MjData:
    """Where MuJoCo computes, for each thread one: to make it anew takes as long as the poses of many frames."""
    return mujoco.MjData(model)


def velocities(at: Poses, dofs: Indices, points: Array, frames: Indices | slice = slice(None)) -> Array:
    """(T, n, 3) velocities of `points` (T, n or 1, 3) in the world, each for a unit rate of its degree of freedom of
    `dofs` (n,), at `frames` (T,) of `at`.
    """
    axis, anchor = at.axis[frames][:, dofs], at.anchor[frames][:, dofs]
    out = cross(axis, points - anchor)
    slide = dofs < 3
    out[:, slide] = axis[:, slide]
    return out


def twists(at: Poses) -> Array:
    """(T, nv, 6) how a unit rate of each degree of freedom turns what it carries, and moves it where that is at the
    origin of the world.
    """
    out = np.concatenate([at.axis, cross(at.anchor, at.axis)], axis=-1)
    out[:, :3, :3], out[:, :3, 3:] = 0.0, at.axis[:, :3]
    return out


def along(at: Poses, frame: Indices, point: Array, way: Array) -> Array:
    """(n, nv) velocities of `point` (n, 3) along `way` (n, 3), in the world, at `frame` (n,), for a unit rate of each
    degree of freedom.
    """
    wrench = np.concatenate([cross(point, way), way], axis=1)
    return (twists(at)[frame] @ wrench[..., None])[..., 0]


def moved(qpos: Array, step: Array) -> Array:
    """`qpos` (T, 7 + nj) after `step` (T, nv): what mj_integratePos does, over all frames."""
    out = np.empty_like(qpos)
    out[:, :3] = qpos[:, :3] + step[:, :3]
    out[:, 3:7] = quat_mul(qpos[:, 3:7], rotvec_to_quat(step[:, 3:ROOT_DOFS]))
    out[:, 3:7] /= np.linalg.norm(out[:, 3:7], axis=1, keepdims=True)
    out[:, 7:] = qpos[:, 7:] + step[:, ROOT_DOFS:]
    return out


def on_body(at: Poses, bodies: Indices, points: Array) -> Array:
    """(T, k, 3) world positions of `points` (k, 3) or (T, k, 3), each in the frame of its body of `bodies` (k,)."""
    turned = "tkij,tkj->tki" if points.ndim == 3 else "tkij,kj->tki"
    return at.place[:, bodies] + np.einsum(turned, at.matrix[:, bodies], points)
