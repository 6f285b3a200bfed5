"""A serial port behind a guard process (`guard_process.py`), as a `Wire`: killing the driver cannot leave torque on."""

from __future__ import annotations

import contextlib
import os
import secrets
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import serial

from drivers.bus import BusError
from drivers.servos.guard_process import READY, Orders
from drivers.servos.port import Serial

SILENCE_S = 0.4  # shorter than the servos' own watchdog, which stops them but keeps their torque
LAST_WORDS_S = 3.0


@dataclass(frozen=True)
class GuardedWire:
    """The serial port `path`, opened by a process of its own that sends `off` once the connection to it has ended.

    `silence_s`: the longest silence of the driver that is taken for life, None for a driver that may be silent.
    """

    path: str
    off: bytes
    silence_s: float | None = SILENCE_S

    def open(self, baud: int, timeout: float) -> Serial:
        """Start the guard. Raises BusError where it cannot open the port."""
        token = secrets.token_hex(16)
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "drivers.servos.guard_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        )
        said = _told(process, Orders(self.path, baud, self.off.hex(), self.silence_s, token))
        if not said.startswith(READY):
            process.wait()
            raise BusError(said or f"the guard of {self.path!r} did not start")
        connection = serial.serial_for_url(f"socket://127.0.0.1:{said.removeprefix(READY)}", timeout=timeout)
        connection.write(token.encode())
        return _Guarded(connection, process)

    def now(self) -> float:
        """Seconds of CLOCK_MONOTONIC."""
        return time.monotonic()


class _Guarded:
    """The connection to the guard; closing it waits until the guard has let go of the port."""

    def __init__(self, connection: Serial, process: subprocess.Popen[str]) -> None:
        self._connection, self._process = connection, process
        self.write, self.read = connection.write, connection.read
        self.reset_input_buffer = connection.reset_input_buffer

    def close(self) -> None:
        """Let the guard switch off and end."""
        self._connection.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(LAST_WORDS_S)


def _told(process: subprocess.Popen[str], orders: Orders) -> str:
    """The guard's one line in answer to its orders."""
    if process.stdin is None or process.stdout is None:
        raise ValueError("the guard has no pipes")
    with process.stdin as to, process.stdout as out:
        with contextlib.suppress(BrokenPipeError):
            to.write(orders.line())
            to.flush()
        return out.readline().strip()
