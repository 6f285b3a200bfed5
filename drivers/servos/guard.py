"""A serial port behind a guard process (`guard_process.py`), as a `Wire`: killing the driver cannot leave torque on."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
import select
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from drivers.bus import BusError
from drivers.servos.guard_process import CHUNK, READY, Orders
from drivers.servos.port import Serial

# On a busy machine a killed process waits for its turn to die, and only then its connection ends: this bounds how long
# the rig waits with it. Ten cycles of a drive, and less than the servos' own watchdog, which keeps their torque.
SILENCE_S = 0.2
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
        connection = socket.create_connection(("127.0.0.1", int(said.removeprefix(READY))), timeout)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # else a request waits 40 ms behind a goal
        connection.sendall(token.encode())
        return _Guarded(connection, process)

    def now(self) -> float:
        """Seconds of CLOCK_MONOTONIC."""
        return time.monotonic()


class _Guarded:
    """The connection to the guard; closing it waits until the guard has let go of the port."""

    def __init__(self, connection: socket.socket, process: subprocess.Popen[str]) -> None:
        self._connection, self._process = connection, process

    def write(self, data: bytes) -> int:
        """Send all of `data`."""
        self._connection.sendall(data)
        return len(data)

    def read(self, size: int) -> bytes:
        """Up to `size` bytes, none where none came within the timeout. Raises OSError where the guard is gone."""
        try:
            data = self._connection.recv(size)
        except TimeoutError:
            return b""
        if not data:
            raise ConnectionError(errno.EPIPE, "the guard has ended")
        return data

    def reset_input_buffer(self) -> None:
        """Forget what has come in and was not read."""
        while select.select([self._connection], [], [], 0)[0]:
            self.read(CHUNK)

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
