"""An emulated bus in this process, on a clock of its own: what takes a minute on a wire is over at once, and always
goes the same way. It is a `Wire` for a driver, and a `Ticker` for the loop above it.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import TYPE_CHECKING

from drivers.calibration import Calibration
from drivers.emulation.line import EmulatedLine
from retarget.rig import Rig

if TYPE_CHECKING:
    from drivers.emulation.body import Body

NS = 1_000_000_000


class InProcess(EmulatedLine):
    """See `EmulatedLine`. Time passes only where somebody waits: in `read`, in `sleep_until_ns`, or by `wait`.

    `host_s`: what the host's own work takes, added to each write.
    """

    path = "in process"

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
        host_s: float = 0.0,
    ) -> None:
        super().__init__(rig, pose, calibration, 0.0, body=body, echo=echo, latency_s=latency_s, seed=seed)
        self._time, self._host_s = 0.0, host_s
        self._due: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._here = b""
        self._baud, self._timeout = 0, 0.0
        self._unplugged = False

    def unplug(self) -> None:
        """Take the port away, as a pulled cable does; the servos stay as they are."""
        self._unplugged = True

    def now(self) -> float:
        """Seconds since the start."""
        return self._time

    def now_ns(self) -> int:
        """Nanoseconds since the start."""
        return round(self._time * NS)

    def sleep_until_ns(self, when_ns: int) -> None:
        """Let the time pass until `when_ns`."""
        self._time = max(self._time, when_ns / NS)

    def wait(self, seconds: float) -> None:
        """Let the time pass."""
        self._time += seconds

    def open(self, baud: int, timeout: float) -> InProcess:
        """The host opens the port."""
        self._check()
        self._baud, self._timeout = baud, timeout
        return self

    def close(self) -> None:
        """The host closes the port."""

    def reset_input_buffer(self) -> None:
        """Forget what has come in and was not read."""
        self._arrive()
        self._here = b""

    def write(self, data: bytes) -> int:
        """The host sends."""
        self._check()
        self._time += self._host_s
        for after, reply in self.exchange(data, self._time, self._baud):
            self._count += 1
            heapq.heappush(self._due, (self._time + after, self._count, reply))
        return len(data)

    def read(self, size: int) -> bytes:
        """Up to `size` bytes, fewer where no more come before the timeout."""
        self._check()
        until = self._time + self._timeout
        self._arrive()
        while len(self._here) < size and self._due and self._due[0][0] <= until:
            self._time = max(self._time, self._due[0][0])
            self._arrive()
        if len(self._here) < size:
            self._time = until
        data, self._here = self._here[:size], self._here[size:]
        return data

    def _arrive(self) -> None:
        while self._due and self._due[0][0] <= self._time:
            self._here += heapq.heappop(self._due)[2]

    def _check(self) -> None:
        if self._unplugged:
            raise OSError(5, "Input/output error")
