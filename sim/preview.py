"""A take as previews show it: what was asked for, what physics made of it, and what there is to plot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from sim.dynamics import dynamics
from sim.geometry import measure
from sim.plots import Mark
from sim.report import Report
from sim.scene import DRIVE, Scene, build_scene
from sim.simulate import Rollout, require_fit, torque_range
from sim.support import Support, margin, support

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Load:
    """What each joint had to give, and could: (T, nj) `torque` in N·m within `lowest` and `highest`, `speed` and
    `asked_speed` in rad/s; (nj,) `rated` N·m at most, `allowed` rad/s at most.

    `speed` and the range of torque are of differences between frames, the torque is that of a frame's last moment.
    """

    torque: Array
    lowest: Array
    highest: Array
    speed: Array
    asked_speed: Array
    rated: Array
    allowed: Array

    def worst_first(self) -> list[int]:
        """Joints by the larger of their shares of rated torque and allowed speed."""
        torque, speed = np.abs(self.torque).max(0) / self.rated, np.abs(self.speed).max(0) / self.allowed
        return [int(i) for i in np.argsort(-np.maximum(torque, speed), kind="stable")]


@dataclass(frozen=True)
class Footing:
    """What the motion asks of the ground: `com` and `zmp` (T, 2) m on the floor, the polygon under them, and how far
    each is inside of it, (T,) m, NaN in flight."""

    com: Array
    zmp: Array
    ground: Support
    com_margin: Array
    zmp_margin: Array


@dataclass(frozen=True)
class Preview:
    """`asked` and `done` (T, 7 + nj), root first, `fps` rows a second; feet that `touch` the floor in physics, (T,)
    each. `footing` is None where a stand carries the rig or it has no feet. `origin`, a line, tells where the motion
    came from."""

    rig: Rig
    mount: Mount
    report: Report
    title: str
    fps: float
    asked: Array
    done: Array
    load: Load
    touch: dict[str, NDArray[np.bool_]]
    footing: Footing | None
    origin: str = ""

    def __len__(self) -> int:
        return len(self.done)

    def frame_at(self, seconds: float) -> int:
        """The row that is shown `seconds` after the first; the first or last one outside."""
        return min(max(round(seconds * self.fps), 0), len(self) - 1)

    def marks(self) -> list[Mark]:
        """The moments at which a check failed worst."""
        return [Mark(c.at_s, c.name) for c in self.report.failures() if c.at_s is not None]


def prepare(trajectory: Trajectory, rig: Rig, report: Report, rollout: Rollout, origin: str = "") -> Preview:
    """The preview of `trajectory`, of which `report` and `rollout` speak, and `origin` where it came from.

    Raises ValueError for a trajectory of another rig, and what `build_scene` raises.
    """
    require_fit(trajectory, rig)
    scene = build_scene(rig, rollout.mount, trajectory.qpos[0])
    grounded = rollout.mount != "stand" and bool(rig.feet)
    return Preview(
        rig=rig,
        mount=rollout.mount,
        report=report,
        title="; ".join(label.text for label in trajectory.labels),
        fps=trajectory.fps,
        asked=trajectory.qpos,
        done=rollout.qpos,
        load=_load(scene, trajectory, rollout),
        touch=measure(scene, rollout.qpos).touching if grounded else {},
        footing=_footing(scene, trajectory) if grounded else None,
        origin=origin,
    )


def _load(scene: Scene, trajectory: Trajectory, rollout: Rollout) -> Load:
    joints = scene.rig.joints
    speed, asked = (_speed(angles, trajectory.fps) for angles in (rollout.qpos[:, 7:], trajectory.targets))
    rated = np.array([j.torque for j in joints]) * scene.model.actuator_gainprm[: len(joints), DRIVE]
    slope = np.array([j.torque / j.no_load_speed for j in joints])
    lowest, highest = torque_range(rated, slope, speed)
    allowed = np.array([j.velocity for j in joints])
    return Load(rollout.torque, lowest, highest, speed, asked, rated, allowed)


def _speed(angles: Array, fps: float) -> Array:
    """(T, nj) rad/s over the time that leads to each frame; 0 in the first."""
    return np.diff(angles, axis=0, prepend=angles[:1]) * fps


def _footing(scene: Scene, trajectory: Trajectory) -> Footing:
    moves = dynamics(scene, trajectory.qpos, trajectory.fps)
    ground = support(scene, moves, trajectory.contacts)
    com = moves.com[:, :2]
    return Footing(com, moves.zmp, ground, margin(com, ground), margin(moves.zmp, ground))
