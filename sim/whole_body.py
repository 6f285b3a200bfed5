"""Balance by the whole state of a body: what its servos must be told so that the motion goes on from where it is.

At every frame one quadratic problem is solved. Of all accelerations a and forces f on the soles that Newton and Euler
allow (M a + h = τ + Jᵀ f, with no τ on the root), f within the cones of friction and τ within what the servos give, it
finds those that come nearest to what the motion wants: its centre of mass, trunk, feet and joints, each drawn back to
where it should be. So ankles press, hips swing and arms give way, as much of each as it takes; and a foot in the air
goes on to its place in the world however the body leans. Forces act where a sole really touches. (See Kuindersma,
Deits, Fallon et al. 2016, Optimization-based locomotion planning, estimation, and control design for the Atlas humanoid
robot, Autonomous Robots 40.)
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array, quat_conj, quat_mul, quat_to_rotvec
from retarget.trajectory import Trajectory
from sim.course import course_of
from sim.mending.body import GRAVITY
from sim.scene import Scene, build_scene
from sim.support import find_soles
from sim.thresholds import rig_size

# The zero-moment point goes 1 + PRESS times as far as ξ = c + ċ / ω is off (c the centre of mass, ω = √(g / height)),
# by which what is off fades as exp(−PRESS ω t): Englsberger, Ott and Albu-Schäffer 2015, Three-dimensional bipedal
# walking control based on divergent component of motion, IEEE T-RO 31.
PRESS = 3.0
# What else is off fades as in a critically damped spring of so many rad/s.
LIMBS, TRUNK = 20.0, 10.0
# How much a square of what is lacking counts, in m/s² and rad/s².
COM, ROOT, IN_AIR, PLANTED, LEGS, REST = 10.0, 3.0, 10.0, 100.0, 0.01, 0.3
FORCE = 1e-7  # N⁻²: so that feet share the load
STILL = 1e-6  # of any acceleration, so that there is one answer
GRIP = 0.5  # coefficient of friction: floors may be smoother than thought
SPARE = 0.95  # of a servo's torque: its supply may be weaker than thought
TOUCHING = 0.008  # m at human size: a point of a sole that is lower carries, or does as soon as it is pressed on
UNBOUNDED = 1e30  # as daqp has it
EQUAL = 5  # daqp's kind of a row that is an equation


@dataclass(frozen=True)
class _Foot:
    """A foot now: its body's `place` (3,), `turn` (4,) and `velocity` (6,), the `jacobian` (6, nv) of that and its
    `drift` (6,), the acceleration that comes of velocities alone; `corners` (K, 3) of its sole in the world.
    """

    place: Array
    turn: Array
    velocity: Array
    jacobian: Array
    drift: Array
    corners: Array


class WholeBody:
    """Keeps a rig to `trajectory`, on `scene` whose model is the rig as it is written down."""

    def __init__(self, scene: Scene, trajectory: Trajectory) -> None:
        self._rig, self._fps = scene.rig, trajectory.fps
        plain = build_scene(scene.rig, "free", trajectory.qpos[0])  # gears without play: servos feel their own side
        self._model, self._mass, self._data = plain.model, plain.mass, mujoco.MjData(plain.model)
        self._course, self._targets = course_of(plain, trajectory), trajectory.targets
        soles = find_soles(plain)
        self._feet = [(plain.model.body(foot.body).id, soles[foot.name]) for foot in scene.rig.feet]
        joints = scene.rig.joints
        self._gain, self._damping = np.array([j.kp for j in joints]), np.array([j.kv for j in joints])
        self._torque = SPARE * np.array([j.torque for j in joints])
        self._range = np.array([j.lower for j in joints]), np.array([j.upper for j in joints])
        legs = np.zeros(self._model.nv, bool)
        for foot, _ in self._feet:
            legs[_carriers(self._model, foot)] = True
        self._joint_weight = np.where(legs[6:], LEGS, REST)
        self._pull = np.sqrt(GRAVITY / self._course.com[0, :, 2].mean())  # 1/s
        self._touching = TOUCHING * rig_size(scene.rig)
        lean = GRIP / np.sqrt(2)
        self._edges = np.array([[lean, lean, 1], [lean, -lean, 1], [-lean, lean, 1], [-lean, -lean, 1]])

    def targets(self, frame: int, qpos: Array, velocity: Array) -> Array:
        """(nj,) rad that the servos are to be told for `frame`, where the body now is at `qpos` (7 + nj,) and moves by
        `velocity` (6 + nj,). Those of the trajectory where there is no answer, for a body that has long fallen.
        """
        found = self.answer(frame, qpos, velocity)
        if found is None:
            return self._targets[frame]
        acceleration, torque = found
        return self._told(qpos[7:], velocity[6:], acceleration[6:], torque)

    def answer(self, frame: int, qpos: Array, velocity: Array) -> tuple[Array, Array] | None:
        """The accelerations (6 + nj,), and the torques (nj,) N·m, that come nearest to what the motion wants."""
        inertia, bias, com, fall = self._dynamics(qpos, velocity)
        at = max(frame - 1, 0)  # a frame begins where the one before it should have ended
        feet = [self._foot(body, sole, velocity) for body, sole in self._feet]
        parts = [self._wishes(at, frame, qpos, velocity, com, inertia[:3] / self._mass, fall)]
        pushes = [np.zeros((len(velocity), 0))]
        for i, foot in enumerate(feet):
            on = foot.corners[:, 2] < self._touching
            if not self._course.stands[frame, i]:
                on[:] = False
            parts.append(self._foothold(i, at, frame, foot, on))
            pushes += [_pushes(foot, corner, self._edges) for corner in foot.corners[on]]
        rows, wanted, weight = (np.concatenate(part) for part in zip(*parts, strict=True))
        return self._solved(rows, wanted, weight, inertia, bias, np.concatenate(pushes, axis=1))

    def _dynamics(self, qpos: Array, velocity: Array) -> tuple[Array, Array, Array, Array]:
        """Inertia (nv, nv), forces (nv,) at no acceleration, centre of mass (3,), and its acceleration (3,) then."""
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = qpos, velocity
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_comVel(model, data)
        inertia, bias = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
        mujoco.mj_fullM(model, data, inertia)
        mujoco.mj_rne(model, data, 0, bias)
        fall = bias[:3] / self._mass + model.opt.gravity  # the root's first three rows are Newton's law of it all
        return inertia, bias + model.dof_damping * velocity, data.subtree_com[model.jnt_bodyid[0]].copy(), fall

    def _foot(self, body: int, sole: Array, velocity: Array) -> _Foot:
        data = self._data
        place = data.xpos[body].copy()
        jacobian, change = np.zeros((6, len(velocity))), np.zeros((6, len(velocity)))
        mujoco.mj_jac(self._model, data, jacobian[:3], jacobian[3:], place, body)
        mujoco.mj_jacDot(self._model, data, change[:3], change[3:], place, body)
        corners = place + sole @ data.xmat[body].reshape(3, 3).T
        return _Foot(place, data.xquat[body].copy(), jacobian @ velocity, jacobian, change @ velocity, corners)

    def _wishes(
        self, at: int, frame: int, qpos: Array, velocity: Array, com: Array, rows: Array, fall: Array
    ) -> tuple[Array, Array, Array]:
        """Rows (n, nv), what they should be (n,) and how much they count (n,): centre of mass, trunk and joints."""
        course, pull = self._course, self._pull
        spring = np.array([PRESS * pull**2, PRESS * pull**2, TRUNK**2])
        damper = np.array([(1 + PRESS) * pull, (1 + PRESS) * pull, 2 * TRUNK])
        off, slow = course.com[0, at] - com, course.com[1, at] - rows @ velocity
        of_com = 0.5 * (course.com[2, at] + course.com[2, frame]) + spring * off + damper * slow - fall
        turn = quat_to_rotvec(quat_mul(quat_conj(qpos[3:7]), course.qpos[at, 3:7]))
        bend = np.concatenate([turn, course.qpos[at, 7:] - qpos[7:]])
        slow = course.velocity[at, 3:] - velocity[3:]
        of_joints = 0.5 * (course.acceleration[at, 3:] + course.acceleration[frame, 3:])
        of_joints = of_joints + TRUNK**2 * bend + 2 * TRUNK * slow
        weight = np.concatenate([np.full(3, COM), np.full(3, ROOT), self._joint_weight])
        return np.concatenate([rows, np.eye(len(velocity))[3:]]), np.concatenate([of_com, of_joints]), weight

    def _foothold(self, i: int, at: int, frame: int, foot: _Foot, on: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
        """The same of foot number `i`, whose corners `on` (K,) stand: those stay where they are, or it goes its way."""
        course = self._course
        turn = quat_to_rotvec(quat_mul(course.turn[at, i], quat_conj(foot.turn)))
        off = np.concatenate([course.place[at, i] - foot.place, turn])
        if on.any():
            off[slice(None) if on.all() else [0, 1, 5]] = 0.0  # on its edge it tips back
            wanted = LIMBS**2 * off - 2 * LIMBS * foot.velocity
        else:
            slow = course.moves[0, at, i] - foot.velocity
            wanted = 0.5 * course.moves[1, [at, frame], i].sum(0) + LIMBS**2 * off + 2 * LIMBS * slow
        return foot.jacobian, wanted - foot.drift, np.full(6, PLANTED if on.any() else IN_AIR)

    def _solved(
        self, rows: Array, wanted: Array, weight: Array, inertia: Array, bias: Array, push: Array
    ) -> tuple[Array, Array] | None:
        """Accelerations (nv,) and torques (nj,); `push` (nv, n): what n unit forces on soles do to the joints."""
        import daqp

        dofs, forces = push.shape
        square = np.zeros((dofs + forces, dofs + forces))
        square[:dofs, :dofs] = rows.T @ (weight[:, None] * rows) + STILL * np.eye(dofs)
        square[dofs:, dofs:] = FORCE * np.eye(forces)
        linear = np.concatenate([-rows.T @ (weight * wanted), np.zeros(forces)])
        needs = np.hstack([inertia, -push])  # of the root and the servos, beside `bias`
        free, none = np.full(dofs, UNBOUNDED), np.full(forces, UNBOUNDED)
        most = np.concatenate([free, none, np.zeros(6) - bias[:6], self._torque - bias[6:]])
        least = np.concatenate([-free, np.zeros(forces), np.zeros(6) - bias[:6], -self._torque - bias[6:]])
        kind = np.zeros(len(most), np.int32)
        kind[dofs + forces : dofs + forces + 6] = EQUAL
        x, _, flag, _ = daqp.solve(square, linear, needs, most, least, kind)
        return (x[:dofs], (needs @ x + bias)[6:]) if flag > 0 else None

    def _told(self, angle: Array, speed: Array, acceleration: Array, torque: Array) -> Array:
        """(nj,) targets under which position servos give `torque` (nj,) in the mean over a frame, within the ranges."""
        hold = 1 / self._fps
        on_the_way = angle + hold / 2 * speed + hold**2 / 6 * acceleration
        asked = on_the_way + (torque + self._damping * (speed + hold / 2 * acceleration)) / self._gain
        return np.clip(asked, *self._range)


def _carriers(model: mujoco.MjModel, body: int) -> list[int]:
    """The degrees of freedom of the hinges between the root and `body`."""
    found: list[int] = []
    while model.body_parentid[body]:
        first = int(model.body_dofadr[body])
        found += range(first, first + int(model.body_dofnum[body]))
        body = int(model.body_parentid[body])
    return found


def _pushes(foot: _Foot, corner: Array, edges: Array) -> Array:
    """(nv, edges) what unit forces along `edges` (n, 3) at `corner` (3,) of a sole do to the joints."""
    arm = corner - foot.place
    moments = np.cross(arm, edges)
    return foot.jacobian.T @ np.concatenate([edges, moments], axis=1).T
