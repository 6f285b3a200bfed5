"""A serial port with emulated Dynamixel X servos behind it, for tests, demos and work without a robot.

A pty has neither baud rate nor wire time, so both are modelled: a host that opened the port at another rate than a
servo's is not heard by it, and a reply comes after the time that the bytes and the return delay take on a real wire.
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Sequence
from types import TracebackType

from drivers.bus import BusError
from drivers.calibration import Calibration
from drivers.emulated_bus import EmulatedBus, Event
from drivers.emulated_servo import EmulatedServo
from drivers.registers import BAUD_CODES
from retarget.rig import Rig


class Emulator:
    """An `EmulatedBus` behind a serial port: a context manager; `port` is the path to open, a thread answers there.

    Arguments and errors are those of `EmulatedBus`; raises BusError also where the system has no ptys.
    """

    def __init__(self, rig: Rig, pose: Sequence[float] | None = None, calibration: Calibration | None = None) -> None:
        self._bus = EmulatedBus(rig, pose, calibration)
        self._joint_ids = {s.joint: s.id for s in rig.servos}
        self._lock = threading.Lock()

    def __enter__(self) -> Emulator:
        try:
            import termios
            import tty
        except ImportError:
            raise BusError("this system has no ptys: the bus emulator runs in process only here") from None
        self._rate_of = {getattr(termios, f"B{rate}"): rate for rate in BAUD_CODES if hasattr(termios, f"B{rate}")}
        master, self._slave = os.openpty()  # Our own open slave keeps the port alive between two hosts.
        tty.setraw(self._slave)
        self._master = master
        self._host_speed = lambda: termios.tcgetattr(master)[5]
        self.port = os.ttyname(self._slave)
        self._wake_read, self._wake_write = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="emulated-bus", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.unplug()

    def unplug(self) -> None:
        """Take the port away, as a pulled cable does; the servos stay as they are. Does nothing a second time."""
        if not self._thread.is_alive():
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        for descriptor in (self._master, self._slave, self._wake_read, self._wake_write):
            os.close(descriptor)

    def get(self, joint: str, register: str) -> int:
        """Value of a register of the servo of `joint`, now."""
        with self._lock:
            servo = self._bus.servos[self._joint_ids[joint]]
            servo.advance(time.monotonic())
            return servo.get(register)

    def torque(self) -> dict[str, bool]:
        """Whether the torque of each joint's servo is on."""
        return {joint: bool(self.get(joint, "torque_enable")) for joint in self._joint_ids}

    def servo(self, joint: str) -> EmulatedServo:
        """The servo of `joint`, to hurt it: `fault`, `put`, `motor.jammed`."""
        return self._bus.servos[self._joint_ids[joint]]

    def remove(self, joint: str) -> None:
        """Take the servo of `joint` off the bus: it answers no more."""
        with self._lock:
            del self._bus.servos[self._joint_ids[joint]]

    def events(self, name: str) -> list[Event]:
        """Writes of the register `name` that servos took, in order."""
        with self._lock:
            return [e for e in self._bus.events if e.name == name]

    def _serve(self) -> None:
        while True:
            ready, _, _ = select.select([self._master, self._wake_read], [], [])
            if self._wake_read in ready:
                return
            arrived = time.monotonic()
            data = os.read(self._master, 4096)
            host_baud = self._rate_of.get(self._host_speed())
            if host_baud is None:
                continue
            with self._lock:
                replies = self._bus.exchange(data, arrived, host_baud)
            for after, reply in replies:
                time.sleep(max(0.0, arrived + after - time.monotonic()))
                os.write(self._master, reply)
