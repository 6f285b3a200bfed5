"""How far the followers of a rig are from their goals, over all frames, and what brings them there by Gauss-Newton.

Errors are taken in the world: of the position in metres, of the orientation as the rotation vector from the goal. Its
derivative is taken to be the angular velocity; the rest of it, the left Jacobian of the logarithm, leaves the gradient
of the squared error as it is, since it keeps the vector itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate, quat_to_rotvec
from retarget.banded import Equations
from retarget.goals import Goal
from retarget.kinematics import Indices, Poses, Tree, on_body, point_jacobian
from retarget.rest import is_site
from retarget.rig import Rig


@dataclass(frozen=True)
class Mounted:
    """k frames fixed to bodies: `body` (k,), and in that body's frame `spot` (k, 3) and `turn` (k, 4)."""

    body: Indices
    spot: Array
    turn: Array

    def of(self, which: Indices) -> Mounted:
        """Those at the indices `which`."""
        return Mounted(self.body[which], self.spot[which], self.turn[which])

    def places(self, at: Poses) -> Array:
        """World positions (T, k, 3)."""
        return on_body(at, self.body, self.spot)

    def turns(self, at: Poses) -> Array:
        """World orientations (T, k, 4)."""
        return quat_mul(at.turn[:, self.body], self.turn)


@dataclass(frozen=True)
class Targets:
    """`follower` should be at `place` (T, k, 3), turned by `turn` (T, k, 4), as seen from `base` (the world is one).

    `position` and `rotation` (T, k) weigh squared errors, in 1/m² and 1/rad².
    """

    follower: Mounted
    base: Mounted
    place: Array
    turn: Array
    position: Array
    rotation: Array

    def at(self, frames: slice) -> Targets:
        """The same over some of the frames."""
        rows = (part[frames] for part in (self.place, self.turn, self.position, self.rotation))
        return Targets(self.follower, self.base, *rows)


def targets_of(goals: list[Goal], rig: Rig, model: mujoco.MjModel) -> Targets:
    """`goals` as arrays; positions count in units of the rig's nominal root height, so that weights mean the same."""
    bases = [next((f.body for f in rig.follow if f.human == g.base), rig.root) if g.base else "world" for g in goals]
    firm = np.stack([g.firm for g in goals], axis=1)
    return Targets(
        _mounted([g.follow.body for g in goals], model),
        _mounted(bases, model),
        np.stack([g.pos for g in goals], axis=1),
        np.stack([g.quat for g in goals], axis=1),
        (firm * [g.follow.position / rig.nominal.height for g in goals]) ** 2,
        (firm * [g.follow.rotation for g in goals]) ** 2,
    )


def _mounted(names: list[str], model: mujoco.MjModel) -> Mounted:
    body, spot, turn = np.empty(len(names), int), np.zeros((len(names), 3)), np.tile([1.0, 0, 0, 0], (len(names), 1))
    for i, name in enumerate(names):
        if is_site(model, name):
            site = model.site(name)
            body[i], spot[i], turn[i] = site.bodyid[0], site.pos, site.quat
        else:
            body[i] = model.body(name).id
    return Mounted(body, spot, turn)


def errors(targets: Targets, at: Poses) -> tuple[Array, Array]:
    """(T, k, 3) metres and (T, k, 3) radians, from the goals to where the followers are; 0 where nothing is weighed."""
    off, turned = np.zeros_like(targets.place), np.zeros_like(targets.place)
    held, faced = _weighed(targets.position), _weighed(targets.rotation)
    base = targets.base.of(held)
    off[:, held] = targets.follower.of(held).places(at) - base.places(at)
    off[:, held] -= quat_rotate(base.turns(at), targets.place[:, held])
    wanted = quat_mul(targets.base.of(faced).turns(at), targets.turn[:, faced])
    turned[:, faced] = quat_to_rotvec(quat_mul(targets.follower.of(faced).turns(at), quat_conj(wanted)))
    return off, turned


def _weighed(weights: Array) -> Indices:
    return np.flatnonzero(weights.any(0))


def add_tracking(out: Equations, tree: Tree, targets: Targets, at: Poses, off: Array, turned: Array) -> None:
    """Add to `out` the squared errors `off` and `turned` (T, k, 3) of the followers, linear in the step."""
    carried = tree.carries[targets.follower.body] - tree.carries[targets.base.body]
    tracked = _weighed(targets.position)
    points = targets.follower.of(tracked).places(at)
    root = np.sqrt(targets.position[:, None, tracked])
    slide = point_jacobian(at, points, carried[tracked]) * root[:, None]
    slide = slide.reshape(*slide.shape[:2], -1)
    blocks = slide @ slide.swapaxes(1, 2)
    gradient = (slide @ (off[:, tracked].swapaxes(1, 2) * root).reshape(len(off), -1, 1))[..., 0]

    spin = at.axis.copy()
    spin[:, :3] = 0.0
    both = carried[:, :, None] * carried[:, None, :]
    shared = (targets.rotation @ both.reshape(len(both), -1)).reshape(blocks.shape)
    blocks += shared * (spin @ spin.swapaxes(1, 2))
    gradient += ((carried.T @ (targets.rotation[..., None] * turned)) * spin).sum(-1)
    out.blocks(blocks)
    out.diagonal(np.zeros_like(gradient), gradient)


def add_meetings(out: Equations, tree: Tree, at: Poses, near: Array, stiff: float) -> None:
    """Add springs of `stiff` 1/m² that push bodies apart where they meet, by `near` (n,) metres (below 0) too close."""
    met = at.meetings
    axis, anchor = at.axis[met.frame], at.anchor[met.frame]
    velocity = np.cross(axis, met.place[:, None] - anchor)
    velocity[:, :3] = axis[:, :3]
    rows = (velocity @ met.normal[..., None])[..., 0] * (
        tree.carries[met.bodies[:, 1]] - tree.carries[met.bodies[:, 0]]
    )
    rows *= (near < 0)[:, None]
    blocks, gradient = np.zeros((len(at.axis), rows.shape[1], rows.shape[1])), np.zeros((len(at.axis), rows.shape[1]))
    np.add.at(blocks, met.frame, stiff * rows[:, :, None] * rows[:, None])
    np.add.at(gradient, met.frame, stiff * near[:, None] * rows)
    out.blocks(blocks)
    out.diagonal(np.zeros_like(gradient), gradient)
