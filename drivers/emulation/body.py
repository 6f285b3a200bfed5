"""The body of a rig in MuJoCo, turned by the emulated servos of its bus: what is on the screen is what the bus says.

Each servo is a DC motor with a gear on a controller that is proportional to the error of position, as in `motor.py`,
and here it has something to turn: links with mass, gravity, friction of the gears, the floor, and a supply that sags.
The load decides where the shaft really is, what current it draws and how warm it gets.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from drivers.bus import BusError
from drivers.calibration import Calibration, load_calibration
from drivers.motor import Demand, Motor
from drivers.servos.table import model_of
from drivers.upright import Felt
from retarget.rig import FULL_TORQUE_ERROR, Mount, Rig
from sim.scene import build_scene

Array = NDArray[np.float64]

ROOM = 25.0  # °C
# Nobody publishes these two. 82 g of metal and plastic hold about 50 J/K; a case of 50 cm² in still air, with what its
# bracket carries away, gives off about 0.1 W/K. Together they warm by 0.5 K/s at the stall of an XM430.
HEAT_CAPACITY = 50.0  # J/K
COOLING = 0.1  # W/K
SAG = 0.1  # of the voltage, at the current that the supply is rated for: an estimate
LOCKED = 1e6  # N·m·s/rad: a jammed gear


class Turning(Protocol):
    """An emulated servo, as the body sees it."""

    motor: Motor
    load: Callable[[float], None] | None

    def demand(self) -> Demand:
        """What it is told to do now."""
        ...


class Body:
    """The rig on its `mount` (by default its own) at `pose` (nj,) rad, by default the nominal one.

    Time passes in `advance`, from when servos turn it. One that nothing holds is held by hand until its servos do: till
    then it stands still. Raises BusError where a joint of the rig has no servo, RigError
    where its model does not load.
    """

    def __init__(
        self,
        rig: Rig,
        pose: Sequence[float] | None = None,
        mount: Mount | None = None,
        calibration: Calibration | None = None,
    ) -> None:
        if tuple(s.joint for s in rig.servos) != rig.joint_names():
            raise BusError(f"rig {rig.name!r}: a body on the bus needs a servo on every joint, in the model's order")
        self.mount: Mount = rig.mount if mount is None else mount
        lift = rig.stand_clearance if self.mount == "stand" else 0.0
        angles = rig.pose_vector(rig.nominal) if pose is None else list(pose)
        start = np.array([0.0, 0.0, rig.nominal.height + lift, 1.0, 0.0, 0.0, 0.0, *angles])
        self._scene = build_scene(rig, self.mount, start)
        self._model, self._data = self._scene.model, mujoco.MjData(self._scene.model)
        self._scene.place(self._data, start)
        mujoco.mj_forward(self._model, self._data)
        n, made = len(rig.servos), [s.model for s in rig.servos]
        self._angle, self._speed = self._data.qpos[-n:], self._data.qvel[-n:]  # views, as is the next
        self._force = self._data.actuator_force[:n]
        self._stall = np.array([m.stall_torque for m in made])
        self._drag = self._stall / np.array([j.no_load_speed for j in rig.joints])
        self._amperes = np.array([m.stall_current for m in made])
        self._rated = np.array([m.voltage for m in made])
        models = [model_of(m.name) for m in made]
        self._full_error = np.array([m.full_error if m else FULL_TORQUE_ERROR for m in models])
        self._supply = rig.power.voltage if rig.power else float(self._rated.max())
        self._resistance = SAG * rig.power.voltage / rig.power.current if rig.power else 0.0
        self._make_motors(n)
        self._calibration = calibration or load_calibration(rig)
        self._servos: tuple[Turning, ...] = ()
        self._joints = rig.joint_names()
        self._setpoint = self._angle.copy()
        self._damping = self._model.dof_damping.copy()
        self._by_hand = self.mount == "free"
        self._delay = round(rig.sensors.delay / self._model.opt.timestep)
        self._felt: deque[Felt] = deque([self._feels()], maxlen=self._delay + 1)
        self.temperature = np.full(n, ROOM)
        self.voltage = self._supply
        self.now = 0.0

    def load(self, servos: Mapping[str, Turning], now: float) -> None:
        """Be what the servos, by joint, turn from `now` s on; their motors are where it stands."""
        self.now = now
        self._servos = tuple(servos[joint] for joint in self._joints)
        for servo in self._servos:
            servo.load = self.advance
        self._tell(np.zeros(len(self._servos)))

    def advance(self, now: float) -> None:
        """Let the time pass until `now`, in steps of the simulation, with every servo doing what it is told to."""
        steps = int((now - self.now) / self._model.opt.timestep + 1e-9)
        if steps <= 0:
            return
        self.now += steps * self._model.opt.timestep
        demands = [s.demand() for s in self._servos]
        on = np.array([d.goal is not None for d in demands])
        if self._by_hand and not on.all():
            return
        self._by_hand = False
        goal = self._to_joint(np.array([d.goal or 0.0 for d in demands]))
        reach = np.array([d.speed for d in demands]) * self._model.opt.timestep
        share = np.where(on, [d.share for d in demands], 0.0)
        self._model.actuator_biasprm[: len(on), 2] = np.where(on, -self._drag, 0.0)  # An open bridge does not brake.
        jammed = np.array([s.motor.jammed for s in self._servos])
        self._model.dof_damping[-len(on) :] = np.where(jammed, LOCKED, self._damping[-len(on) :])
        for _ in range(steps):
            self._step(goal, on, reach, share)
        self._tell(self._force / self._stall)

    def qpos(self) -> Array:
        """The pose (7 + nj,) now, root first, as of `Trajectory`."""
        return self._scene.rows(self._data.qpos[None])[0]

    def felt(self) -> Felt:
        """What an IMU on the root says now: how it was turned, and how fast, `sensors.delay` ago."""
        return self._felt[0]

    def _feels(self) -> Felt:
        return Felt(self._data.qpos[3:7].copy(), self._data.qvel[3:6].copy())

    def _step(self, goal: Array, on: NDArray[np.bool_], reach: Array, share: Array) -> None:
        self._setpoint += np.clip(goal - self._setpoint, -reach, reach)
        self._setpoint[~on] = self._angle[~on]
        pulse = np.clip((self._setpoint - self._angle) / self._full_error, -share, share)
        self._data.ctrl[: len(goal)] = pulse * self.voltage / self._rated
        mujoco.mj_step(self._model, self._data)
        if self.mount != "stand":
            self._felt.append(self._feels())
        drawn = np.abs(self._force / self._stall) * self._amperes
        self.voltage = self._supply - self._resistance * float(np.abs(pulse) @ drawn)
        lost = drawn**2 * self._rated / self._amperes - COOLING * (self.temperature - ROOM)
        self.temperature += lost * self._model.opt.timestep / HEAT_CAPACITY

    def _tell(self, effort: Array) -> None:
        """The servos' motors: where they are and what they feel, each turned about its own zero."""
        turn = self._calibration.ticks_per_turn / (2 * math.pi)
        direction = self._calibration.direction
        angle = self._calibration.zero / turn + direction * self._angle
        columns = (angle, direction * self._speed, direction * effort, self.temperature)
        for servo, *told in zip(self._servos, *(c.tolist() for c in columns), strict=True):
            motor = servo.motor
            motor.angle, motor.speed, motor.effort, motor.temperature = told
            motor.voltage = self.voltage

    def _to_joint(self, angle: Array) -> Array:
        turn = self._calibration.ticks_per_turn / (2 * math.pi)
        return (angle - self._calibration.zero / turn) * self._calibration.direction

    def _make_motors(self, n: int) -> None:
        """The servos of the scene become motors alone: torque = stall · (duty · voltage − speed / no-load speed)."""
        self._model.actuator_dyntype[:n] = mujoco.mjtDyn.mjDYN_NONE
        self._model.actuator_gaintype[:n] = mujoco.mjtGain.mjGAIN_FIXED
        self._model.actuator_gainprm[:n] = 0.0
        self._model.actuator_gainprm[:n, 0] = self._stall
        self._model.actuator_biastype[:n] = mujoco.mjtBias.mjBIAS_AFFINE
        self._model.actuator_biasprm[:n] = 0.0
