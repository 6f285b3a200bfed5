"""`rigcast serve`: the live service. The rig is in its idle motion until somebody says what it shall do."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from drivers.endpoint import DEFAULT
from retarget.rig import Mount, load_rig

if TYPE_CHECKING:
    from rigcast.service.making import Made
    from rigcast.service.player import Part
    from rigcast.service.workshop import Workshop

POLL_S = 0.05
IDLE_JOB = -1


def serve(
    endpoint: Annotated[Positional[str], arg(metavar="ENDPOINT")] = DEFAULT,
    /,
    *,
    rig: str = "puppet",
    model: Path | None = None,
    mount: Mount | None = None,
    generator: str = "mdm",
    candidates: int = 1,
    rate: Annotated[float, arg(metavar="HZ")] = 50.0,
    lease: Annotated[float, arg(metavar="SECONDS")] = 10.0,
    metrics: Annotated[int | None, arg(metavar="PORT")] = None,
    insecure: bool = False,
) -> int:
    """Stream the rig's idle motion, and whatever `rigcast send` asks for once it has passed the gate, until Ctrl-C.

    Args:
        endpoint: Where rigs and viewers listen, and senders ask.
        rig: Name of a rig (see `rigcast rigs`) or path of its folder.
        model: The rig's MJCF, where it is not where the rig looks for it.
        mount: How the base is held; by default as the rig says.
        generator: Name of a generator (see `rigcast generators`).
        candidates: Motions drawn at most for a text, of which the one is kept that does what can be measured of it.
        rate: Frames a second on the wire, 1 to 1000.
        lease: How long a sender keeps the rig after its last motion.
        metrics: Port on 127.0.0.1 for Prometheus, 0 for any; none by default.
        insecure: Stream without encryption and obey everybody, where other machines reach the endpoint.
    """
    from drivers.clock import MonotonicClock
    from drivers.endpoint import StreamError, endpoints
    from drivers.keys import keys_for
    from drivers.metrics import MetricsPage, rendered
    from drivers.publisher import MOST_HZ, Publisher, require_free
    from drivers.samples import hello_for
    from drivers.signals import caught_signals
    from rigcast.service.desk import Settings
    from rigcast.service.figures import figures
    from rigcast.service.making import Setup
    from rigcast.service.service import Service, run
    from rigcast.service.workshop import Workshop

    if not 1 <= rate <= MOST_HZ:
        raise StreamError(f"rate {rate:g} Hz; it must be in 1…{MOST_HZ}")
    body = load_rig(rig, model)
    keys = keys_for(endpoints(endpoint), insecure=insecure)
    require_free(endpoint)
    clock = MonotonicClock()
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="rigcast-"))
        where = None if model is None else str(model)
        page: list[str] = [""]
        if metrics is not None:
            port = stack.enter_context(MetricsPage(metrics, lambda: page[0])).port
            print(f"figures at http://127.0.0.1:{port}/metrics", file=sys.stderr, flush=True)
        caught = stack.enter_context(caught_signals())
        cutter = stack.enter_context(closing(Workshop(Setup(rig, folder, where, mount))))
        maker = stack.enter_context(closing(Workshop(Setup(rig, folder, where, mount, generator, candidates))))
        idle = _idle(cutter, maker, rate, caught)
        if idle is None:
            return 0
        hello = hello_for(idle.trajectory, body, idle.report_id, 0)
        publisher = stack.enter_context(Publisher(hello, endpoint, keys=keys, insecure=insecure, clock=clock))
        service = Service(body, publisher, idle, maker, cutter, Settings(rate, lease, generator), clock)
        print(f"{body.name} is idle on {endpoint}; generator {generator}", file=sys.stderr, flush=True)

        def each_second() -> None:
            starts = maker.starts + cutter.starts
            found = figures(service.status(), publisher, service.counts, service.outcomes, starts)
            page[0] = rendered(found)

        run(service, lambda: len(caught), each_second, clock)
    sent = ", ".join(f"{count} {how}" for how, count in service.outcomes.items())
    print(f"{service.counts['frames']} frames, {service.counts['late']} late; prompts: {sent}")
    return 0


def _idle(cutter: Workshop, maker: Workshop, rate: float, caught: Sequence[str]) -> Part | None:
    """The idle motion, once both makers are ready; None where a signal came before.

    Raises RuntimeError where a maker cannot begin, or the gate lets the rig not even stand.
    """
    from rigcast.service.making import Idle
    from rigcast.service.service import idle_part

    for step in (_wait(cutter, caught), _wait(maker, caught)):
        if step is not None and not step.ok:
            raise RuntimeError(step.detail)
    if caught:
        return None
    cutter.ask(Idle(IDLE_JOB))
    made = _wait(cutter, caught)
    return None if made is None else idle_part(made, rate)


def _wait(workshop: Workshop, caught: Sequence[str]) -> Made | None:
    while not caught:
        if (made := workshop.done()) is not None:
            return made
        time.sleep(POLL_S)
    return None
