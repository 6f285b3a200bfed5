"""What a motion asks of the ground, whatever the servos do: centre of mass, needed force, zero-moment point.

Newton and Euler for the whole rig: the world must supply `f = d(mv)/dt − m g` and, about the origin,
`n = dL/dt − c × m g`, with m v and L the momentum and angular momentum of all parts and c their centre of mass.
MuJoCo's recursion (`mj_rne`) gives both as the wrench on the root, without any joint torque entering.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import cross, quat_conj, quat_mul, quat_rotate, quat_to_rotvec
from sim.scene import Scene

Array = NDArray[np.float64]

# Below this share of its weight on the ground a rig flies: dividing by so little says nothing about balance.
FLIGHT = 0.1


@dataclass(frozen=True)
class Dynamics:
    """T frames in world axes.

    `com` (T, 3) m. `com_speed` (T,) m/s, along the floor. `force` (T, 3) N and `moment` (T, 3) N·m about the world's
    origin: what the world must put on the rig, its weight carried. `zmp` (T, 2) m on the floor z = 0, NaN in flight.
    `foot_pos` (T, F, 3) m and `foot_mat` (T, F, 3, 3) of the bodies of the rig's feet, in their order.
    """

    com: Array
    com_speed: Array
    force: Array
    moment: Array
    zmp: Array
    foot_pos: Array
    foot_mat: Array


def dynamics(scene: Scene, qpos: Array, fps: float) -> Dynamics:
    """The dynamics of `qpos` (T, 7 + nj) at `fps`, on a scene whose root is not bolted.

    Raises ValueError on a stand, whose post takes any force and moment.
    """
    if scene.mount == "stand":
        raise ValueError("dynamics: a rig on a stand has no balance; use mount free or hung")
    model, data = scene.model, mujoco.MjData(scene.model)
    root, frames = model.body(scene.rig.root).id, len(qpos)
    velocity, acceleration = rates(qpos, fps)
    generalised = np.empty(model.nv)
    com, wrench = np.empty((frames, 3)), np.empty((frames, 6))
    feet = [model.body(foot.body).id for foot in scene.rig.feet]
    foot_pos, foot_mat = np.empty((frames, len(feet), 3)), np.empty((frames, len(feet), 9))
    pose, speed, gain, centre = data.qpos, data.qvel, data.qacc, data.subtree_com[root]  # views, see `sim.geometry`
    for k in range(frames):
        pose[:], speed[:], gain[:] = qpos[k], velocity[k], acceleration[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, generalised)
        com[k], wrench[k] = centre, generalised[:6]
        foot_pos[k], foot_mat[k] = data.xpos[feet], data.xmat[feet]
    force = wrench[:, :3]
    moment = quat_rotate(qpos[:, 3:7], wrench[:, 3:]) + cross(qpos[:, :3], force)
    return Dynamics(
        com=com,
        com_speed=np.linalg.norm(np.gradient(com[:, :2], 1 / fps, axis=0), axis=1) if frames > 1 else np.zeros(1),
        force=force,
        moment=moment,
        zmp=zero_moment_point(force, moment, FLIGHT * scene.weight),
        foot_pos=foot_pos,
        foot_mat=foot_mat.reshape(frames, -1, 3, 3),
    )


def rates(qpos: Array, fps: float) -> tuple[Array, Array]:
    """Velocity and acceleration (T, 6 + nj) of `qpos` (T, 7 + nj) in MuJoCo's order: the root's turn in its own frame.

    Differences over five frames, 80 ms at 50 Hz: servos, which lag by 20 ms and more, do not follow anything shorter,
    and the noise of a narrower second difference would hide the motion. One-sided at the ends.
    """
    if len(qpos) < 2:
        return np.zeros((len(qpos), qpos.shape[1] - 1)), np.zeros((len(qpos), qpos.shape[1] - 1))
    turn = quat_mul(quat_conj(qpos[:-1, 3:7]), qpos[1:, 3:7])
    turn = np.where(turn[:, :1] < 0, -turn, turn)
    # A turn's vector is the same in the frame before and after it, so the mean of two neighbours is in one frame.
    between = fps * np.hstack([np.diff(qpos[:, :3], axis=0), quat_to_rotvec(turn), np.diff(qpos[:, 7:], axis=0)])
    padded = np.concatenate([between[:1], between, between[-1:]])
    velocity = 0.5 * (padded[1:] + padded[:-1])
    return velocity, np.gradient(velocity, 1 / fps, axis=0)


def zero_moment_point(force: Array, moment: Array, least: float) -> Array:
    """(T, 2) metres: where on the floor the ground's `force` (T, 3) would give `moment` (T, 3) about the origin.

    p = (−n_y, n_x) / f_z on z = 0 (Vukobratović and Borovac 2004), where the floor's horizontal moment is nil. NaN
    where f_z is under `least` N.
    """
    up = np.where(force[:, 2] > least, force[:, 2], np.nan)
    return np.stack([-moment[:, 1], moment[:, 0]], axis=1) / up[:, None]
