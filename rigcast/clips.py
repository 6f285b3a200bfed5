"""A service of whole motions, opened: its makers, its idle motion and its sockets."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager

from msgspec.structs import replace

from drivers.clock import MonotonicClock
from drivers.endpoint import endpoints
from drivers.keys import keys_for
from drivers.publisher import Publisher, require_free
from drivers.samples import hello_for
from retarget.rig import Rig
from rigcast.service.desk import Settings
from rigcast.service.making import Idle, Made, Setup
from rigcast.service.player import Part
from rigcast.service.running import Opened
from rigcast.service.service import Service, idle_part
from rigcast.service.workshop import Workshop

POLL_S = 0.05
IDLE_JOB = -1


@contextmanager
def opened(
    rig: Rig, setup: Setup, settings: Settings, endpoint: str, insecure: bool, stopped: Callable[[], bool]
) -> Iterator[Opened | None]:
    """The service once its makers are ready, None where it was `stopped` before. `setup` tells all but the folder.

    Raises StreamError; RuntimeError where a maker cannot begin, or the gate lets the rig not even stand.
    """
    keys = keys_for(endpoints(endpoint), insecure=insecure)
    require_free(endpoint)
    with tempfile.TemporaryDirectory(prefix="rigcast-") as folder:
        setup = replace(setup, folder=folder)
        with (
            closing(Workshop(replace(setup, generator="", candidates=1))) as cutter,
            closing(Workshop(setup)) as maker,
        ):
            idle = _idle(cutter, maker, settings.rate_hz, stopped)
            if idle is None:
                yield None
                return
            clock, hello = MonotonicClock(), hello_for(idle.trajectory, rig, idle.report_id, 0)
            with Publisher(hello, endpoint, keys=keys, insecure=insecure, clock=clock) as publisher:
                service = Service(rig, publisher, idle, maker, cutter, settings, clock)
                yield Opened(service, publisher, clock, lambda: maker.starts + cutter.starts)


def _idle(cutter: Workshop, maker: Workshop, rate: float, stopped: Callable[[], bool]) -> Part | None:
    """The idle motion, once both makers are ready; None where it was stopped before."""
    for step in (_wait(cutter, stopped), _wait(maker, stopped)):
        if step is not None and not step.ok:
            raise RuntimeError(step.detail)
    if stopped():
        return None
    cutter.ask(Idle(IDLE_JOB))
    made = _wait(cutter, stopped)
    return None if made is None else idle_part(made, rate)


def _wait(workshop: Workshop, stopped: Callable[[], bool]) -> Made | None:
    while not stopped():
        if (made := workshop.done()) is not None:
            return made
        time.sleep(POLL_S)
    return None
