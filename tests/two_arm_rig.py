"""A rig whose physics can be worked out on paper: a heavy base on one foot, and two arms with their mass at the tip.

The root is 0.93 m high, so that thresholds apply unscaled. `left` lifts its arm (it lies level at 0, up is positive);
`right` swings its arm about the vertical, towards the left arm, which it meets at about 0.6 rad.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from retarget.rig import Bus, Follow, Foot, Joint, Mount, Pose, Power, Rig, Sensors, Servo
from retarget.servos import ServoModel
from retarget.trajectory import Trajectory

BASE_MASS, TIP_MASS, REACH = 10.0, 0.5, 0.3  # kg, kg, m
HEIGHT, HALF_FOOT = 0.93, 0.15  # m
GRAVITY = 9.81
WEIGHT = (BASE_MASS + 2 * TIP_MASS) * GRAVITY
TORQUE, NO_LOAD_SPEED = 4.0, 5.0
STALL_CURRENT, MASS = 1.5, 0.08  # A at 12 V, kg
JOINTS = ("left", "right")

ARM = """<body name="{name}_arm" pos="0 {y} 0"><joint name="{name}" axis="{axis}"/>
  <geom type="capsule" size="0.03" fromto="0.1 0 0 0.28 0 0" mass="0"/>
  <geom type="sphere" size="0.04" pos="0.3 0 0" mass="0.5"/><site name="{name}_hand" pos="0.3 0 0"/></body>"""
MODEL = f"""<mujoco><compiler angle="radian"/><worldbody><body name="base" pos="0 0 0.93"><freejoint/>
  <geom type="box" size="0.15 0.15 0.02" pos="0 0 -0.91" mass="0"/>
  <geom type="sphere" size="0.05" mass="10"/>
  <site name="heel" pos="-0.15 0 -0.93"/><site name="toe" pos="0.15 0 -0.93"/>
  {ARM.format(name="left", y=0.1, axis="0 -1 0")}{ARM.format(name="right", y=-0.1, axis="0 0 1")}
</body></worldbody></mujoco>"""


def two_arm_rig(
    folder: Path,
    *,
    mount: Mount = "free",
    torque: float = TORQUE,
    no_load_speed: float = NO_LOAD_SPEED,
    kp: float = 80.0,
    kv: float = 2.0,
    play: float = 0.0,
    friction: float = 0.0,
) -> Rig:
    """The rig, its model written into `folder`; gears without play (rad) and friction (N·m) unless told."""
    servo = ServoModel(
        "paper", "dynamixel2", 1, torque, no_load_speed, STALL_CURRENT, 12.0, 4096, (0, 4095), "", MASS, play, friction
    )
    (folder / "model.xml").write_text(MODEL)
    return Rig(
        name="two_arm",
        folder=folder,
        model=folder / "model.xml",
        root="base",
        mount=mount,
        stand_clearance=0.1,
        joints=tuple(Joint(n, -2.0, 2.0, 0.7 * no_load_speed, torque, no_load_speed, kp, kv) for n in JOINTS),
        follow=(Follow("left_hand", "left_wrist", 1, 0), Follow("base", "left_ankle", 1, 0)),
        feet=(Foot("foot", "base", ("heel", "toe"), "left_ankle"),),
        nominal=Pose(HEIGHT, {}),
        safe=Pose(HEIGHT, {}),
        sensors=Sensors(encoders=True, imu=False, delay=0.02),
        power=Power(12.0, 1.0),
        buses=(Bus("main", "dynamixel2", 1_000_000),),
        servos=tuple(Servo(n, "main", i, servo) for i, n in enumerate(JOINTS)),
    )


def two_arm_motion(
    *,
    seconds: float = 1.0,
    fps: float = 50.0,
    left: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    right: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    root: Callable[[np.ndarray], np.ndarray] = lambda t: np.zeros((len(t), 3)),
    quat: tuple[float, float, float, float] = (1, 0, 0, 0),
) -> Trajectory:
    """Joint angles (rad) and displacement of the root (m) from standing, each as a function of time (T,)."""
    t = np.arange(round(seconds * fps) + 1) / fps
    place = np.array([0, 0, HEIGHT]) + root(t)
    qpos = np.hstack([place, np.tile(quat, (len(t), 1)), left(t)[:, None], right(t)[:, None]])
    return Trajectory(qpos, fps, "two_arm", JOINTS, contacts={"foot": np.ones(len(t), bool)})
