"""Balance of a whole motion: the root is shifted so that the zero-moment point stays within the soles.

For a body of height z that moves as one, a shift c of its centre of mass moves the zero-moment point by c − z/g · c̈
(Kajita's cart on a table). So the least shift for which the zero-moment point keeps within the soles, and wanders no
more than it must, is a least-squares problem over all frames, with a spring for every edge that is overstepped. A rig
is no point: the zero-moment point of what comes out is computed anew from all its parts, and what is left is shifted
again.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from motiongen.rotation import Array, quat_rotate
from sim.dynamics import dynamics
from sim.mending.body import GRAVITY, Body
from sim.mending.feet import Feet
from sim.support import convex_hull

FIRM = 1e4  # of the springs at the edges
CALM = 10.0  # beats², against the speed of what the shift adds to the zero-moment point
STEADY = 1e5  # against second differences from one frame to the next, to which `rates` is blind
RESTING = 1e4  # against moving in the first and in the last frames
ENDS = 8  # frames: more than a second difference looks to either side, so that the first and the last are still
STEPS = 12  # at most
ENOUGH = 1e-4  # m: a step that changes less is the last
REACH = 5  # frames to either side, of the rate of a zero-moment point
SMALLEST = 0.1  # of half a sole, that a margin leaves of it


def shift(body: Body, qpos: Array, feet: Feet, fps: float, margin: float) -> tuple[Array, float]:
    """(T, 2) metres by which the root of `qpos` (T, 7 + nj) is to move so that the zero-moment point keeps `margin` (m)
    from the edges of the soles; and by how many metres it is beyond that now, at most.
    """
    moves = dynamics(body.scene, qpos, fps)
    areas = areas_of(body, feet, margin)
    zmp = np.where(np.isnan(moves.zmp), moves.com[:, :2], moves.zmp)  # a body in free fall has none
    off = zmp - nearest(zmp, areas)[0]
    height = float(moves.com[:, 2].mean())
    return least_shift(zmp, areas, height, body.beat, fps), float(np.linalg.norm(off, axis=1).max())


def least_shift(zmp: Array, areas: Array, height: float, beat: float, fps: float) -> Array:
    """(T, 2) metres: the shift of a centre of mass at `height` (m) that brings `zmp` (T, 2) into `areas` (T, M, 2).

    Of all it is the least in the sum of its squares and, CALM `beat`² times, of those of the speed of what it adds.
    """
    from scipy.linalg import solveh_banded
    from scipy.sparse import bsr_array, diags_array, eye_array, kron

    count = len(zmp)
    cart = eye_array(count) - height / GRAVITY * fps**2 * second_difference(count)
    step = diags_array([-1.0, 1.0], offsets=[0, 1], shape=(count - 1, count))
    bend = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    rests = np.zeros(count - 1)
    rests[:ENDS] = rests[-ENDS:] = RESTING
    pull = (
        eye_array(count)
        + CALM * (beat * fps) ** 2 * cart.T @ step.T @ step @ cart
        + STEADY * bend.T @ bend
        + step.T @ diags_array(rests) @ step
    )
    pull, cart = kron(pull, eye_array(2)).tocsr(), kron(cart, eye_array(2)).tocsr()  # x and y of each frame in turn
    x = np.zeros(2 * count)
    for _ in range(STEPS):
        at = zmp + (cart @ x).reshape(-1, 2)
        spot, across = nearest(at, areas)
        spring = FIRM * cart.T @ bsr_array((across, np.arange(count), np.arange(count + 1))).tocsr()
        curvature, gradient = (pull + spring @ cart).todia(), pull @ x + FIRM * cart.T @ (at - spot).ravel()
        band = np.zeros((2 * (2 * REACH + 1), 2 * count))
        for k in range(len(band)):
            band[k, : 2 * count - k] = curvature.diagonal(-k)
        change = solveh_banded(band, gradient, lower=True, check_finite=False)
        x -= change
        if np.abs(change).max() < ENOUGH:
            break
    return x.reshape(-1, 2)


def second_difference(count: int) -> Any:
    """Sparse (count, count): the second difference that `sim.dynamics.rates` takes, for a step of one frame."""
    from scipy.sparse import diags_array

    ends = np.r_[0, np.arange(count - 1), count - 2]  # the first and the last step once more
    step = diags_array([-1.0, 1.0], offsets=[0, 1], shape=(count - 1, count)).tocsr()[ends]
    mean = diags_array([0.5, 0.5], offsets=[0, 1], shape=(count, count + 1))
    slope = diags_array([-0.5, 0.5], offsets=[-1, 1], shape=(count, count)).tolil()
    slope[0, :2], slope[-1, -2:] = (-1.0, 1.0), (-1.0, 1.0)
    return slope.tocsr() @ mean @ step


def areas_of(body: Body, feet: Feet, margin: float) -> Array:
    """(T, M, 2) corners of the support polygon of every frame, of soles that are smaller by `margin` (m) all round;
    where there are fewer the last one comes again.
    """
    corners = []
    for i, leg in enumerate(body.legs):
        low, high = leg.sole.min(0), leg.sole.max(0)
        centre, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
        sole = centre + np.maximum(1 - margin / half, SMALLEST) * (leg.sole - centre)
        corners.append(feet.place[:, i, None, :2] + quat_rotate(feet.turn[:, i, None], sole[None])[..., :2])
    known: dict[bytes, Array] = {}
    hulls = []
    for k, stands in enumerate(feet.stands):
        points = np.concatenate([c[k] for i, c in enumerate(corners) if stands[i]])
        hulls.append(known.setdefault(points.tobytes(), convex_hull(points)))
    most = max(map(len, hulls))
    return np.array([np.concatenate([hull, np.repeat(hull[-1:], most - len(hull), axis=0)]) for hull in hulls])


def nearest(points: Array, areas: Array) -> tuple[Array, Array]:
    """The point of each convex polygon of `areas` (T, M, 2), anticlockwise, that is nearest to that of `points` (T, 2);
    and the projection (T, 2, 2) onto what leads away from it: nil inside, across an edge, or all at a corner.
    """
    along = np.roll(areas, -1, axis=1) - areas
    offset = points[:, None] - areas
    square = np.maximum((along**2).sum(-1), 1e-300)
    inside = np.all(along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0] >= 0, axis=1)
    share = np.clip((offset * along).sum(-1) / square, 0, 1)
    on = areas + share[..., None] * along
    every, which = np.arange(len(points)), np.argmin(np.square(points[:, None] - on).sum(-1), axis=1)
    edge = along[every, which] / np.sqrt(square[every, which])[:, None]
    across = np.stack([-edge[:, 1], edge[:, 0]], axis=1)
    on_edge = (share[every, which] > 0) & (share[every, which] < 1)
    away = np.where(on_edge[:, None, None], across[:, :, None] * across[:, None, :], np.eye(2))
    return np.where(inside[:, None], points, on[every, which]), np.where(inside[:, None, None], 0.0, away)
