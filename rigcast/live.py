"""A live service, opened: weights, rig, line, thread and sockets."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from drivers.clock import MonotonicClock
from drivers.control import Told
from drivers.endpoint import DEFAULT, endpoints
from drivers.keys import keys_for
from drivers.publisher import Publisher, require_free
from drivers.samples import hello_for
from motiongen.diffusion.weights import weights_path
from motiongen.live.generator import LiveGenerator
from motiongen.live.steering import Area
from motiongen.motion import Source
from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from rigcast.service.desk import Settings
from rigcast.service.line import FPS, Line
from rigcast.service.live_maker import LiveMaker
from rigcast.service.live_service import LiveService
from rigcast.service.running import Opened
from sim.checks import report_id

NAME = "live"
READY_S = 0.4  # admitted before the first frame goes out
POLL_S = 0.02


@dataclass(frozen=True)
class Stage:
    """What is opened: a `rig`, held by `mount`; name or file of the `generator`; `endpoint` and who may reach it.

    `floor`: metres from where it begins, forward and back, left and right, that it may walk; None: any.
    """

    rig: Rig
    mount: Mount | None = None
    generator: str = NAME
    seed: int = 0
    floor: float | None = None
    endpoint: str = DEFAULT
    insecure: bool = False
    lease_s: float = 10.0


@dataclass(frozen=True)
class Live(Opened):
    """The same of a live service: what is typed goes to it, and its `line` tells what making motion took."""

    service: LiveService
    line: Line


@contextmanager
def opened(
    stage: Stage, stopped: Callable[[], bool], told: Callable[[Told], None] = lambda said: None
) -> Iterator[Live | None]:
    """The service once its first frames are there, None where it was `stopped` before; `told` as it has it.

    Raises ValueError for a floor that is none or a rig that is not on a stand, WeightsError, StreamError, and, at the
    end too, what making motion raised.
    """
    if stage.floor is not None and not stage.floor > 0:
        raise ValueError(f"a floor of {stage.floor:g} m; say how many metres it may walk in each direction")
    keys = keys_for(endpoints(stage.endpoint), insecure=stage.insecure)
    require_free(stage.endpoint)
    area = None if stage.floor is None else Area((-stage.floor, -stage.floor), (stage.floor, stage.floor))
    generator = LiveGenerator(weights_path(stage.generator), seed=stage.seed, area=area)
    generator.next_chunk()  # the first takes several times as long: not in what the line learns of that
    generator.restart(stage.seed)
    line = Line(generator, stage.rig, stage.mount)
    maker = LiveMaker(line)
    maker.start()
    try:
        while maker.playlist.wait_below(round(READY_S * FPS), 0) and not (stopped() or maker.over.is_set()):
            time.sleep(POLL_S)
        if stopped() or maker.over.is_set():
            yield None
        else:
            source = Source(generator.name, generator.digest, stage.seed, generator.licence)
            still = Trajectory(line.rest_pose[None], FPS, stage.rig.name, stage.rig.joint_names(), source=source)
            hello = hello_for(still, stage.rig, report_id(still, stage.rig, line.mount), secrets.randbits(32))
            clock, settings = MonotonicClock(), Settings(FPS, stage.lease_s, generator.name)
            with Publisher(hello, stage.endpoint, keys=keys, insecure=stage.insecure, clock=clock) as publisher:
                service = LiveService(publisher, maker, settings, clock, told)
                yield Live(service, publisher, clock, lambda: 0, line)
    finally:
        maker.wish(None)
        maker.join()
    if maker.error is not None:
        raise maker.error
