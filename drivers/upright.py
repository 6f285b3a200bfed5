"""Staying upright while a motion is driven: what the IMU feels moves the ankles, as it did in the run that was checked.

The law and its gains are `sim/upright.py`; here it runs cycle by cycle, on frames and an IMU.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drivers.bus import Array
from drivers.frame import Frame
from drivers.messages import OPEN_LOOP
from motiongen.rotation import quat_conj, quat_mul, quat_to_rotvec
from retarget.rig import Rig
from sim.upright import corrections, lean, upright_of

IMU = "imu"  # the controller of a stream that needs this


@dataclass(frozen=True)
class Felt:
    """What an IMU says of the root: `turn` (4,) w x y z in a world that is level, its yaw being anything; `spin` (3,)
    rad/s about the root's own axes.
    """

    turn: Array
    spin: Array


class Imu(Protocol):
    """The IMU on the root of a rig."""

    def felt(self) -> Felt:
        """What it says now, which is as old as the rig's `sensors.delay`. Raises BusError where it does not answer."""
        ...


def missing(controller: str, imu: Imu | None) -> str:
    """What a stream that needs `controller` lacks where there is this `imu`; nothing where it has all."""
    if controller == OPEN_LOOP or (controller == IMU and imu is not None):
        return ""
    here = f"{OPEN_LOOP!r} alone" if imu is None else f"{OPEN_LOOP!r} and {IMU!r}"
    return f"the stream needs the controller {controller!r}; here runs {here}"


class Standing:
    """Keeps `rig` upright by its `imu`, asked `rate_hz` times a second.

    Raises ValueError where the rig has no IMU, or no foot of it gains (`[foot.upright]`).
    """

    def __init__(self, rig: Rig, imu: Imu, rate_hz: float) -> None:
        self._upright, self._imu, self._rate_hz = upright_of(rig), imu, rate_hz
        self._feet = np.arange(len(rig.feet))
        old = math.ceil(self._upright.delay * rate_hz - 1e-9) + 1  # what is felt follows from the cycle before that
        self._roots: deque[Array] = deque(maxlen=old + 1)

    def added(self, frame: Frame) -> Array:
        """(nj,) rad to add to the targets of `frame`, in the rig's order."""
        self._roots.append(frame.root[0, 3:].astype(float))
        asked, then = self._roots[0], self._roots[min(1, len(self._roots) - 1)]
        turning = quat_to_rotvec(quat_mul(quat_conj(asked), then)) * self._rate_hz
        felt = self._imu.felt()
        leans = lean(felt.turn, felt.spin, asked, turning, self._upright.ahead)
        return corrections(self._upright, leans, (frame.contacts[0] >> self._feet & 1).astype(bool))
