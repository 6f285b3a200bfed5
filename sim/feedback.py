"""What is added to the servos' targets while a motion runs in physics, by what the rig feels: its controller."""

from __future__ import annotations

import math
from typing import Protocol

import mujoco
import numpy as np

from motiongen.rotation import Array
from retarget.rig import Rig
from retarget.trajectory import Trajectory
from sim.report import Controller
from sim.scene import TIMESTEP, Scene, build_scene
from sim.upright import corrections, lean, standing, turning, upright_of
from sim.whole_body import WholeBody


class Feedback(Protocol):
    """Keeps runs of one motion to it."""

    def added(self, frame: int, states: Array) -> Array:
        """(runs, nj) rad to add to the targets of `frame`, for MuJoCo's `states` (runs, ·) when its hold begins.

        Frames come one after the other from 0 on.
        """
        ...


def controllers(rig: Rig) -> tuple[Controller, ...]:
    """The controllers that `rig` has what it takes for, from the one that takes least."""
    feels = rig.sensors.imu and any(foot.upright for foot in rig.feet)
    knows = rig.sensors.full_state and bool(rig.feet)
    return ("open_loop", *(("imu",) if feels else ()), *(("full_state",) if knows else ()))


def feedback_of(controller: Controller, scene: Scene, trajectory: Trajectory) -> Feedback | None:
    """What `controller` does in a run of `trajectory`; None where it does nothing.

    Raises ValueError where the rig lacks what it takes.
    """
    if controller == "imu":
        return ByLean(scene, trajectory)
    if controller == "full_state":
        return ByState(scene, trajectory)
    return None


class ByLean:
    """The `imu` controller: by what an IMU said a while before a frame began."""

    def __init__(self, scene: Scene, trajectory: Trajectory) -> None:
        self._upright, self._asked, self._turning = upright_of(scene.rig), trajectory.root_quat, turning(trajectory)
        self._stands = standing(trajectory, scene.rig)
        self._wait = late(scene.rig, trajectory.fps)
        self._spin = 1 + scene.model.nq + np.arange(3, 6)  # of the root in its own frame, in a state
        self._felt: list[Array] = []

    def added(self, frame: int, states: Array) -> Array:
        self._felt.append(states)
        back = max(frame - self._wait, 0)
        was = self._felt[back]
        at = max(back - 1, 0)  # what a hold begins with is what the one before it should have led to
        leans = lean(was[:, 4:8], was[:, self._spin], self._asked[at], self._turning[at], self._upright.ahead)
        return corrections(self._upright, leans, self._stands[frame])


class ByState:
    """The `full_state` controller: by where the root and the servos' shafts were, and how fast, a while before a frame
    began. What has become of that since is what a simulation of the rig as it is written down makes of it.
    """

    def __init__(self, scene: Scene, trajectory: Trajectory) -> None:
        if not scene.rig.sensors.full_state:
            raise ValueError(f"rig {scene.rig.name!r} does not know its full state (sensors.full_state)")
        self._body, self._plan = WholeBody(scene, trajectory), trajectory.targets
        self._wait, self._steps = late(scene.rig, trajectory.fps), round(1 / trajectory.fps / TIMESTEP)
        self._model = build_scene(scene.rig, scene.mount, trajectory.qpos[0]).model
        self._data = mujoco.MjData(self._model)
        root = np.arange(7)
        self._angles = 1 + np.concatenate([root, scene.joint_qpos])
        self._rates = 1 + scene.model.nq + np.concatenate([root[:6], scene.joint_dof])
        self._known: list[Array] = []
        self._told: list[Array] = []

    def added(self, frame: int, states: Array) -> Array:
        self._known.append(states)
        back = max(frame - self._wait, 0)
        told = np.array(
            [self._body.targets(frame, *self._since(back, run, state)) for run, state in enumerate(self._known[back])]
        )
        self._told.append(told)
        return told - self._plan[frame]

    def _since(self, back: int, run: int, state: Array) -> tuple[Array, Array]:
        """Where number `run` of the runs is now, (7 + nj,), and how it moves, (6 + nj,): its `state` of frame `back`,
        and what it was told from then on.
        """
        data = self._data
        mujoco.mj_resetData(self._model, data)
        data.qpos[:], data.qvel[:] = state[self._angles], state[self._rates]
        for told in self._told[back:]:
            data.ctrl[:] = told[run]
            mujoco.mj_step(self._model, data, self._steps)
        return data.qpos.copy(), data.qvel.copy()


def late(rig: Rig, fps: float) -> int:
    """Frames by which what `rig` feels is late."""
    return math.ceil(rig.sensors.delay * fps - 1e-9)
