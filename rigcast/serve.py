"""`rigcast serve`: the live service. The rig is in its idle motion until somebody says what it shall do."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from drivers.endpoint import DEFAULT, StreamError
from motiongen.generator import is_live
from retarget.rig import Mount, load_rig

if TYPE_CHECKING:
    from drivers.control import Told
    from rigcast.service.running import Opened

LIVE_HZ = 50.0


def serve(
    endpoint: Annotated[Positional[str], arg(metavar="ENDPOINT")] = DEFAULT,
    /,
    *,
    rig: str = "puppet",
    model: Path | None = None,
    mount: Mount | None = None,
    generator: str | None = None,
    candidates: int = 1,
    seed: int = 0,
    floor: Annotated[float | None, arg(metavar="METRES")] = None,
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
        generator: Name of a generator (see `rigcast generators`) or file of its weights; by default live, which answers
            at once, for a rig on a stand, and mdm for others.
        candidates: Motions drawn at most for a text, of which the one is kept that does what can be measured of it.
        seed: With live, what it draws.
        floor: With live, how far from where it begins it may walk in each direction, in metres.
        rate: Frames a second on the wire, 1 to 1000.
        lease: How long a sender keeps the rig after its last motion.
        metrics: Port on 127.0.0.1 for Prometheus, 0 for any; none by default.
        insecure: Stream without encryption and obey everybody, where other machines reach the endpoint.
    """
    from drivers.metrics import MetricsPage, rendered
    from drivers.publisher import MOST_HZ
    from drivers.signals import caught_signals
    from rigcast.service.figures import figures
    from rigcast.service.running import run

    if not 1 <= rate <= MOST_HZ:
        raise StreamError(f"rate {rate:g} Hz; it must be in 1…{MOST_HZ}")
    body = load_rig(rig, model)
    name = generator or ("live" if (mount or body.mount) == "stand" else "mdm")
    live = is_live(name)
    if live and (rate != LIVE_HZ or candidates != 1):
        raise StreamError(f"{name} streams at {LIVE_HZ:g} Hz and draws once; leave --rate and --candidates out")
    if not live and (seed or floor is not None):
        raise StreamError(f"--seed and --floor are for live motion; with {name}, `rigcast send` tells the seed")
    with ExitStack() as stack:
        page: list[str] = [""]
        if metrics is not None:
            port = stack.enter_context(MetricsPage(metrics, lambda: page[0])).port
            print(f"figures at http://127.0.0.1:{port}/metrics", file=sys.stderr, flush=True)
        caught = stack.enter_context(caught_signals())
        if live:
            from rigcast.live import Stage, opened

            stage = Stage(body, mount, name, seed, floor, endpoint, insecure, lease)
            found: Opened | None = stack.enter_context(opened(stage, lambda: bool(caught), _tell))
        else:
            from rigcast.clips import opened as open_clips
            from rigcast.service.desk import Settings
            from rigcast.service.making import Setup

            setup = Setup(rig, "", None if model is None else str(model), mount, name, candidates)
            settings = Settings(rate, lease, name)
            found = stack.enter_context(open_clips(body, setup, settings, endpoint, insecure, lambda: bool(caught)))
        if found is None:
            return 0
        service = found.service
        print(f"{body.name} is idle on {endpoint}; generator {name}", file=sys.stderr, flush=True)

        def each_second() -> None:
            page[0] = rendered(
                figures(service.status(), found.publisher, service.counts, service.outcomes, found.starts())
            )

        run(service, lambda: len(caught), each_second, found.clock)
    sent = ", ".join(f"{count} {how}" for how, count in service.outcomes.items())
    print(f"{service.counts['frames']} frames, {service.counts['late']} late; prompts: {sent}")
    return 0


def _tell(said: Told) -> None:
    """What happened that nobody asked for."""
    print(said.detail, file=sys.stderr, flush=True)
