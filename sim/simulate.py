"""Run a trajectory through physics exactly as it will be streamed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from sim.harness import harness_force, harness_path, pull_to
from sim.scene import TIMESTEP, Scene, build_scene

Array = NDArray[np.float64]

SETTLE = 0.5  # s, holding frame 0 before the clock starts
BAD_STATE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


@dataclass(frozen=True)
class Breakdown:
    """The simulation could not go on: `body` flew apart at `at_s` seconds."""

    at_s: float
    body: str


@dataclass(frozen=True)
class Rollout:
    """What physics made of a trajectory; row k is the end of the time for which frame k was held.

    `time` (T,) seconds since frame 0 was captured, so with the rig's delay in it. `qpos` (T, 7 + nj) as in
    Trajectory. `torque` (T, nj) N·m that the servos gave. `saturated` (T, nj): share of the hold, 0 to 1, that each
    servo spent at its torque limit. `harness` (T, 3): force of the harness on the root in N, world axes; zero on other
    mounts. `weight` N of the whole rig. After a `breakdown` the rows repeat the last good one.
    """

    rig: str
    mount: Mount
    fps: float
    time: Array
    qpos: Array
    torque: Array
    saturated: Array
    harness: Array
    weight: float
    breakdown: Breakdown | None = None


def simulate(trajectory: Trajectory, rig: Rig, *, mount: Mount | None = None) -> Rollout:
    """Track `trajectory` with the rig's position servos, from rest in frame 0; `mount` defaults to the rig's own.

    Each frame is a servo target, held until the next one comes, as on the wire. A servo pushes at most
    `torque · (1 − |ω| / no_load_speed)` in the direction in which it already turns, and `torque` against it. The
    rig's delay moves the whole run later and changes nothing else, since nothing is fed back (`open_loop`).

    Raises ValueError where the trajectory is not for this rig or the mount is unknown.
    """
    require_fit(trajectory, rig)
    return run(build_scene(rig, rig.mount if mount is None else mount, trajectory.qpos[0]), trajectory)


def require_fit(trajectory: Trajectory, rig: Rig) -> None:
    """Raises ValueError where `trajectory` was made for another rig."""
    if trajectory.rig != rig.name or trajectory.joints != rig.joint_names():
        raise ValueError(
            f"trajectory is for rig {trajectory.rig!r} with {len(trajectory.joints)} joints, "
            f"not for {rig.name!r} with {len(rig.joints)}"
        )


def run(scene: Scene, trajectory: Trajectory) -> Rollout:
    """`simulate` on a scene that is already built."""
    model, data = scene.model, mujoco.MjData(scene.model)
    frames, joints = len(trajectory), len(scene.rig.joints)
    ends = np.rint(np.arange(1, frames + 1) / trajectory.fps / TIMESTEP).astype(int)
    steps = np.diff(ends, prepend=0)
    path = harness_path(trajectory, steps) if scene.mount == "hung" else None
    qpos, harness = np.empty((frames, 7 + joints)), np.zeros((frames, 3))
    torque, saturated = np.zeros((frames, joints)), np.zeros((frames, joints))
    breakdown = None
    scene.place(data, trajectory.qpos[0])
    servos = _Servos(scene, data)
    with _quiet():
        servos.aim(trajectory.joint_pos[0])
        for _ in range(round(SETTLE / TIMESTEP)):
            servos.step()
        for k in range(frames):
            servos.aim(trajectory.joint_pos[k])
            hits = np.zeros(joints)
            for i in range(ends[k] - steps[k], ends[k]):
                if path is not None:
                    pull_to(data, path[i])
                hits += servos.step()
            breakdown = _breakdown(model, data, ends[k] * TIMESTEP)
            if breakdown is not None:
                qpos[k:] = qpos[k - 1] if k else trajectory.qpos[0]
                break
            qpos[k], torque[k] = scene.read(data), servos.force
            saturated[k] = hits / max(steps[k], 1)
            harness[k] = harness_force(data) if path is not None else 0.0
    time = np.arange(1, frames + 1) / trajectory.fps + scene.rig.sensors.delay
    return Rollout(
        rig=scene.rig.name,
        mount=scene.mount,
        fps=trajectory.fps,
        time=time,
        qpos=qpos,
        torque=torque,
        saturated=saturated,
        harness=harness,
        weight=scene.weight,
        breakdown=breakdown,
    )


class _Servos:
    """Steps physics with the torque-speed line of every servo put into its force range before each step."""

    def __init__(self, scene: Scene, data: mujoco.MjData) -> None:
        self.model, self.data, joints = scene.model, data, len(scene.rig.joints)
        self.goal, self.force = data.ctrl[:joints], data.actuator_force[:joints]  # views, as are the next three
        self.low, self.high = self.model.actuator_forcerange[:joints].T
        self.speed = data.qvel[-joints:]  # after the root's
        self.torque = np.array([j.torque for j in scene.rig.joints])
        self.slope = self.torque / np.array([j.no_load_speed for j in scene.rig.joints])

    def aim(self, goal: Array) -> None:
        """Set the targets (nj,) in radians."""
        self.goal[:] = goal

    def step(self) -> NDArray[np.bool_]:
        """One time step; which servos (nj,) are at their limit."""
        lost = self.slope * self.speed
        np.clip(self.torque - lost, 0.0, self.torque, out=self.high)
        np.clip(-self.torque - lost, -self.torque, 0.0, out=self.low)
        mujoco.mj_step(self.model, self.data)
        return (self.force >= self.high) | (self.force <= self.low)


def _breakdown(model: mujoco.MjModel, data: mujoco.MjData, at_s: float) -> Breakdown | None:
    for warning in BAD_STATE:
        if data.warning[warning].number:
            where = int(data.warning[warning].lastinfo)
            bodies = model.dof_bodyid
            if warning == mujoco.mjtWarning.mjWARN_BADQPOS:
                where = int(np.searchsorted(model.jnt_qposadr, where, side="right")) - 1
                bodies = model.jnt_bodyid
            return Breakdown(at_s, model.body(int(bodies[where])).name)
    return None


@contextmanager
def _quiet() -> Iterator[None]:
    """MuJoCo prints its warnings and writes a log file; here they are read from `data.warning` instead."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _ignore(message: str) -> None:
    return None
