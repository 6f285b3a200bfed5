"""The harness of a hung rig: springs and dampers that pull the root along the path that it should take.

Six actuators act between the root and two moving frames, three forces in world axes and three torques. Each is a
critically damped spring for the whole rig's mass, limited as a strap is: it lifts but never pushes down, and what it
gives sideways and in turning has an end, so that feet which jam on the floor stop the rig instead of being crushed.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import slerp
from retarget.rig import Rig
from retarget.trajectory import Trajectory

Array = NDArray[np.float64]

STIFFNESS = 50.0  # rad/s, natural frequency: a rig that hangs free sags by g / 50², 4 mm
LIFT = 3.0  # weights, upward at most
PULL = 1.0  # weights, sideways at most
TWIST = 1.0  # weights times radius of gyration, at most
GYRATION = 0.3  # radius of gyration of an upright figure over its root height
# A damper resists motion in the world, not relative to the moving frame, and so would trail it by this long.
LAG = 2 / STIFFNESS  # s


def add_harness(spec: mujoco.MjSpec, rig: Rig, pose: Array) -> None:
    """Add the frames, at `pose` (7,), and the six actuators, after those of the rig; all for a rig of 1 kg."""
    spec.body(rig.root).add_site(name="harness", group=4)
    for frame in ("harness_place", "harness_turn"):
        body = spec.worldbody.add_body(name=frame, mocap=True, pos=pose[:3])
        body.add_site(name=frame, group=4)
    spec.body("harness_turn").quat = pose[3:]
    gravity, radius = float(np.linalg.norm(spec.option.gravity)), GYRATION * rig.nominal.height
    pull, twist = PULL * gravity, TWIST * gravity * radius
    limits = [(-pull, pull), (-pull, pull), (0.0, LIFT * gravity), *[(-twist, twist)] * 3]
    for axis, (low, high) in enumerate(limits):
        spring = spec.add_actuator(
            name=f"harness_{axis}",
            trntype=mujoco.mjtTrn.mjTRN_SITE,
            target="harness",
            refsite="harness_place" if axis < 3 else "harness_turn",
            gear=np.eye(6)[axis],
        )
        inertia = 1.0 if axis < 3 else radius**2
        spring.set_to_position(kp=inertia * STIFFNESS**2, kv=2 * inertia * STIFFNESS)
        spring.forcelimited = True
        spring.forcerange = [low, high]
        add_force_sensor(spec, spring.name)


def add_force_sensor(spec: mujoco.MjSpec, actuator: str) -> None:
    """Record what `actuator` gives (N or N·m) at every step."""
    spec.add_sensor(
        name=f"{actuator}_force",
        type=mujoco.mjtSensor.mjSENS_ACTUATORFRC,
        objtype=mujoco.mjtObj.mjOBJ_ACTUATOR,
        objname=actuator,
    )


def fit_harness(model: mujoco.MjModel, mass: float) -> None:
    """Scale the six actuators, the last of the model, to a rig of `mass` kg, which only the compiled model knows."""
    model.actuator_gainprm[-6:, 0] *= mass
    model.actuator_biasprm[-6:, 1:3] *= mass
    model.actuator_forcerange[-6:] *= mass


def harness_path(trajectory: Trajectory, at: Array) -> Array:
    """The pose (N, 7) to pull to at the times `at` (N,), in frames: a place between two of them."""
    last = len(trajectory) - 1
    at = np.clip(at + LAG * trajectory.fps, 0, last)
    low = at.astype(int)
    high, u = np.minimum(low + 1, last), at - low
    pos = trajectory.root_pos[low] + u[:, None] * (trajectory.root_pos[high] - trajectory.root_pos[low])
    return np.hstack([pos, slerp(trajectory.root_quat[low], trajectory.root_quat[high], u)])
