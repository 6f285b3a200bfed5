"""The physics scene: a rig on a floor, a position servo on every joint, and what holds the base.

`free` nothing holds it; `stand` the root is bolted where the motion starts; `hung` a harness pulls the root along the
path that it should take.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from retarget.model import load_spec
from retarget.rig import MOUNTS, Mount, Rig
from sim.harness import add_harness, fit_harness

TIMESTEP = 0.002  # s
FLOOR = "floor"
FRICTION = 0.8  # rubber sole on wood or short carpet


@dataclass(frozen=True)
class Scene:
    """A compiled scene: MuJoCo's qpos is the trajectory's row, without the root where that is bolted (`stand`).

    Actuators, and degrees of freedom after the root's, are the rig's joints in order; a harness adds six actuators.
    """

    model: mujoco.MjModel
    rig: Rig
    mount: Mount

    def place(self, data: mujoco.MjData, qpos: ArrayLike) -> None:
        """Put `qpos` (7 + nj,), root first, into `data`; a bolted root stays where it is."""
        row = np.asarray(qpos, float)
        data.qpos[:] = row[7:] if self.mount == "stand" else row

    def read(self, data: mujoco.MjData) -> NDArray[np.float64]:
        """The pose (7 + nj,) in `data`, root first; a bolted root is where it was bolted."""
        if self.mount != "stand":
            return data.qpos.copy()
        root = self.model.body(self.rig.root)
        return np.concatenate([root.pos, root.quat, data.qpos])

    @property
    def mass(self) -> float:
        """Kilograms of the whole rig."""
        return float(self.model.body_subtreemass[self.model.body(self.rig.root).id])

    @property
    def weight(self) -> float:
        """Newtons that the whole rig weighs."""
        return self.mass * float(np.linalg.norm(self.model.opt.gravity))


def build_scene(rig: Rig, mount: Mount, root: ArrayLike) -> Scene:
    """The scene for `rig` held by `mount`, its root starting, or bolted, where the trajectory row `root` has it.

    Raises ValueError for an unknown mount, and RigError (from `load_spec`) where the model does not fit the rig.
    """
    if mount not in MOUNTS:
        raise ValueError(f"unknown mount {mount!r}; there are {', '.join(MOUNTS)}")
    pose = np.asarray(root, float)[:7]
    spec = load_spec(rig)
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10  # without it a standing foot creeps
    add_floor(spec)
    _add_servos(spec, rig)
    if mount == "stand":
        body = spec.body(rig.root)
        spec.delete(body.joints[0])  # the free joint: load_spec sees to it that there is just this one
        body.pos, body.quat = pose[:3], pose[3:]
    if mount == "hung":
        add_harness(spec, rig, pose)
    scene = Scene(spec.compile(), rig, mount)
    if mount == "hung":
        fit_harness(scene.model, scene.mass)
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


def _add_servos(spec: mujoco.MjSpec, rig: Rig) -> None:
    for joint in rig.joints:
        servo = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=joint.kp, kv=joint.kv)
        servo.forcelimited = True
        servo.forcerange = [-joint.torque, joint.torque]
