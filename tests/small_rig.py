"""A rig of three servos and addresses nobody uses, for the tests of the wire and the servo buses."""

from __future__ import annotations

import math
import socket
from pathlib import Path

import numpy as np

from retarget.rig import Bus, Joint, Pose, Power, Rig, Sensors, Servo
from retarget.servos import ServoModel
from retarget.trajectory import Trajectory

XM430 = ServoModel("XM430-W350", "dynamixel2", 1020, 4.1, 46 * 2 * math.pi / 60, 2.3, 12.0, 4096, (0, 4095), "e-Manual")
XL430 = ServoModel("XL430-W250", "dynamixel2", 1060, 1.4, 57 * 2 * math.pi / 60, 1.3, 11.1, 4096, (0, 4095), "e-Manual")
REPORT = "0123456789abcdef"


def small_rig(baud: int = 1_000_000) -> Rig:
    """Joints a, b, c with servos 3, 7, 1: neither in the order of the ids nor all of one model."""
    joints = tuple(Joint(n, -1.5, 1.5, 3.0, 1.0, 4.8, 10.0, 0.5) for n in "abc")
    servos = (Servo("a", "main", 3, XM430), Servo("b", "main", 7, XL430), Servo("c", "main", 1, XM430))
    return Rig(
        name="small",
        folder=Path(),
        model=Path(),
        root="base",
        mount="stand",
        stand_clearance=0.0,
        joints=joints,
        follow=(),
        feet=(),
        nominal=Pose(0.1, {"a": 0.2, "b": -0.1}),
        safe=Pose(0.1, {"a": 0.1}),
        sensors=Sensors(True, False, 0.0),
        power=Power(12.0, 5.0),
        buses=(Bus("main", "dynamixel2", baud),),
        servos=servos,
    )


def swing(rig: Rig, seconds: float = 1.0, fps: float = 50.0, amplitude: float = 0.4) -> Trajectory:
    """Joint a swings once a second about the nominal pose, from rest."""
    t = np.arange(round(seconds * fps) + 1) / fps
    qpos = np.zeros((len(t), 7 + len(rig.joints)))
    qpos[:, 3] = 1.0
    qpos[:, 7:] = rig.pose_vector(rig.nominal)
    qpos[:, 7] += amplitude * 0.5 * (1 - np.cos(2 * np.pi * t))
    return Trajectory(qpos, fps, rig.name, rig.joint_names())


def free_address() -> str:
    """tcp://127.0.0.1:port with five free ports from port on."""
    for _ in range(100):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            first = probe.getsockname()[1]
        if first > 65000:
            continue
        try:
            for port in range(first, first + 5):
                with socket.socket() as probe:
                    probe.bind(("127.0.0.1", port))
        except OSError:
            continue
        return f"tcp://127.0.0.1:{first}"
    raise RuntimeError("no five free ports in a row")
