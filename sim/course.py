"""What a motion wants of a body at every moment: where its parts should be, how fast, and how soon faster."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array, quat_conj, quat_mul, quat_to_rotvec
from retarget.kinematics import poses, tree_of
from retarget.trajectory import Trajectory
from sim.dynamics import dynamics, rates
from sim.scene import Scene
from sim.upright import standing


@dataclass(frozen=True)
class Course:
    """T frames of a motion of a rig with F feet, in world axes but for the root's turning, which is in its own.

    `qpos` (T, 7 + nj), `velocity` and `acceleration` (T, 6 + nj) as MuJoCo has them. `com` (3, T, 3): the centre of
    mass in m, m/s and m/s². `place` (T, F, 3) m and `turn` (T, F, 4) of the bodies of the feet; `moves` (2, T, F, 6):
    their velocity and acceleration, in m and then in rad. `stands` (T, F): which feet stand.
    """

    qpos: Array
    velocity: Array
    acceleration: Array
    com: Array
    place: Array
    turn: Array
    moves: Array
    stands: NDArray[np.bool_]


def course_of(scene: Scene, trajectory: Trajectory) -> Course:
    """The course of `trajectory`. Raises ValueError on a stand, see `dynamics`."""
    fps, qpos = trajectory.fps, trajectory.qpos
    velocity, acceleration = rates(qpos, fps)
    com = dynamics(scene, qpos, fps).com
    at = poses(tree_of(scene.model), qpos)
    feet = [scene.model.body(foot.body).id for foot in scene.rig.feet]
    place, turn = at.place[:, feet], at.turn[:, feet]
    spin = quat_to_rotvec(_near(quat_mul(turn[1:], quat_conj(turn[:-1])))) * fps
    padded = np.concatenate([spin[:1], spin, spin[-1:]])
    moves = np.concatenate([_slope(place, fps), 0.5 * (padded[1:] + padded[:-1])], axis=-1)
    return Course(
        qpos=qpos,
        velocity=velocity,
        acceleration=acceleration,
        com=np.stack([com, _slope(com, fps), _slope(_slope(com, fps), fps)]),
        place=place,
        turn=turn,
        moves=np.stack([moves, _slope(moves, fps)]),
        stands=standing(trajectory, scene.rig),
    )


def _slope(values: Array, fps: float) -> Array:
    """Change a second of `values` (T, …); T is 2 at least."""
    return np.asarray(np.gradient(values, 1 / fps, axis=0))


def _near(quat: Array) -> Array:
    """The same turns (…, 4) the short way round."""
    return np.where(quat[..., :1] < 0, -quat, quat)
