"""Where a rig may stand: soles on the floor, the polygon they span, and the wrench that they cannot supply."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations

import mujoco
import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import cross
from sim.dynamics import Array, Dynamics
from sim.scene import FLOOR, FRICTION, Scene
from sim.thresholds import rig_size

# Lengths at human size. A point of a sole carries while it is this near the floor, also where it slides; a foot that
# the motion says stands carries with its whole sole. Swinging feet pass higher, see `retarget.feet.CLEARANCE`.
NEAR = 0.005  # m
RELIEF = 0.010  # m above its lowest point that a sole may be and still be sole
ROUNDING = 1e-12  # m², so that rounding does not take an edge for a chord
EDGES = 8  # of the pyramid inside the cone of friction: at most 8 % narrower than the cone


@dataclass(frozen=True)
class Support:
    """The points on which a rig may stand: `points` (T, N, 2) metres on the floor, `on` (T, N) which of them carry."""

    points: Array
    on: NDArray[np.bool_]

    @cached_property
    def edges(self) -> list[tuple[int, int, NDArray[np.bool_]]]:
        """Edges of the support polygons: from point i to point j, anticlockwise, and in which frames (T,)."""
        found = []
        for i, j in permutations(range(self.points.shape[1]), 2):
            along, both = self.points[:, j] - self.points[:, i], self.on[:, i] & self.on[:, j]
            side = _cross(along[:, None], self.points - self.points[:, i, None])
            edge = both & (~self.on | (side >= -ROUNDING)).all(1) & (np.sum(along**2, axis=1) > ROUNDING)
            if edge.any():
                found.append((i, j, edge))
        return found

    def polygon(self, frame: int) -> Array:
        """Corners (M, 2) of the support polygon, anticlockwise; two of a line, one of a point, none in flight."""
        return convex_hull(self.points[frame][self.on[frame]])


def find_soles(scene: Scene) -> dict[str, Array]:
    """Foot name → (K, 3) metres in the frame of its body: where the floor touches it while the rig stands.

    They are MuJoCo's own contact points in the nominal pose. Raises ValueError where a foot has no part that may touch
    the floor, and on a stand, where no foot does.
    """
    if scene.mount == "stand":
        raise ValueError("support: a rig on a stand has none; use mount free or hung")
    rig, model = scene.rig, copy.copy(scene.model)
    relief, floor = RELIEF * rig_size(rig), model.geom(FLOOR).id
    model.geom_margin[floor] = model.body_margin[0] = 5 * relief  # a nominal height is not that exact
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    geoms, distance = data.contact.geom, data.contact.dist
    bodies = model.geom_bodyid[geoms].max(1)  # the floor's is 0
    soles = {}
    for foot in rig.feet:
        body = model.body(foot.body).id
        mine = (geoms == floor).any(1) & (bodies == body)
        if not mine.any():
            raise ValueError(f"rig {rig.name!r}: no part of {foot.body!r} meets the floor in the nominal pose")
        mine &= distance <= distance[mine].min() + relief
        soles[foot.name] = (data.contact.pos[mine] - data.xpos[body]) @ data.xmat[body].reshape(3, 3)
    return soles


def support(scene: Scene, moves: Dynamics, contacts: dict[str, NDArray[np.bool_]]) -> Support:
    """Which points of the soles carry in each frame.

    `contacts`: foot name → (T,) booleans, feet that the motion says stand; see NEAR for all others. Raises ValueError
    as `find_soles` does.
    """
    frames = len(moves.com)
    points, on = [np.empty((frames, 0, 2))], [np.zeros((frames, 0), bool)]
    for i, (name, sole) in enumerate(find_soles(scene).items()):
        at = sole @ np.swapaxes(moves.foot_mat[:, i], 1, 2) + moves.foot_pos[:, i, None]
        told = contacts.get(name, np.zeros(frames, bool))
        points.append(at[..., :2])
        on.append((at[..., 2] < NEAR * rig_size(scene.rig)) | told[:, None])
    return Support(np.concatenate(points, axis=1), np.concatenate(on, axis=1))


def margin(at: Array, ground: Support) -> Array:
    """(T,) metres from the points `at` (T, 2) to the edge of the support polygon, positive inside.

    NaN in frames without support or without point.
    """
    p, on = ground.points, ground.on
    nearest = np.where(on, np.linalg.norm(p - at[:, None], axis=2), np.inf).min(1, initial=np.inf)
    if ground.edges:
        start = np.stack([p[:, i] for i, _, _ in ground.edges], axis=1)  # (T, E, 2)
        along = np.stack([p[:, j] for _, j, _ in ground.edges], axis=1) - start
        edge = np.stack([frames for _, _, frames in ground.edges], axis=1)
        offset, length = at[:, None] - start, np.where(edge, np.sum(along**2, axis=2), 1.0)
        share = np.clip(np.sum(offset * along, axis=2) / length, 0, 1)
        away = np.where(edge, np.linalg.norm(offset - share[..., None] * along, axis=2), np.inf).min(1)
        # A line has two edges too, one in each direction: only on it is a point to the left of both, and not within.
        inside = (~edge | (_cross(along, offset) > 0)).all(1) & edge.any(1)
        nearest = np.where(inside, away, -np.minimum(nearest, away))
    else:
        nearest = -nearest
    return np.where(on.any(1) & np.isfinite(at).all(1), nearest, np.nan)


def convex_hull(points: Array) -> Array:
    """Corners (M, 2), anticlockwise, of the convex hull of (N, 2) points: Andrew's monotone chain (1979)."""
    ordered = sorted({(float(x), float(y)) for x, y in points})
    if len(ordered) < 3:
        return np.reshape(ordered, (-1, 2))
    return np.array(_chain(ordered)[:-1] + _chain(ordered[::-1])[:-1])


def _chain(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """The lower hull of points in order; of the same from last to first, the upper."""
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) > 1:
            (ax, ay), (bx, by) = hull[-2], hull[-1]
            if (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0:
                break
            hull.pop()
        hull.append((x, y))
    return hull


def residual_wrench(scene: Scene, moves: Dynamics, ground: Support) -> Array:
    """(T, 6) N and N·m about the centre of mass: the help from outside that the motion needs, 0 where it can be.

    It is what forces within the cones of friction at the carrying points leave over of the needed wrench, the least in
    the norm in which a moment counts as the force that gives it at the root's height.
    """
    import daqp

    lever, weight, count = scene.rig.nominal.height, scene.weight, ground.points.shape[1]
    angle = 2 * np.pi * np.arange(EDGES) / EDGES
    friction = floor_friction(scene)
    push = np.stack([friction * np.cos(angle), friction * np.sin(angle), np.ones(EDGES)], axis=1)
    arm = np.concatenate([ground.points, np.zeros((len(moves.com), count, 1))], axis=2) - moves.com[:, None]
    turn = cross(arm[:, :, None], push) / lever
    pulls = np.concatenate([np.broadcast_to(push, turn.shape), turn], axis=3)  # (T, N, EDGES, 6)
    needed = np.hstack([moves.force, (moves.moment - cross(moves.com, moves.force)) / lever]) / weight
    left = np.empty_like(needed)
    identity, zero, none = np.eye(6), np.zeros(count * EDGES), np.full(count * EDGES, -1e30)
    kind = np.zeros(count * EDGES, np.int32)
    for k, on in enumerate(ground.on):
        # Moreau: what a cone leaves over is the projection onto its polar cone, a problem of six unknowns.
        rows, n = pulls[k][on].reshape(-1, 6), EDGES * int(on.sum())
        left[k], _, flag, _ = daqp.solve(identity, -needed[k], rows, zero[:n], none[:n], kind[:n])
        if flag < 0:
            raise RuntimeError(f"residual wrench: no solution in frame {k} (daqp says {flag})")
    return left * weight * np.repeat([1.0, lever], 3)


def floor_friction(scene: Scene) -> float:
    """Coefficient of sliding friction between floor and soles: MuJoCo takes the higher of the two."""
    model, feet = scene.model, {scene.model.body(foot.body).id for foot in scene.rig.feet}
    soles = [g for g in range(model.ngeom) if int(model.geom_bodyid[g]) in feet and model.geom_contype[g]]
    return max([FRICTION, *(float(model.geom_friction[g, 0]) for g in soles)])


def _cross(a: Array, b: Array) -> Array:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
