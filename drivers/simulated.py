"""A `ServoBus` without a wire: first-order servos in this process, for previews, demos and tests."""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType

import numpy as np

from drivers.bus import Array, BusError, Reading
from drivers.clock import MonotonicClock, Ticker
from drivers.motor import Motor
from drivers.servos.table import model_of
from retarget.rig import FULL_TORQUE_ERROR, Rig

NS = 1_000_000_000
ROOM_TEMPERATURE = 25.0  # °C; the heating of these motors is not modelled


class SimulatedBus:
    """The servos of `rig`, standing at `pose` (nj,) rad, by default its nominal pose; see `ServoBus`.

    `on`: whether the torque is on. Raises BusError where the rig has no servos.
    """

    def __init__(self, rig: Rig, pose: Sequence[float] | None = None, *, clock: Ticker | None = None) -> None:
        if not rig.servos:
            raise BusError(f"rig {rig.name!r} has no servos to simulate")
        angles = dict(zip(rig.joint_names(), rig.pose_vector(rig.nominal) if pose is None else pose, strict=True))
        speeds = {j.name: j.velocity for j in rig.joints}
        self.joints = tuple(s.joint for s in rig.servos)
        self.on = False
        models = [model_of(s.model.name) for s in rig.servos]
        self.motors = [
            Motor(s.model.no_load_speed, model.full_error if model else FULL_TORQUE_ERROR, float(angles[s.joint]))
            for s, model in zip(rig.servos, models, strict=True)
        ]
        self._speeds = [speeds[j] for j in self.joints]
        self._stall = np.array([s.model.stall_current for s in rig.servos])
        self._voltage = np.array([s.model.voltage for s in rig.servos])
        self._goal = [m.angle for m in self.motors]
        self._clock = clock or MonotonicClock()
        self._last_ns = self._clock.now_ns()

    def __enter__(self) -> SimulatedBus:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.torque(False)

    def read(self) -> Reading:
        """Measure all servos."""
        self._advance()
        return Reading(
            position=np.array([m.angle for m in self.motors]),
            current=np.array([m.effort for m in self.motors]) * self._stall,
            temperature=np.full(len(self.motors), ROOM_TEMPERATURE),
            voltage=self._voltage.copy(),
        )

    def write(self, goal: Array) -> None:
        """Goal angles (n,) in rad."""
        self._advance()
        self._goal = [float(g) for g in goal]

    def leave_out(self, joint: str) -> None:
        """Raises ValueError: servos that are only computed do not fail."""
        raise ValueError(f"the servo of {joint} is computed: it cannot fail")

    def torque(self, on: bool) -> None:
        """On where they stand, or off."""
        self._advance()
        self._goal = [m.angle for m in self.motors]
        self.on = on

    def _advance(self) -> None:
        now = self._clock.now_ns()
        dt, self._last_ns = (now - self._last_ns) / NS, now
        for motor, goal, speed in zip(self.motors, self._goal, self._speeds, strict=True):
            motor.advance(dt, goal if self.on else None, speed)
