"""`rigcast relay`: a stream passed on to other networks, or to many receivers."""

from __future__ import annotations

from typing import Annotated

from tyro.conf import Positional, arg

from rigcast import show


def relay(
    source: Annotated[Positional[str], arg(metavar="SOURCE")],
    endpoint: Annotated[Positional[str], arg(metavar="ENDPOINT")],
    /,
    *,
    leader: str = "",
    insecure: bool = False,
) -> int:
    """Pass the stream at SOURCE on at ENDPOINT, and the rigs' states back, until Ctrl-C.

    Args:
        source: Where `say --publish` streams to.
        endpoint: Where rigs and viewers then listen.
        leader: Name of the key that streams at SOURCE (see `rigcast keys`); by default the only one that may lead.
        insecure: Use no keys, though other machines reach SOURCE or ENDPOINT.
    """
    from drivers.endpoint import endpoints
    from drivers.keys import keys_for
    from drivers.relay import relay as run
    from drivers.signals import caught_signals

    keys = keys_for(endpoints(endpoint), insecure=insecure)
    source_keys = keys_for(endpoints(source), insecure=insecure, leader=leader)
    with caught_signals() as caught:
        passed = run(
            source,
            endpoint,
            lambda: bool(caught),
            show.warner(),
            keys=keys,
            source_keys=source_keys,
            leader=leader,
            insecure=insecure,
        )
    print(f"{passed} frames passed on")
    return 0
