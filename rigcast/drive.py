"""`rigcast drive`: put what is on the wire on a servo bus. Only frames of a passed report move anything."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import numpy as np
from tyro.conf import arg

from drivers.endpoint import DEFAULT
from retarget.rig import Rig, load_rig
from rigcast import show

if TYPE_CHECKING:
    from drivers.bus import ServoBus
    from drivers.drive import Driven
    from drivers.messages import RigState
    from drivers.receiver import Receiver

SIMULATED = "sim"


def drive(
    *,
    port: Annotated[str, arg(metavar="PORT")],
    rig: str = "puppet",
    endpoint: Annotated[str, arg(metavar="ENDPOINT")] = DEFAULT,
    buffer: Annotated[float, arg(metavar="SECONDS")] = 0.0,
    leader: str = "",
    insecure: bool = False,
    json: bool = False,
) -> int:
    """Follow the stream on ENDPOINT with the servos on PORT until it ends, Ctrl-C or a stop; then torque is off.

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
    from drivers.drive import drive as run
    from drivers.endpoint import endpoints
    from drivers.keys import keys_for
    from drivers.receiver import Receiver

    body = load_rig(rig)
    keys = keys_for(endpoints(endpoint), insecure=insecure, leader=leader)
    with Receiver(
        endpoint, rig_hash=body.hash, buffer_s=buffer, keys=keys, leader=leader, insecure=insecure
    ) as receiver:
        print(f"{rig} on {port} listens on {endpoint}", file=sys.stderr, flush=True)
        driven = run(body, receiver, bus_on(port, body), watch=_teller(receiver))
    if json:
        show.print_json({**asdict(driven), "rms_error": driven.rms_error.tolist()})
    else:
        _print(driven)
    return 0 if driven.followed and driven.mode != "tripped" else 1


def bus_on(port: str, rig: Rig) -> ServoBus:
    """The servo bus of `rig` on `port`, not yet opened; `sim` is in process. Raises BusError."""
    if port == SIMULATED:
        from drivers.simulated import SimulatedBus

        return SimulatedBus(rig)
    from drivers.servos.connect import connect

    return connect(rig, port, guarded=True)


def _teller(receiver: Receiver) -> Callable[[RigState], None]:
    """Says each change of mode on stderr, and why no stream comes."""
    told = ""
    tell_trouble = show.warner()

    def tell(state: RigState) -> None:
        nonlocal told
        now = f"{state.mode}: {state.reason}" if state.reason else state.mode
        if now != told:
            print(now, file=sys.stderr, flush=True)
        told = now
        tell_trouble(receiver.trouble)

    return tell


def _print(driven: Driven) -> None:
    table = show.new_table("joint", "rms error (rad)", title=f"{driven.mode}: {driven.reason}")
    for joint, error in zip(driven.joints, driven.rms_error, strict=True):
        table.add_row(joint, f"{error:.4f}")
    console = show.console()
    console.print(table)
    rms = float(np.sqrt(np.mean(driven.rms_error**2)))
    refused = ", ".join(f"{count} {why}" for why, count in driven.refused.items() if count) or "none"
    print(
        f"{driven.followed} of {driven.cycles} cycles followed, rms {rms:.4f} rad, {driven.held_back} held back by a "
        f"limit, {driven.late} late; {driven.accepted} frames taken, {driven.gaps} missed, refused: {refused}"
    )
