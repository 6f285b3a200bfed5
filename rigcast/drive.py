"""`rigcast drive`: put what is on the wire on a servo bus. Only frames of a passed report move anything."""

from __future__ import annotations

import sys
from typing import Annotated

from tyro.conf import arg

from drivers.endpoint import DEFAULT
from retarget.rig import load_rig
from rigcast import driving, show


def drive(
    *,
    port: Annotated[str, arg(metavar="PORT")],
    rig: str = "puppet",
    endpoint: Annotated[str, arg(metavar="ENDPOINT")] = DEFAULT,
    buffer: Annotated[float, arg(metavar="SECONDS")] = 0.0,
    leader: str = "",
    insecure: bool = False,
    how: Annotated[driving.Driving, arg(name="")] = driving.Driving(),  # noqa: B008
    json: bool = False,
) -> int:
    """Follow the stream on ENDPOINT with the servos on PORT until it ends, any key or a stop; then torque is off.

    Exit 1 where nothing was followed or a servo tripped.

    Args:
        port: Serial port of the servo bus, such as /dev/ttyUSB0, or "sim" for servos that are only computed.
        rig: Name of the rig that is on the bus, or path of its folder.
        endpoint: Where `say --publish` streams to.
        buffer: Follow so much later, 0 to 0.3 s, for links on which frames come unevenly or are lost.
        leader: Name of the key that the rig follows (see `rigcast keys`); by default the only one that may lead.
        insecure: Follow a stream of another machine without keys: whoever is in that network can move the rig.
        json: Print one JSON document instead of a table.
    """
    from drivers.endpoint import endpoints
    from drivers.keys import keys_for
    from drivers.receiver import Receiver

    body = load_rig(rig)
    driving.require_port(port)
    keys = keys_for(endpoints(endpoint), insecure=insecure, leader=leader)
    with Receiver(
        endpoint, rig_hash=body.hash, rig=body.name, buffer_s=buffer, keys=keys, leader=leader, insecure=insecure
    ) as receiver:
        print(f"{rig} on {port} listens on {endpoint}", file=sys.stderr, flush=True)
        driven = driving.run(body, port, receiver, how, lambda: receiver.trouble)
    if json:
        show.print_json(driving.driven_dict(driven))
    else:
        driving.print_driven(driven)
    return driving.exit_code(driven)
