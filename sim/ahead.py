"""The gate of a motion that is still being made: stretch by stretch, each from where physics has the rig by then, and
each together with a way to rest from its end. What has passed can be played: it can always be stopped."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from retarget.rig import Mount, Rig
from retarget.timeline import PEAK, SHORTEST_EASE
from retarget.trajectory import Trajectory
from sim.commanded import COMMANDED
from sim.evidence import Evidence
from sim.geometry import measure
from sim.physical import PHYSICAL
from sim.report import Check
from sim.scene import TIMESTEP, build_scene
from sim.simulate import SETTLE, Rollout, Servos, breakdown_in, quiet

Array = NDArray[np.float64]
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
HELD = 0.2  # s at rest at the end of a way
BRAKE = 0.3  # s in which a way takes off the speed there is
CALM = 0.9  # of a joint's speed that a way uses
LONGEST = 5.0  # s of a way; the gate refuses what is still too fast then


@dataclass(frozen=True)
class Moment:
    """Where things are after a frame: `physics`, MuJoCo's state; `asked` (2, 7 + nj), the last two frames that the
    servos were sent."""

    physics: Array
    asked: Array


@dataclass(frozen=True)
class Verdict:
    """Whether a stretch may be played, and why not; `after`: the moment at its end; `way` (m, 7 + nj): to rest from
    there; `rested`: the moment at the way's end."""

    ok: bool
    failures: tuple[Check, ...]
    after: Moment
    way: Array
    rested: Moment


class Gate:
    """Judges what `rig` on a stand is to do next, at `fps` frames a second.

    Raises ValueError for another mount: what else carries the rig would have to be led back to rest too.
    """

    def __init__(self, rig: Rig, rest: Array, fps: float, mount: Mount | None = None) -> None:
        """`rest` (7 + nj,): the pose in which the rig begins and to which every way leads."""
        held = rig.mount if mount is None else mount
        if held != "stand":
            raise ValueError(f"live motion is for rigs on a stand, not {held}; --mount stand")
        self._rig, self._rest, self._fps = rig, rest, fps
        self._scene = build_scene(rig, held, rest)
        self._data = mujoco.MjData(self._scene.model)
        self._servos = Servos(self._scene, self._data)
        self._steps = round(1 / fps / TIMESTEP)
        self._speed = np.array([j.velocity for j in rig.joints])
        self._reach = np.array([[j.lower for j in rig.joints], [j.upper for j in rig.joints]])

    def begin(self) -> Moment:
        """At rest, with the servos settled."""
        self._scene.place(self._data, self._rest)
        self._servos.aim(self._rest[7:])
        with quiet():
            for _ in range(round(SETTLE / TIMESTEP)):
                self._servos.step()
        return Moment(self._kept(), np.stack([self._rest, self._rest]))

    def judge(self, moment: Moment, qpos: Array) -> Verdict:
        """What physics says of `qpos` (n, 7 + nj) after `moment`, n above 0, and of going to rest from there."""
        asked = np.concatenate([moment.asked, qpos])[-2:]
        way = way_to_rest(asked, self._rest, self._speed, self._reach, self._fps)
        trajectory = Trajectory(np.concatenate([qpos, way]), self._fps, self._rig.name, self._rig.joint_names())
        rollout, physics = self._run(moment, trajectory, len(qpos))
        scene = self._scene
        asked_at, done = measure(scene, trajectory.qpos), measure(scene, rollout.qpos)
        evidence = Evidence(trajectory, self._rig, scene.mount, rollout, asked_at, done)
        failures = tuple(c for c in (check(evidence) for check in (*COMMANDED, *PHYSICAL)) if not c.ok)
        rested = Moment(self._kept(), trajectory.qpos[-2:])
        return Verdict(not failures, failures, Moment(physics, asked), way, rested)

    def _run(self, moment: Moment, trajectory: Trajectory, keep: int) -> tuple[Rollout, Array]:
        """What physics makes of `trajectory` after `moment`, and its state after the first `keep` frames."""
        frames, joints = len(trajectory), len(self._rig.joints)
        data, servos = self._data, self._servos
        data.warning.number[:] = 0
        mujoco.mj_setState(self._scene.model, data, moment.physics, STATE)
        qpos, torque, saturated = np.empty((frames, 7 + joints)), np.zeros((frames, joints)), np.zeros((frames, joints))
        physics, breakdown = moment.physics, None
        with quiet():
            for k in range(frames):
                servos.aim(trajectory.joint_pos[k])
                saturated[k] = sum(servos.step() for _ in range(self._steps)) / self._steps
                breakdown = breakdown_in(self._scene.model, data, (k + 1) / self._fps)
                if breakdown is not None:
                    qpos[k:] = qpos[k - 1] if k else moment.asked[-1]
                    break
                qpos[k], torque[k] = self._scene.read(data), servos.force
                if k == keep - 1:
                    physics = self._kept()
        rollout = Rollout(
            rig=self._rig.name,
            mount=self._scene.mount,
            fps=self._fps,
            time=np.arange(1, frames + 1) / self._fps + self._rig.sensors.delay,
            qpos=qpos,
            torque=torque,
            saturated=saturated,
            harness=np.zeros((frames, 3)),
            weight=self._scene.weight,
            breakdown=breakdown,
        )
        return rollout, physics

    def _kept(self) -> Array:
        out = np.empty(mujoco.mj_stateSize(self._scene.model, STATE))
        mujoco.mj_getState(self._scene.model, self._data, out, STATE)
        return out


def way_to_rest(asked: Array, rest: Array, speed: Array, reach: Array, fps: float) -> Array:
    """(m, 7 + nj) from the last two frames `asked` (2, 7 + nj) to `rest` and held there.

    The speed there is dies away within BRAKE s, and what is off by a minimum jerk that takes as long as keeps joints
    below `speed` (nj,) rad/s, or below what they had; each within `reach` (2, nj).
    """
    start, rate = asked[1, 7:], np.diff(asked[:, 7:], axis=0)[0] * fps
    off = start - rest[7:]
    most = np.maximum(CALM * speed, np.abs(rate)) / fps
    count = round(max(SHORTEST_EASE, PEAK * float(np.max(np.abs(off) / (CALM * speed), initial=0.0))) * fps)
    while True:
        frames = np.arange(1, count + 1 + round(HELD * fps))[:, None]
        u, v = np.minimum(frames / count, 1.0), np.minimum(frames / (BRAKE * fps), 1.0)
        joints = rest[7:] + off * (1 - u**3 * (10 - 15 * u + 6 * u**2))
        joints = np.clip(joints + rate * BRAKE * (v - v**3 * (6 - 8 * v + 3 * v**2)), *reach)
        fastest = np.abs(np.diff(joints, axis=0, prepend=start[None])).max(0)
        if (fastest <= most).all() or count > LONGEST * fps:
            return np.concatenate([np.tile(rest[:7], (len(joints), 1)), joints], axis=1)
        count = round(1.2 * count)
