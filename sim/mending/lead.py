"""Servos that give way: what each has to be told so that, under its load, it is where it should be.

A position servo gives torque only for an error, lags behind by its damping, and its gears have play. All three are
known for a motion whose every force is known: the joint torques of inverse dynamics, with the ground's wrench on each
sole put in.
"""

from __future__ import annotations

import mujoco
import numpy as np

from motiongen.rotation import Array, quat_rotate
from retarget.kinematics import ROOT_DOFS, poses, velocities
from sim.dynamics import rates
from sim.mending.body import Body
from sim.mending.feet import Feet

UNLOADED = 1e-4  # of a foot that stands, how much one in the air carries
HAND_OVER = 0.5  # beats around a swing, over which its foot gives up its load and takes it on
PRESSED = 0.05  # of the stall torque, from which on a gear lies against one side of its play
TWIST = 0.05  # m: a moment of 1 N·m on a sole counts as much as a force of 1 / TWIST N


def led(body: Body, qpos: Array, feet: Feet, fps: float) -> Array:
    """(T, nj) rad that the servos are to be told for `qpos` (T, 7 + nj), within the joints' ranges."""
    joints = body.rig.joints
    gain, damping = np.array([j.kp for j in joints]), np.array([j.kv for j in joints])
    speed = rates(qpos, fps)[0][:, ROOT_DOFS:]
    torque = torques(body, qpos, feet, fps)
    aim = qpos[:, 7:] + (torque + damping * speed) / gain + loose(body, torque)
    return np.clip(aim, [j.lower for j in joints], [j.upper for j in joints])


def loose(body: Body, torque: Array) -> Array:
    """(T, nj) rad by which gears let joints hang back under `torque` (T, nj) N·m: half their play, where pressed."""
    half, firm = np.zeros(len(body.rig.joints)), np.ones(len(body.rig.joints))
    for servo in body.rig.servos:
        joint = body.rig.joint_names().index(servo.joint)
        half[joint] = 0.5 * servo.model.play
        firm[joint] = PRESSED * servo.model.stall_torque
    return half * np.clip(torque / firm, -1, 1)


def torques(body: Body, qpos: Array, feet: Feet, fps: float) -> Array:
    """(T, nj) N·m that the servos need for `qpos` (T, 7 + nj) on the floor.

    The wrench that the root needs is shared by the soles that stand in the way that is least in the sum of its squares.
    """
    needed, at = inverse_dynamics(body, qpos, fps), poses(body.tree, qpos)
    every = np.arange(needed.shape[1])
    load = _loads(feet, HAND_OVER * body.beat * fps)
    columns, shares = [], []
    for i, leg in enumerate(body.legs):
        centre = at.place[:, leg.body] + quat_rotate(at.turn[:, leg.body], leg.sole.mean(0)[None])
        carries = body.tree.carries[leg.body][:, None]
        push = velocities(at, every, centre[:, None]) * carries
        spin = at.axis * carries * (every >= 3)[:, None]  # the root's first three only slide
        columns.append(np.concatenate([push, spin], axis=2))
        shares.append(load[:, i, None] * np.repeat([1.0, TWIST**2], 3))
    jacobian, share = np.concatenate(columns, axis=2), np.concatenate(shares, axis=1)[..., None]
    root = jacobian[:, :ROOT_DOFS]
    weighted = share * root.swapaxes(1, 2)
    wrench = weighted @ np.linalg.solve(root @ weighted, needed[:, :ROOT_DOFS, None])
    return needed[:, ROOT_DOFS:] - (jacobian[:, ROOT_DOFS:] @ wrench)[..., 0]


def inverse_dynamics(body: Body, qpos: Array, fps: float) -> Array:
    """(T, 6 + nj) N and N·m that `qpos` (T, 7 + nj) needs, as if every joint and the root had a motor."""
    model, data = body.tree.model, mujoco.MjData(body.tree.model)
    velocity, acceleration = rates(qpos, fps)
    out, inertia = np.empty((len(qpos), model.nv)), np.empty(model.nv)
    for k in range(len(qpos)):
        data.qpos[:], data.qvel[:] = qpos[k], velocity[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, out[k])
        mujoco.mj_mulM(model, data, inertia, acceleration[k])  # unlike mj_rne it knows of rotors
        out[k] += inertia
    return out + model.dof_damping * velocity


def _loads(feet: Feet, spread: float) -> Array:
    """(T, n) how much of the load a foot may take, 0 to 1: smoothly while both stand, all where it is alone."""
    from scipy.ndimage import gaussian_filter1d, minimum_filter1d

    width = max(1, round(spread))
    stands = minimum_filter1d(feet.stands.astype(float), 2 * width + 1, axis=0)
    alone = feet.stands.sum(1, keepdims=True) == 1
    loads = np.where(alone, 1.0, gaussian_filter1d(stands, width / 2, axis=0))
    return np.maximum(np.where(feet.stands, loads, 0.0), UNLOADED)
