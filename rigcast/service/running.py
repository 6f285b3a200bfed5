"""A service of either kind, run until it is told to end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from drivers.clock import Ticker
from drivers.control import Status
from drivers.publisher import Publisher

NS = 1_000_000_000
LEAVE_S = 8.0


class Streaming(Protocol):
    """A service: call `cycle` until `over`, then `finish`; `leave` leads the rig to rest."""

    counts: Counter[str]

    @property
    def over(self) -> bool: ...

    @property
    def outcomes(self) -> dict[str, int]: ...

    def cycle(self) -> None: ...

    def leave(self, why: str) -> None: ...

    def finish(self) -> None: ...

    def status(self) -> Status: ...


@dataclass(frozen=True)
class Opened:
    """A service that is ready, and what it streams by; `starts`: how many times a process of its own was started."""

    service: Streaming
    publisher: Publisher
    clock: Ticker
    starts: Callable[[], int]


def run(service: Streaming, caught: Callable[[], int], each_second: Callable[[], None], clock: Ticker) -> None:
    """Go on until a signal was caught; then lead back to rest, for `LEAVE_S` at most or until a second signal."""
    next_ns = end_ns = 0
    while not service.over and caught() < 2:
        service.cycle()
        now = clock.now_ns()
        if now >= next_ns:
            next_ns = now + NS
            each_second()
        if caught() and not end_ns:
            end_ns = now + int(LEAVE_S * NS)
            service.leave("the service is ending")
        if end_ns and now > end_ns:
            break
    service.finish()
