"""A serial port with emulated servos behind it, for tests, demos and work without a robot.

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
from typing import TYPE_CHECKING

from drivers.bus import BusError
from drivers.calibration import Calibration
from drivers.emulation.line import TICK_S, EmulatedLine
from retarget.rig import Rig

if TYPE_CHECKING:
    from drivers.emulation.body import Body

RATES = (9600, 19200, 38400, 57600, 115200, 500000, 1000000, 2000000, 3000000, 4000000)  # those that termios names


class Emulator(EmulatedLine):
    """An emulated bus behind a serial port: a context manager; `port` is the path to open, a thread answers there.

    Arguments and errors are those of `EmulatedLine`; raises BusError also where the system has no ptys.
    """

    def __init__(
        self,
        rig: Rig,
        pose: Sequence[float] | None = None,
        calibration: Calibration | None = None,
        *,
        body: Body | None = None,
        echo: bool = False,
        latency_s: float = 0.0,
        seed: int = 0,
    ) -> None:
        super().__init__(rig, pose, calibration, time.monotonic(), body=body, echo=echo, latency_s=latency_s, seed=seed)

    def __enter__(self) -> Emulator:
        try:
            import termios
            import tty
        except ImportError:
            raise BusError("this system has no ptys: the bus emulator runs in process only here") from None
        self._rate_of = {getattr(termios, f"B{rate}"): rate for rate in RATES if hasattr(termios, f"B{rate}")}
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

    def now(self) -> float:
        """Seconds of CLOCK_MONOTONIC."""
        return time.monotonic()

    def unplug(self) -> None:
        """Take the port away, as a pulled cable does; the servos stay as they are. Does nothing a second time."""
        if not self._thread.is_alive():
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        for descriptor in (self._master, self._slave, self._wake_read, self._wake_write):
            os.close(descriptor)

    def _serve(self) -> None:
        idle_s = None if self._body is None else TICK_S
        while True:
            ready, _, _ = select.select([self._master, self._wake_read], [], [], idle_s)
            if self._wake_read in ready:
                return
            if not ready:
                self.tick()
                continue
            arrived = time.monotonic()
            data = os.read(self._master, 4096)
            host_baud = self._rate_of.get(self._host_speed())
            if host_baud is None:
                continue
            for after, reply in self.exchange(data, arrived, host_baud):
                time.sleep(max(0.0, arrived + after - time.monotonic()))
                os.write(self._master, reply)
