"""Forward kinematics and analytic Jacobians of a rig, for all frames of a trajectory at once.

From the axes and anchors of the joints, every Jacobian column of every body is one cross product, taken over whole
arrays: axis × (point − anchor), and axis for the rotation. Where bodies meet, MuJoCo says, frame by frame.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array, cross
from retarget.contacts import Flags

Indices = NDArray[np.intp]

ROOT_DOFS = 6  # of the free joint: metres along the world's axes, then radians about the root's own
SLIDES = 3  # of these come first and slide


class Bones(NamedTuple):
    """What forward kinematics needs of a model. Of each body its `parent`, `offset` (nbody, 3) and `turn` (nbody, 4) in
    the parent's frame, its `first` degree of freedom and how `many` it has; of each of these, in its body's frame, the
    `axis` and the `anchor` (nv, 3), and the angle `rest` (nv,) at which the body is turned by `turn` alone.
    """

    parent: Indices
    offset: Array
    turn: Array
    first: Indices
    many: Indices
    axis: Array
    anchor: Array
    rest: Array


@dataclass(frozen=True)
class Tree:
    """A rig's model, which degrees of freedom carry which body (`carries` (nbody, nv) of 0 and 1), and its bones."""

    model: mujoco.MjModel
    carries: Array
    bones: Bones


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

    def of(self, which: Flags) -> Meetings:
        """Those where `which` (n,) is set."""
        return Meetings(self.frame[which], self.bodies[which], self.apart[which], self.normal[which], self.place[which])

    def and_those(self, more: Meetings) -> Meetings:
        """Both."""
        return Meetings(*(np.concatenate([getattr(m, f.name) for m in (self, more)]) for f in fields(self)))

    def carried(self, before: Poses, after: Poses, later: int = 0) -> Meetings:
        """The same, found at the poses `before`, at nearby poses `after`, `later` frames on: the two points stay on
        their bodies.
        """
        then = self.frame + later
        frames, others = self.frame[:, None], then[:, None]
        spot = self.place[:, None] - before.place[frames, self.bodies]
        spot = np.einsum("nbij,nbi->nbj", before.matrix[frames, self.bodies], spot)
        spot = np.einsum("nbij,nbj->nbi", after.matrix[others, self.bodies], spot) + after.place[others, self.bodies]
        apart = self.apart + np.einsum("ni,ni->n", spot[:, 1] - spot[:, 0], self.normal)
        return Meetings(then, self.bodies, apart, self.normal, spot.mean(1))


@dataclass(frozen=True)
class Poses:
    """World poses over T frames: `place` (T, nbody, 3) and `turn` (T, nbody, 4) of the bodies, `matrix` (T, nbody, 3,
    3) the same turn; `axis` and `anchor` (T, nv, 3) of the degrees of freedom, of which the first three slide and the
    others turn.
    """

    place: Array
    turn: Array
    matrix: Array
    axis: Array
    anchor: Array


def tree_of(model: mujoco.MjModel) -> Tree:
    """The tree of `model`, whose first joint is free and whose other joints are hinges (as `load_model` gives)."""
    carries = np.zeros((model.nbody, model.nv))
    for body in range(1, model.nbody):
        first, count = model.body_dofadr[body], model.body_dofnum[body]
        carries[body] = carries[model.body_parentid[body]]
        carries[body, first : first + count] = 1.0
    axis, anchor, rest = np.zeros((model.nv, 3)), np.zeros((model.nv, 3)), np.zeros(model.nv)
    axis[ROOT_DOFS:], anchor[ROOT_DOFS:], rest[ROOT_DOFS:] = model.jnt_axis[1:], model.jnt_pos[1:], model.qpos0[7:]
    parent, first, count = (
        np.array(part, np.intp) for part in (model.body_parentid, model.body_dofadr, model.body_dofnum)
    )
    offset, turn = np.array(model.body_pos), np.array(model.body_quat)
    return Tree(model, carries, Bones(parent, offset, turn, first, count, axis, anchor, rest))


def poses(tree: Tree, qpos: Array) -> Poses:
    """Poses of the configurations `qpos` (T, nq)."""
    from retarget import loops

    return Poses(*loops.forward(tree.bones, np.ascontiguousarray(qpos, float)))


def meetings(model: mujoco.MjModel, qpos: Array, frames: Indices | None = None) -> Meetings:
    """Where bodies meet within the margins of the geoms of `model`, in the configurations `qpos` (T, nq): in all of
    them, or in those of `frames`.
    """
    data, met, at, counts = _workspace(model, threading.get_ident()), [], [], []
    for frame in range(len(qpos)) if frames is None else frames:
        data.qpos[:] = qpos[frame]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        if count := data.ncon:
            found = data.contact
            met.append((found.geom.copy(), found.dist.copy(), found.frame[:, :3].copy(), found.pos.copy()))
            at.append(frame)
            counts.append(count)
    none = np.zeros((0, 2), int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    geoms, apart, normal, place = (np.concatenate(part) for part in zip(none, *met, strict=True))
    return Meetings(np.repeat(np.array(at, int), counts), model.geom_bodyid[geoms], apart, normal, place)


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
    slide = dofs < SLIDES
    out[:, slide] = axis[:, slide]
    return out


def on_body(at: Poses, bodies: Indices, points: Array) -> Array:
    """(T, k, 3) world positions of `points` (k, 3) or (T, k, 3), each in the frame of its body of `bodies` (k,)."""
    from retarget import loops

    spots = np.ascontiguousarray(points if points.ndim == 3 else points[None])
    return loops.points_on(at.place, at.matrix, bodies, spots)
