"""Pinch: gaps between the limbs that close on a finger, and how hard."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.evidence import Evidence, verdict
from sim.geometry import FINGER
from sim.report import Check
from sim.scene import Scene

Array = NDArray[np.float64]


def pinch(e: Evidence) -> Check:
    """Force (N) on a finger in the gap between two parts that closes under 25 mm hardest.

    A gap counts where it was wider before; neighbours, such as the two sides of an elbow, do not. See `closing_force`.
    """
    worst, found, at = 0.0, "No gap closes on a finger", None
    for (one, other), gap in e.done.gaps.items():
        frame = int(np.argmin(gap))
        if np.isfinite(gap[: frame + 1]).all():
            continue
        force = closing_force(e.scene, e.rollout.qpos[frame], one, other)
        if force > worst:
            worst, at = force, e.seconds(frame)
            left = max(gap[frame], 0.0) * 1000
            found = f"{one} and {other} close to {left:.0f} mm and press with {force:.0f} N at {at:.2f} s"
    return verdict(e, "pinch", worst, at, found, "keep the two apart, or make the servos softer")


def closing_force(scene: Scene, qpos: Array, one: str, other: str) -> float:
    """N with which the servos press bodies `one` and `other` on a finger of 25 mm between them, in pose `qpos`.

    The finger keeps the two from coming nearer by what the gap lacks of 25 mm. Each joint that moves the gap by
    J m/rad gives way by J F / kp: F is the lack over the sum of J² / kp, as in springs one after the other, and no more
    than torque / J of the joint that gives way first.
    """
    model, data = scene.model, mujoco.MjData(scene.model)
    scene.place(data, qpos)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    gap, ends = _nearest(model, data, model.body(one).id, model.body(other).id)
    apart = ends[1] - ends[0]
    length = np.linalg.norm(apart)
    if length < 1e-9:
        return 0.0
    along = np.sign(gap) * apart / length
    moves = np.zeros((2, 3, model.nv))
    for jacobian, point, body in zip(moves, ends, (one, other), strict=True):
        mujoco.mj_jac(model, data, jacobian, None, point, model.body(body).id)
    lever = np.abs(along @ (moves[1] - moves[0]))[scene.joint_dof]
    turning = lever > 1e-3  # m/rad: a joint nearly in line with the force would give way at no end of force
    if not turning.any():
        return 0.0
    stiffness = np.array([j.kp for j in scene.rig.joints])[turning]
    torque = np.array([j.torque for j in scene.rig.joints])[turning]
    held = (FINGER - max(gap, 0.0)) / np.sum(lever[turning] ** 2 / stiffness)
    return float(min(held, np.min(torque / lever[turning])))


def _nearest(model: mujoco.MjModel, data: mujoco.MjData, one: int, other: int) -> tuple[float, Array]:
    """Distance in m of the nearest two geoms of two bodies that may collide, and the points (2, 3) on them."""
    best, ends = np.inf, np.zeros((2, 3))
    for a in _solid(model, one):
        for b in _solid(model, other):
            fromto = np.zeros(6)
            gap = mujoco.mj_geomDistance(model, data, a, b, 2 * FINGER, fromto)
            if gap < best:
                best, ends = gap, fromto.reshape(2, 3)
    return float(best), ends


def _solid(model: mujoco.MjModel, body: int) -> list[int]:
    first = int(model.body_geomadr[body])
    geoms = range(first, first + int(model.body_geomnum[body]))
    return [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
