"""An emulated bus behind a TCP port, where there is no pty or the driver runs on another machine.

Baud rates do not cross a socket: the host is taken to run at the rig's. One host at a time.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING

from drivers.calibration import Calibration
from drivers.emulation.line import TICK_S, EmulatedLine
from retarget.rig import Rig

if TYPE_CHECKING:
    from drivers.emulation.body import Body


class TcpEmulator(EmulatedLine):
    """See `EmulatedLine`. A context manager; `port` is what a driver opens: `socket://127.0.0.1:…`.

    `address`: where to listen; port 0 takes one that is free. Raises OSError where that cannot be.
    """

    def __init__(
        self,
        rig: Rig,
        pose: Sequence[float] | None = None,
        calibration: Calibration | None = None,
        *,
        body: Body | None = None,
        address: tuple[str, int] = ("127.0.0.1", 0),
        seed: int = 0,
    ) -> None:
        super().__init__(rig, pose, calibration, time.monotonic(), body=body, seed=seed)
        self._address, self._baud = address, rig.buses[0].baud

    def __enter__(self) -> TcpEmulator:
        self._server = socket.create_server(self._address)
        host, number = self._server.getsockname()[:2]
        self.port = f"socket://{host}:{number}"
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="emulated-bus", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._stopped.set()
        self._thread.join()
        self._server.close()

    def now(self) -> float:
        """Seconds of CLOCK_MONOTONIC."""
        return time.monotonic()

    def _serve(self) -> None:
        self._server.settimeout(TICK_S)
        while not self._stopped.is_set():
            try:
                host, _ = self._server.accept()
            except TimeoutError:
                self.tick()
                continue
            with host, contextlib.suppress(OSError):  # a host that went away in the middle
                host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                host.settimeout(TICK_S)
                self._talk(host)

    def _talk(self, host: socket.socket) -> None:
        while not self._stopped.is_set():
            try:
                data = host.recv(4096)
            except TimeoutError:
                self.tick()
                continue
            if not data:
                return
            arrived = time.monotonic()
            for after, reply in self.exchange(data, arrived, self._baud):
                time.sleep(max(0.0, arrived + after - time.monotonic()))
                host.sendall(reply)
