"""The legs that stand where the feet should be, for a root that has been moved."""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array, quat_conj, quat_mul, quat_to_rotvec
from retarget.kinematics import ROOT_DOFS, poses, velocities
from sim.mending.body import Body
from sim.mending.feet import Feet

STEPS = 12
DAMPING = 1e-4
STEP = 0.3  # rad that a joint moves at most in one step
ROUNDING = 1e-6  # of squares of what is left, in root heights and rad


def stand(body: Body, qpos: Array, feet: Feet) -> Array:
    """`qpos` (T, 7 + nj) with the joints of the legs such that the feet are where they should be.

    Damped Gauss-Newton, all frames at once, from the pose that is there; joints keep their ranges, so what is out of
    reach is missed.
    """
    qpos = qpos.copy()
    low, high = (np.array([getattr(j, end) for j in body.rig.joints]) for end in ("lower", "upper"))
    for _ in range(STEPS):
        at = poses(body.tree, qpos)
        most = 0.0
        for i, leg in enumerate(body.legs):
            off = at.place[:, leg.body] - feet.place[:, i]
            turned = quat_to_rotvec(quat_mul(at.turn[:, leg.body], quat_conj(feet.turn[:, i])))
            most = max(most, float(np.square(off / body.height).sum(1).max() + np.square(turned).sum(1).max()))
            rows = np.concatenate(
                [velocities(at, leg.dofs, at.place[:, leg.body][:, None]) / body.height, at.axis[:, leg.dofs]], axis=2
            )  # (T, n, 6)
            value = np.concatenate([off / body.height, turned], axis=1)
            square = rows @ rows.swapaxes(1, 2) + DAMPING * np.eye(len(leg.dofs))
            step = -np.linalg.solve(square, rows @ value[..., None])[..., 0]
            columns = leg.dofs - ROOT_DOFS
            angles = qpos[:, 7 + columns] + np.clip(step, -STEP, STEP)
            qpos[:, 7 + columns] = np.clip(angles, low[columns], high[columns])
        if most < ROUNDING:
            break
    return qpos
