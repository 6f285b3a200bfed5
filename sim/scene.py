"""The physics scene: a rig on a floor, a servo on every joint, and what holds the base.

`free` nothing holds it; `stand` the root is bolted where the motion starts; `hung` a harness pulls the root along the
path that it should take.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from retarget.model import load_spec, without_looks
from retarget.rig import MOUNTS, Joint, Mount, Rig, Servo
from sim.harness import add_force_sensor, add_harness, fit_harness

TIMESTEP = 0.002  # s
FLOOR = "floor"
FRICTION = 0.8  # rubber sole on wood or short carpet
GAIN, DAMPING, DRIVE = 4, 6, 7  # columns of a motor's gainprm: kp, kv, and the voltage that its supply has
PLAY = "{}_play"  # the joint between the gears' stops
# Estimates: a limb that is free between the stops is still in grease, and the last gear turns with it.
PLAY_DAMPING = 0.01  # of the servo's stall torque over its no-load speed
PLAY_INERTIA = 5e-5  # kg·m² for every N·m of stall torque
ROTOR_INERTIA = 3e-3  # the same of a rotor behind its gears, where the model has none; stops are as stiff as it is
# MuJoCo's constraints give way a little: the stops' in two time steps, and friction creeps ten times less than by
# default.
STOPS = (2 * TIMESTEP, 1.0)
STICKING = (0.99, 0.99, 0.001, 0.5, 2.0)


@dataclass(frozen=True)
class Scene:
    """A compiled scene. Actuators are the rig's joints in order, and sensors their torques; a harness adds six of both.

    `joint_qpos` and `joint_dof` (nj,): where the servos' shafts are in MuJoCo's qpos and qvel. `play` (n, 2): number of
    a joint whose gears have play, and where its play is in qpos; empty where the scene was built without.
    """

    model: mujoco.MjModel
    rig: Rig
    mount: Mount
    joint_qpos: NDArray[np.int_]
    joint_dof: NDArray[np.int_]
    play: NDArray[np.int_]

    def place(self, data: mujoco.MjData, qpos: ArrayLike) -> None:
        """Put `qpos` (7 + nj,), root first, into `data`, gears in the middle; a bolted root stays where it is."""
        data.qpos[:] = self.poses(np.asarray(qpos, float)[None])[0]

    def poses(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """MuJoCo's qpos (T, nq) of `rows` (T, 7 + nj), gears in the middle: what `rows` takes apart."""
        out = np.zeros((len(rows), self.model.nq))
        out[:, self.joint_qpos] = rows[:, 7:]
        if self.mount != "stand":
            out[:, :7] = rows[:, :7]
        return out

    def rows(self, qpos: NDArray[np.float64]) -> NDArray[np.float64]:
        """Poses (T, 7 + nj), root first, of MuJoCo's `qpos` (T, nq); a bolted root is where it was bolted."""
        angles = qpos[:, self.joint_qpos]
        angles[:, self.play[:, 0]] += qpos[:, self.play[:, 1]]
        body = self.model.body(self.rig.root)
        held = np.tile(np.concatenate([body.pos, body.quat]), (len(qpos), 1))
        return np.hstack([held if self.mount == "stand" else qpos[:, :7], angles])

    @property
    def mass(self) -> float:
        """Kilograms of the whole rig."""
        return float(self.model.body_subtreemass[self.model.body(self.rig.root).id])

    @property
    def weight(self) -> float:
        """Newtons that the whole rig weighs."""
        return self.mass * float(np.linalg.norm(self.model.opt.gravity))


def build_scene(rig: Rig, mount: Mount, root: ArrayLike, *, play: bool = False) -> Scene:
    """The scene for `rig` held by `mount`, its root starting, or bolted, where the trajectory row `root` has it.

    With `play` the gears of its servos have the play of their model, which doubles the joints.

    Raises ValueError for an unknown mount, and RigError (from `load_spec`) where the model does not fit the rig.
    """
    if mount not in MOUNTS:
        raise ValueError(f"unknown mount {mount!r}; there are {', '.join(MOUNTS)}")
    pose = np.asarray(root, float)[:7]
    spec = load_spec(rig)
    without_looks(spec)
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10  # without it a standing foot creeps
    add_floor(spec)
    for joint in rig.joints:
        _add_motor(spec, joint)
    measured = {j.name: j.friction for j in rig.joints if j.friction is not None}
    for servo in rig.servos:
        _fit_servo(spec, rig, servo, measured.get(servo.joint, servo.model.friction), play)
    if mount == "stand":
        body = spec.body(rig.root)
        spec.delete(body.joints[0])  # the free joint: load_spec sees to it that there is just this one
        body.pos, body.quat = pose[:3], pose[3:]
    if mount == "hung":
        add_harness(spec, rig, pose)
    model = spec.compile()
    joints = [model.joint(name) for name in rig.joint_names()]
    loose = [(i, PLAY.format(j.name)) for i, j in enumerate(joints) if spec.joint(PLAY.format(j.name)) is not None]
    scene = Scene(
        model=model,
        rig=rig,
        mount=mount,
        joint_qpos=np.array([j.qposadr[0] for j in joints]),
        joint_dof=np.array([j.dofadr[0] for j in joints]),
        play=np.array([(i, model.joint(name).qposadr[0]) for i, name in loose], int).reshape(-1, 2),
    )
    if mount == "hung":
        fit_harness(model, scene.mass)
    return scene


def add_floor(spec: mujoco.MjSpec) -> mujoco.MjsGeom:
    """An endless plane at z = 0; everything is said, since a rig's own defaults would apply to it."""
    return spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 0.05],
        contype=1,
        conaffinity=1,
        condim=3,
        friction=[FRICTION, 0.005, 0.0001],
        group=0,
    )


def _add_motor(spec: mujoco.MjSpec, joint: Joint) -> None:
    """A DC motor under a position controller: `kp · error − kv · ω`, as far as its voltage drives that.

    Forward it gives at most `torque · (1 − |ω| / no_load_speed)`, backward at most `torque`: MuJoCo's model of a motor
    of resistance R and constant K, in units of its rated voltage.
    """
    motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    constant = 1.0 / joint.no_load_speed  # V·s/rad at 1 V
    motor.set_to_dcmotor(
        motorconst=[constant, constant],
        resistance=constant / joint.torque,
        saturation=[joint.torque, 0, 0],
        controller=[joint.kp, 0, joint.kv, 0, 0, 1.0],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_POS),
    )
    add_force_sensor(spec, joint.name)


def _fit_servo(spec: mujoco.MjSpec, rig: Rig, servo: Servo, friction: float, play: bool) -> None:
    """The supply that drives the motor, the friction of its gears and, where asked for, their play."""
    motor, hinge = spec.actuator(servo.joint), spec.joint(servo.joint)
    drive = rig.supply(servo)
    gain = motor.gainprm.copy()
    gain[DRIVE] = drive
    motor.gainprm = gain
    motor.forcerange = drive * motor.forcerange
    hinge.frictionloss, hinge.solimp_friction = friction, STICKING
    if play and servo.model.play:
        unit = math.degrees(1) if spec.compiler.degree else 1.0
        half = 0.5 * servo.model.play * unit
        hinge.armature = hinge.armature or ROTOR_INERTIA * servo.model.stall_torque
        hinge.parent.add_joint(
            name=PLAY.format(servo.joint),
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=hinge.axis,
            pos=hinge.pos,
            limited=True,
            range=[-half, half],
            armature=PLAY_INERTIA * servo.model.stall_torque,
            damping=[PLAY_DAMPING * servo.model.stall_torque / servo.model.no_load_speed, 0, 0],
            frictionloss=0.0,
            solref_limit=STOPS,
            stiffness=[0.0, 0.0, 0.0],
        )
