"""How far the followers of a rig are from their goals, over all frames, and what brings them there by Gauss-Newton.

Errors are taken in the world: of the position in metres, of the orientation as the rotation vector from the goal. Its
derivative is taken to be the angular velocity; the rest of it, the left Jacobian of the logarithm, leaves the gradient
of the squared error as it is, since it keeps the vector itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate
from retarget import loops
from retarget.goals import Goal
from retarget.kinematics import Indices, Poses, Tree, on_body
from retarget.rest import is_site
from retarget.rig import Rig


@dataclass(frozen=True)
class Places:
    """k points and where they should be over T frames: `spot` (k, 3) of `body` (k,) at `place` (T, k, 3) of `base`
    (k,), each in its body's frame; `weight` (T, k) weighs squared distances, in 1/m².
    """

    body: Indices
    spot: Array
    base: Indices
    place: Array
    weight: Array

    def at(self, frames: slice | list[int]) -> Places:
        """The same over some of the frames."""
        return replace(self, place=self.place[frames], weight=self.weight[frames])

    def then(self, more: Places) -> Places:
        """The frames of both, one after the other."""
        return replace(
            self, place=np.concatenate([self.place, more.place]), weight=np.concatenate([self.weight, more.weight])
        )


@dataclass(frozen=True)
class Turns:
    """k bodies and how they should be turned: `body` (k,) by `turn` (T, k, 4) as seen from `base` (k,); `weight` (T, k)
    weighs squared angles, in 1/rad².
    """

    body: Indices
    base: Indices
    turn: Array
    weight: Array

    def at(self, frames: slice | list[int]) -> Turns:
        """The same over some of the frames."""
        return replace(self, turn=self.turn[frames], weight=self.weight[frames])

    def then(self, more: Turns) -> Turns:
        """The frames of both, one after the other."""
        return replace(
            self, turn=np.concatenate([self.turn, more.turn]), weight=np.concatenate([self.weight, more.weight])
        )


def targets_of(goals: list[Goal], rig: Rig, model: mujoco.MjModel) -> tuple[Places, Turns]:
    """What `goals` weigh, as arrays; distances in units of the rig's nominal root height, so that weights mean the same
    on every size.
    """
    body, spot, own = (np.array(part) for part in zip(*(_frame(g.follow.body, model) for g in goals), strict=True))
    base, origin, way = (np.array(part) for part in zip(*(_frame(_base(g, rig), model) for g in goals), strict=True))
    pos, quat, firm = (np.stack([getattr(g, part) for g in goals], axis=1) for part in ("pos", "quat", "firm"))
    position, rotation = np.array([[g.follow.position, g.follow.rotation] for g in goals]).T
    place = origin + quat_rotate(way, pos)
    turn = quat_mul(quat_mul(way, quat), quat_conj(own))
    held, faced = np.flatnonzero(position), np.flatnonzero(rotation)
    near, alike = (firm * position / rig.nominal.height) ** 2, (firm * rotation) ** 2
    return (
        Places(body[held], spot[held], base[held], place[:, held], near[:, held]),
        Turns(body[faced], base[faced], turn[:, faced], alike[:, faced]),
    )


def _frame(name: str, model: mujoco.MjModel) -> tuple[int, Array, Array]:
    """The body that the site or body `name` belongs to, and the site's place (3,) and turn (4,) there."""
    if is_site(model, name):
        site = model.site(name)
        return int(site.bodyid[0]), site.pos, site.quat
    return model.body(name).id, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])


def _base(goal: Goal, rig: Rig) -> str:
    return next((f.body for f in rig.follow if f.human == goal.base), rig.root) if goal.base else "world"


def reached(places: Places, at: Poses) -> tuple[Array, Array]:
    """Where the points are in the world and how far that is from where they should be: (T, k, 3) each, in metres."""
    points = on_body(at, places.body, places.spot)
    return points, points - on_body(at, places.base, places.place)


def angles(turns: Turns, at: Poses) -> Array:
    """(T, k, 3) rotation vectors in the world, from how the bodies should be turned to how they are."""
    return loops.turns_off(at.turn, turns.body, turns.base, np.ascontiguousarray(turns.turn))


def pulls(
    tree: Tree, places: Places, turns: Turns, at: Poses, points: Array, off: Array, turned: Array
) -> tuple[Array, Array]:
    """Half the weighted squares of `off`, as `reached` gives it with `points`, and of `turned`, as `angles` gives it:
    by Gauss-Newton the lower half of their curvature (T, nv, nv), and their gradient (T, nv).
    """
    frames, nv = len(off), tree.carries.shape[1]
    curvature, gradient = np.zeros((frames, nv, nv)), np.zeros((frames, nv))
    for of, where, miss in ((places, points, off), (turns, points[:0], turned)):
        carried = tree.carries[of.body] - tree.carries[of.base]
        weight = np.ascontiguousarray(of.weight)
        loops.add_pulls(at.axis, at.anchor, carried, where, miss, weight, curvature, gradient)
    return curvature, gradient
