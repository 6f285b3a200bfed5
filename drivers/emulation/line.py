"""An emulated bus and what may happen to it: noise, echo, latency, jammed joints, servos that die, dips of the supply.

The two ways to reach it are one file each: `emulator.py` gives it a serial port, `in_process.py` a clock of its own.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from random import Random
from typing import TYPE_CHECKING

from drivers.calibration import Calibration
from drivers.emulation.board import EmulatedBoard, PulseServo
from drivers.emulation.bus import EmulatedBus
from drivers.emulation.listeners import Event
from drivers.emulation.noise import Noise, hurt
from drivers.emulation.servo import EmulatedServo
from retarget.rig import Rig
from retarget.servos import BOARDS

if TYPE_CHECKING:
    from drivers.emulation.body import Array, Body
    from drivers.upright import Felt

TRAFFIC_KEPT = 100_000
TICK_S = 0.02  # how often a body moves on while nobody asks


class EmulatedLine:
    """The emulated bus of `rig`; arguments and errors of `EmulatedBus`, `now` s being the time at the start.

    `noise` on the line may be set at any time; it is the same each time from one `seed`. `echo`: the host hears what it
    sends, as on many half-duplex adapters. `latency_s`: what a USB adapter waits before it passes answers on.
    `traffic`: what the host sent, as it sent it.
    """

    def __init__(
        self,
        rig: Rig,
        pose: Sequence[float] | None,
        calibration: Calibration | None,
        now: float,
        *,
        body: Body | None = None,
        echo: bool = False,
        latency_s: float = 0.0,
        seed: int = 0,
    ) -> None:
        kind = EmulatedBoard if rig.buses and rig.buses[0].protocol in BOARDS else EmulatedBus
        self.bus = kind(rig, pose, calibration, now, body)
        self._body = body
        self._joint_ids = {s.joint: s.id for s in rig.servos}
        self._lock = threading.Lock()
        self._echo, self._latency_s, self._random = echo, latency_s, Random(seed)
        self.noise = Noise()
        self.traffic: deque[bytes] = deque(maxlen=TRAFFIC_KEPT)

    def now(self) -> float:
        """Seconds of the clock that the bus runs on."""
        raise NotImplementedError

    def exchange(self, data: bytes, arrived: float, host_baud: int) -> list[tuple[float, bytes]]:
        """What comes back on `data` that a host sent: (seconds after `arrived`, bytes), in order."""
        noise = self.noise
        self.traffic.append(data)
        with self._lock:
            reaches = hurt(data, noise, self._random) if noise.down else data
            replies = self.bus.exchange(reaches, arrived, host_baud)
        if noise.up:
            replies = [(after, hurt(reply, noise, self._random)) for after, reply in replies]
        if self._echo:
            replies.insert(0, (0.0, data))
        return [(after + noise.late_s + self._latency_s, reply) for after, reply in replies]

    def tick(self) -> None:
        """Let the body's time pass while nobody asks anything; does nothing where there is none."""
        if self._body is not None:
            with self._lock:
                self._body.advance(self.now())

    def qpos(self) -> Array:
        """Where the body is now, (7 + nj,) as of `Trajectory`. Raises ValueError where the servos turn none."""
        if self._body is None:
            raise ValueError("the servos of this bus turn no body")
        self.tick()
        with self._lock:
            return self._body.qpos()

    def felt(self) -> Felt:
        """What the IMU on the body's root says. Raises ValueError where the servos turn no body."""
        if self._body is None:
            raise ValueError("the servos of this bus turn no body")
        self.tick()
        with self._lock:
            return self._body.felt()

    def get(self, joint: str, register: str) -> int:
        """Value of a register of the servo of `joint`, now."""
        with self._lock:
            servo = self.bus.servos[self._joint_ids[joint]]
            servo.advance(self.now())
            return servo.get(register)

    def torque(self) -> dict[str, bool]:
        """Whether the torque of each joint's servo is on."""
        return {j: bool(self.get(j, "torque_enable")) for j, i in self._joint_ids.items() if i in self.bus.servos}

    def servo(self, joint: str) -> EmulatedServo:
        """The servo of `joint`, to hurt it: `fail`, `put`, `reboot`. A hobby servo has nothing to hurt: TypeError."""
        servo = self.bus.servos[self._joint_ids[joint]]
        if isinstance(servo, PulseServo):
            raise TypeError(f"{joint}: a hobby servo has no registers")
        return servo

    def jam(self, joint: str) -> None:
        """Hold the shaft of `joint` still."""
        self.bus.servos[self._joint_ids[joint]].motor.jammed = True

    def remove(self, joint: str) -> None:
        """Take the servo of `joint` off the bus: it answers no more."""
        with self._lock:
            del self.bus.servos[self._joint_ids[joint]]

    def brown_out(self) -> None:
        """The supply dips: every servo, or the board, starts anew."""
        with self._lock:
            self.bus.brown_out(self.now())

    def events(self, name: str) -> list[Event]:
        """Writes of the register `name` that servos took, in order."""
        with self._lock:
            return [e for e in self.bus.events if e.name == name]
