"""Limbs that go through the body, pushed apart: in each frame the way in which the gap grows fastest."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array
from retarget.banded import SECOND, Equations
from retarget.kinematics import ROOT_DOFS, Meetings, meetings, poses, tree_of, velocities
from retarget.model import load_model
from retarget.rig import Rig
from sim.thresholds import limit_for

CLEAR = 0.015  # of the root's height, that parts are apart which would overlap
FIRM = 1e3  # of the springs between them, in rad² per root height²: what hardly opens a gap is not moved far for it
SMOOTH = 0.06  # s, over which what is added comes and goes
ROUNDS = 10
WORTH = 1e-3  # rad: a round that changes less is the last


@dataclass(frozen=True)
class Apart:
    """`qpos` (T, 7 + nj) whose parts are apart; they overlapped by `before` m at most, and do now by `after` m."""

    qpos: Array
    before: float
    after: float


def pushed_apart(rig: Rig, qpos: Array, fps: float, gives: NDArray[np.bool_]) -> Apart:
    """`qpos` (T, 7 + nj) with those joints moved that may give way, `gives` (nj,), so that no two parts overlap.

    Least squares over all frames, round by round: of what a round adds to the joints, of what gaps then lack, and of
    the second differences of all that was added. Joints keep their ranges. Nothing is moved where no check on
    overlapping parts would fail.
    """
    model = copy(load_model(rig))
    gap = model.geom_margin[:] = CLEAR * rig.nominal.height
    tree, columns = tree_of(model), np.flatnonzero(gives)
    low, high = (np.array([getattr(j, end) for j in rig.joints])[columns] for end in ("lower", "upper"))
    at, found = poses(tree, qpos), meetings(model, qpos)
    before = _overlap(found)
    touching = len(np.unique(found.frame[found.apart < 0])) / len(qpos)
    if before <= limit_for("self_collision", rig) and touching <= limit_for("self_contact", rig):
        return Apart(qpos, before, before)
    meet = np.zeros((model.nbody, model.nbody), bool)
    meet[tuple(found.bodies[found.apart < 0].T)] = True
    meet |= meet.T

    out, added, dofs = qpos.copy(), np.zeros((len(qpos), len(columns))), columns + ROOT_DOFS
    for _ in range(ROUNDS):
        near = (found.apart < gap) & meet[tuple(found.bodies.T)]
        met = found.of(near)
        lacks = (met.apart - gap) / rig.nominal.height
        rows = (velocities(at, dofs, met.place[:, None], met.frame) @ met.normal[..., None])[..., 0]
        rows *= (tree.carries[met.bodies[:, 1]] - tree.carries[met.bodies[:, 0]])[:, dofs] / rig.nominal.height
        curvature, gradient = np.tile(np.eye(len(columns)), (len(qpos), 1, 1)), np.zeros_like(added)
        np.add.at(curvature, met.frame, FIRM * rows[:, :, None] * rows[:, None])
        np.add.at(gradient, met.frame, FIRM * rows * lacks[:, None])
        equations = Equations(curvature, gradient)
        equations.add_differences(SECOND, np.full(1, (SMOOTH * fps) ** 4), np.diff(added, n=2, axis=0))
        then = added + equations.solved(0, np.zeros_like(added))
        then = np.clip(qpos[:, 7 + columns] + then, low, high) - qpos[:, 7 + columns]
        change, added = float(np.abs(then - added).max(initial=0.0)), then
        out[:, 7 + columns] = qpos[:, 7 + columns] + added
        at, found = poses(tree, out), meetings(model, out)
        if _overlap(found) == 0 or change < WORTH:
            break
    return Apart(out, before, _overlap(found))


def _overlap(met: Meetings) -> float:
    """Metres that two parts are inside one another, at most."""
    return float(np.maximum(-met.apart, 0.0).max(initial=0.0))
