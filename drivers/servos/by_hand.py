"""A motion that somebody shows: the torque is off, they move the rig by hand, and its joints are read."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from drivers.bus import Array, BusError, ServoBus
from drivers.clock import Ticker
from motiongen.motion import Label, Source
from retarget.resample import interpolate
from retarget.rig import Rig
from retarget.trajectory import Trajectory

NS = 1_000_000_000
READ_HZ = 50.0
SMOOTH_S = 0.1  # A hand shakes, and a reading is a whole number of ticks: averaged over so long.


def shown(rig: Rig, bus: ServoBus, ended: Callable[[float], bool], clock: Ticker) -> Trajectory:
    """What is done by hand to `rig` on the open `bus` until `ended`, which gets the seconds so far, says so.

    The torque goes off first and stays off. At 50 frames a second, smoothed, the root where the rig stands; from there
    on it is a trajectory like any other, and what it asks of the servos is for the physics check to say. Raises
    BusError where the bus fails, not every joint of the rig can be felt, or less than two readings came.
    """
    if set(bus.joints) != set(rig.joint_names()):
        raise BusError(f"rig {rig.name!r}: every joint needs a servo for a motion to be shown by hand")
    columns = [bus.joints.index(j) for j in rig.joint_names()]
    bus.torque(False)
    times: list[float] = []
    rows: list[Array] = []
    began = clock.now_ns()
    while not ended((clock.now_ns() - began) / NS):
        reading = bus.read()
        if not len(reading.temperature):
            raise BusError(f"rig {rig.name!r}: its servos cannot be felt, so nothing can be shown by hand")
        times.append((clock.now_ns() - began) / NS)
        rows.append(reading.position[columns])
        clock.sleep_until_ns(began + round(len(rows) / READ_HZ * NS))
    if len(rows) < 2:
        raise BusError("nothing was recorded: it ended before two readings had come")
    return _trajectory(rig, np.array(times), np.array(rows))


def _trajectory(rig: Rig, times: Array, angles: Array) -> Trajectory:
    lift = rig.stand_clearance if rig.mount == "stand" else 0.0
    root = np.tile([0.0, 0.0, rig.nominal.height + lift, 1.0, 0.0, 0.0, 0.0], (len(angles), 1))
    frames = np.arange(int((times[-1] - times[0]) * READ_HZ) + 1) / READ_HZ
    qpos = interpolate(times - times[0], np.hstack([root, angles]), frames)
    width = min(round(SMOOTH_S * READ_HZ) | 1, len(qpos) - 1 + len(qpos) % 2)
    padded = np.pad(qpos[:, 7:], ((width // 2, width // 2), (0, 0)), mode="edge")
    kernel = np.ones(width) / width
    qpos[:, 7:] = np.stack([np.convolve(column, kernel, mode="valid") for column in padded.T], axis=1)
    labels = (Label(0.0, len(frames) / READ_HZ, "shown by hand"),)
    return Trajectory(qpos, READ_HZ, rig.name, rig.joint_names(), labels=labels, source=Source("by hand"))
