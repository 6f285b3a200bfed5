"""Run a trajectory through physics exactly as it will be streamed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from sim.feedback import feedback_of
from sim.harness import harness_path
from sim.report import Controller
from sim.scene import DRIVE, TIMESTEP, Scene, build_scene

Array = NDArray[np.float64]

SETTLE = 0.5  # s, holding frame 0 before the clock starts
CHUNK = 2500  # time steps of which everything is kept at a time: a motion may last half an hour
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS  # time, qpos and qvel, as our scenes have nothing else
CONTROL = (
    mujoco.mjtState.mjSTATE_CTRL,
    mujoco.mjtState.mjSTATE_QFRC_APPLIED,
    mujoco.mjtState.mjSTATE_MOCAP_POS,
    mujoco.mjtState.mjSTATE_MOCAP_QUAT,
)
AT_LIMIT = 1e-6  # of the torque: what rounding takes away from the limit
BAD_STATE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


@dataclass(frozen=True)
class Breakdown:
    """The simulation could not go on: `body` flew apart at `at_s` seconds."""

    at_s: float
    body: str


@dataclass(frozen=True)
class Push:
    """A `force` (3,) in N, world axes, on the root's origin from `start` for `length` seconds."""

    start: float
    length: float
    force: tuple[float, float, float]


@dataclass(frozen=True)
class Rollout:
    """What physics made of a trajectory; row k is the end of the time for which frame k was held.

    `time` (T,) seconds since frame 0 was captured, so with the rig's delay in it. `qpos` (T, 7 + nj) as in
    Trajectory. `torque` (T, nj) N·m that the servos gave. Over the hold of each frame, (T, nj): `saturated`, share of
    it that each servo spent at its torque limit; `torque_squared`, mean in N²m²; `drive`, mean power in W that it gave
    to the joint, braking not counted. `harness` (T, 3): force of the harness on the root in N, world axes; zero on
    other mounts. `weight` N of the whole rig. After a `breakdown` the rows repeat the last good one.
    """

    rig: str
    mount: Mount
    fps: float
    time: Array
    qpos: Array
    torque: Array
    saturated: Array
    torque_squared: Array
    drive: Array
    harness: Array
    weight: float
    breakdown: Breakdown | None = None


def simulate(trajectory: Trajectory, rig: Rig, *, mount: Mount | None = None) -> Rollout:
    """Track `trajectory` with the rig's position servos, from rest in frame 0; `mount` defaults to the rig's own.

    Each frame is a servo target, held until the next one comes, as on the wire. What a servo gives is in
    `scene._add_motor`. The rig's delay moves the whole run later and changes nothing else, since nothing is fed back
    (`open_loop`).

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


def run(
    scene: Scene, trajectory: Trajectory, push: Push | None = None, controller: Controller = "open_loop"
) -> Rollout:
    """`simulate` on a scene that is already built, with a `push` and under a `controller` where asked for.

    Raises ValueError where the rig lacks what the controller takes.
    """
    return run_many(scene, [scene.model], trajectory, [push], threads=1, controller=controller)[0]


def run_many(
    scene: Scene,
    models: Sequence[mujoco.MjModel],
    trajectory: Trajectory,
    pushes: Sequence[Push | None],
    threads: int,
    controller: Controller = "open_loop",
) -> list[Rollout]:
    """`run` on each of `models`, variants of the scene's own, with the push of the same place; `threads` at a time."""
    frames, count = len(trajectory), len(models)
    ends = np.rint(np.arange(1, frames + 1) / trajectory.fps / TIMESTEP).astype(int)
    holds = [_Holds(scene, model, trajectory) for model in models]
    datas = [mujoco.MjData(scene.model) for _ in range(min(threads, count))]
    scene.place(datas[0], trajectory.qpos[0])
    start = np.empty(mujoco.mj_stateSize(scene.model, STATE))
    mujoco.mj_getState(scene.model, datas[0], start, STATE)
    state = np.tile(start, (count, 1))
    with _quiet():
        settle = _controls(scene, trajectory, np.zeros(round(SETTLE / TIMESTEP), int), None, pushes=[None] * count)
        state = _roll(models, datas, state, settle)[0][:, -1]
        feedback = feedback_of(controller, scene, trajectory)
        for first, last in _chunks(ends, CHUNK if feedback is None else 0):
            begun = ends[first - 1] if first else 0
            frame = np.repeat(np.arange(first, last), np.diff(ends[first:last], prepend=begun))
            through = np.arange(begun + 1, begun + 1 + len(frame)) * np.float64(TIMESTEP)  # s, at the end of each step
            controls = _controls(scene, trajectory, frame, through, pushes)
            if feedback is not None:
                controls[..., : len(scene.rig.joints)] += feedback.added(first, state)[:, None]
            states, forces = _roll(models, datas, state, controls)
            for i, hold in enumerate(holds):
                hold.add(first, begun, ends[first:last] - begun, state[i], states[i], forces[i])
            state = states[:, -1]
    broken = [h.broken for h in holds]
    if count > 1 and any(b is not None for b in broken):  # threads share their data: only alone does one tell the body
        return [
            h.rollout(scene, trajectory, None) if b is None else run_many(scene, [m], trajectory, [p], 1, controller)[0]
            for m, p, b, h in zip(models, pushes, broken, holds, strict=True)
        ]
    return [
        h.rollout(scene, trajectory, None if h.broken is None else Breakdown(h.broken, _body(scene.model, datas[0])))
        for h in holds
    ]


def settled(scene: Scene, pose: Array) -> Array:
    """MuJoCo's state of the rig once it has held `pose` (7 + nj,) for SETTLE s, as every run begins."""
    data = mujoco.MjData(scene.model)
    scene.place(data, pose)
    state = np.empty((1, mujoco.mj_stateSize(scene.model, STATE)))
    mujoco.mj_getState(scene.model, data, state[0], STATE)
    still = Trajectory(pose[None], 1 / TIMESTEP, scene.rig.name, scene.rig.joint_names())
    with _quiet():
        hold = _controls(scene, still, np.zeros(round(SETTLE / TIMESTEP), int), None, [None])
        return _roll([scene.model], [data], state, hold)[0][0, -1]


def run_on(scene: Scene, trajectory: Trajectory, state: Array) -> tuple[Rollout, Array]:
    """`run` that goes on from MuJoCo's `state` (·,), and the states (T, ·) at the end of every frame."""
    ends = np.rint(np.arange(1, len(trajectory) + 1) / trajectory.fps / TIMESTEP).astype(int)
    frame, through = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0)), np.arange(1, ends[-1] + 1) * TIMESTEP
    begun, data, hold = state.copy(), mujoco.MjData(scene.model), _Holds(scene, scene.model, trajectory)
    begun[0] = SETTLE  # the time, by which a hold tells whether physics went on
    with _quiet():
        states, forces = _roll([scene.model], [data], begun[None], _controls(scene, trajectory, frame, through, [None]))
    hold.add(0, 0, ends, begun, states[0], forces[0])
    broken = None if hold.broken is None else Breakdown(hold.broken, _body(scene.model, data))
    return hold.rollout(scene, trajectory, broken), states[0, np.maximum(ends - 1, 0)]


def _chunks(ends: NDArray[np.int_], most: int) -> Iterator[tuple[int, int]]:
    """First and last (exclusive) frames of pieces of at least one frame and about `most` steps."""
    first = 0
    while first < len(ends):
        begun = ends[first - 1] if first else 0
        last = max(first + 1, int(np.searchsorted(ends, begun + most, side="right")))
        yield first, last
        first = last


def _controls(
    scene: Scene,
    trajectory: Trajectory,
    frame: NDArray[np.int_],
    through: Array | None,
    pushes: Sequence[Push | None],
) -> Array:
    """(runs, steps, CONTROL): targets of the `frame` held in each step, pushes, and the path of the harness.

    `through` (steps,): seconds at the end of each step, None while the rig settles in frame 0.
    """
    model, steps = scene.model, len(frame)
    target = np.zeros((steps, model.nu))
    target[:, : len(scene.rig.joints)] = trajectory.targets[frame]
    path = np.empty((steps, 0))
    if scene.mount == "hung":
        pose = np.tile(trajectory.qpos[0, :7], (steps, 1))
        if through is not None:
            pose = harness_path(trajectory, through * trajectory.fps - 1)
        turn = np.zeros((steps, 4))
        turn[:, 0] = 1
        path = np.hstack([pose[:, :3], pose[:, :3], turn, pose[:, 3:]])
    out = np.empty((len(pushes), steps, model.nu + model.nv + path.shape[1]))
    for i, push in enumerate(pushes):
        applied = np.zeros((steps, model.nv))
        if push is not None and through is not None:
            applied[(through > push.start) & (through <= push.start + push.length), :3] = push.force
        out[i] = np.hstack([target, applied, path])
    return out


def _roll(
    models: Sequence[mujoco.MjModel], datas: list[mujoco.MjData], state: Array, controls: Array
) -> tuple[Array, Array]:
    """States (runs, steps, ·) after every step and the sensors (runs, steps, ·) within it."""
    if controls.shape[1] == 0:
        return state[:, None], np.zeros((len(models), 0, models[0].nsensordata))
    spec = int(sum(CONTROL)) if models[0].nmocap else int(sum(CONTROL[:2]))
    return rollout.rollout(list(models), datas, state, controls, control_spec=spec, persistent_pool=False)


class _Holds:
    """Gathers what a run did, step by step, into one row per frame."""

    def __init__(self, scene: Scene, model: mujoco.MjModel, trajectory: Trajectory) -> None:
        self.scene, joints, frames = scene, len(scene.rig.joints), len(trajectory)
        self.nq = scene.model.nq
        self.good = scene.poses(trajectory.qpos[:1])[0]  # the last pose before it broke
        drive = model.actuator_gainprm[:joints, DRIVE]
        self.slope = np.array([j.torque / j.no_load_speed for j in scene.rig.joints])
        self.torque = np.array([j.torque for j in scene.rig.joints]) * drive
        self.qpos, self.harness = np.empty((frames, self.nq)), np.zeros((frames, 3))
        self.given, self.saturated = np.zeros((frames, joints)), np.zeros((frames, joints))
        self.squared, self.work = np.zeros((frames, joints)), np.zeros((frames, joints))
        self.broken: float | None = None

    def add(self, first: int, begun: int, ends: NDArray[np.int_], before: Array, states: Array, forces: Array) -> None:
        """The frames from `first` on, which end after `ends` (F,) of these steps, `begun` of all steps being done.

        `before` is the state ahead of them.
        """
        rows = slice(first, first + len(ends))
        if self.broken is not None or len(forces) == 0:
            self.qpos[rows] = self.good
            return
        joints = self.given.shape[1]
        torque = forces[:, :joints]
        dof = 1 + self.nq + self.scene.joint_dof
        speed = np.concatenate([before[None, dof], states[:-1, dof]])  # at the start of each step, as the torque is
        low, high = torque_range(self.torque, self.slope, speed)
        low, high = low + AT_LIMIT * self.torque, high - AT_LIMIT * self.torque
        last = np.maximum(ends - 1, 0)
        self.qpos[rows], self.given[rows] = states[last, 1 : 1 + self.nq], torque[last]
        self.saturated[rows] = _means((torque >= high) | (torque <= low), ends)
        self.squared[rows] = _means(torque**2, ends)
        self.work[rows] = _means(np.maximum(torque * speed, 0), ends)
        if self.scene.mount == "hung":
            self.harness[rows] = forces[last, joints : joints + 3]
        self._notice(rows, begun, ends, states)
        self.good = self.qpos[rows][-1]

    def _notice(self, rows: slice, begun: int, ends: NDArray[np.int_], states: Array) -> None:
        """MuJoCo begins anew, at time 0, where a state is bad; and a rollout stays where it warned of anything."""
        ticking = states[:, 0] > SETTLE + (begun + 0.5 + np.arange(len(states))) * TIMESTEP
        if ticking.all():
            return
        step = int(np.argmin(ticking))
        frame = int(np.searchsorted(ends, step, side="right"))
        self.broken = (begun + step) * TIMESTEP
        self.qpos[rows][frame:] = states[step - 1, 1 : 1 + self.nq] if step else self.good
        for array in (self.given, self.saturated, self.squared, self.work, self.harness):
            array[rows][frame:] = 0

    def rollout(self, scene: Scene, trajectory: Trajectory, breakdown: Breakdown | None) -> Rollout:
        """All of it, once every frame was added."""
        frames = len(trajectory)
        return Rollout(
            rig=scene.rig.name,
            mount=scene.mount,
            fps=trajectory.fps,
            time=np.arange(1, frames + 1) / trajectory.fps + scene.rig.sensors.delay,
            qpos=scene.rows(self.qpos),
            torque=self.given,
            saturated=self.saturated,
            torque_squared=self.squared,
            drive=self.work,
            harness=self.harness,
            weight=scene.weight,
            breakdown=breakdown,
        )


def torque_range(stall: Array, slope: Array, speed: Array) -> tuple[Array, Array]:
    """Least and most torque (T, n) N·m that motors have left at `speed` (T, n) rad/s.

    `stall` (n,) N·m at rest; `slope` (n,) N·m·s/rad: what is lost for every rad/s in the direction of the turn.
    """
    return np.maximum(-stall - slope * speed, -stall), np.minimum(stall - slope * speed, stall)


def _means(values: NDArray, ends: NDArray[np.int_]) -> Array:
    """(F, n): means of (steps, n) values from one of `ends` to the next; 0 where no step lies between."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    starts = np.concatenate([[0], ends[:-1]])
    return (total[ends] - total[starts]) / np.maximum(ends - starts, 1)[:, None]


def _body(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """The body of the coordinate that MuJoCo warned of last."""
    for warning in BAD_STATE:
        if data.warning[warning].number:
            where = int(data.warning[warning].lastinfo)
            bodies = model.dof_bodyid
            if warning == mujoco.mjtWarning.mjWARN_BADQPOS:
                where = int(np.searchsorted(model.jnt_qposadr, where, side="right")) - 1
                bodies = model.jnt_bodyid
            return model.body(int(bodies[where])).name
    return model.body(1).name


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
