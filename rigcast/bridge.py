"""`rigcast bridge`: a stream in the forms that others read: lines of JSON, messages for GEAR-SONIC, bones as VMC."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from tyro.conf import Positional, arg

from drivers.endpoint import DEFAULT, StreamError
from retarget.rig import Rig, load_rig
from rigcast import show

if TYPE_CHECKING:
    from drivers.bus import Array
    from drivers.clock import Ticker
    from drivers.receiver import Receiver
    from drivers.sockets import Socket

NS = 1_000_000_000
RATE_HZ = 50.0


@dataclass(frozen=True)
class Moment:
    """What the rig should do now: `pos`, `vel` (nj,) rad and rad/s, `root` (7,) m and w x y z."""

    index: int
    seq: int
    report_id: str
    pos: Array
    vel: Array
    root: Array


def bridge(
    endpoint: Annotated[Positional[str], arg(metavar="ENDPOINT")] = DEFAULT,
    /,
    *,
    rig: str = "puppet",
    model: Path | None = None,
    lines: bool = False,
    sonic: Annotated[str | None, arg(metavar="ADDRESS")] = None,
    vmc: Annotated[str | None, arg(metavar="HOST:PORT")] = None,
    leader: str = "",
    insecure: bool = False,
) -> int:
    """Tell others what a rig on ENDPOINT should do now, 50 times a second, until Ctrl-C.

    Like a rig it follows checked frames alone, and says nothing while there are none. The forms of others know neither
    keys nor a stop: who receives them has to look after that.

    Args:
        endpoint: Where `say --publish` or `serve` streams to.
        rig: Name of the rig that is streamed, or path of its folder.
        model: The rig's MJCF, where it is not where the rig looks for it.
        lines: A line of JSON each on stdout: index, seq, report_id, root (m, quaternion w x y z), joints (rad) by name.
        sonic: Messages of GEAR-SONIC, version 1, published on this address, such as tcp://127.0.0.1:5566.
        vmc: A person's bones by the Virtual Motion Capture protocol to this address, such as 127.0.0.1:39539.
        leader: Name of the key that is followed (see `rigcast keys`); by default the only one that may lead.
        insecure: Use no keys, though other machines reach ENDPOINT or ADDRESS.
    """
    from drivers.clock import MonotonicClock
    from drivers.endpoint import endpoints
    from drivers.keys import keys_for
    from drivers.receiver import Receiver
    from drivers.signals import caught_signals

    if not lines and sonic is None and vmc is None:
        raise StreamError("bridge to whom? say --lines, --sonic ADDRESS or --vmc HOST:PORT")
    body = load_rig(rig, model)
    keys = keys_for(endpoints(endpoint), insecure=insecure, leader=leader)
    with ExitStack() as stack:
        outs: list[Callable[[Moment], None]] = []
        if lines:
            outs.append(lambda moment: print(json.dumps(line(moment, body)), flush=True))
        if sonic is not None:
            outs.append(_sonic(stack, sonic, body, insecure))
        if vmc is not None:
            outs.append(_vmc(stack, vmc, body))
        receiver = stack.enter_context(
            Receiver(endpoint, rig_hash=body.hash, rig=body.name, keys=keys, leader=leader, insecure=insecure)
        )
        caught = stack.enter_context(caught_signals())
        told = run(receiver, outs, lambda: bool(caught), MonotonicClock())
    show.warn(f"{told} moments told")
    return 0 if told else 1


def run(receiver: Receiver, outs: list[Callable[[Moment], None]], ended: Callable[[], bool], clock: Ticker) -> int:
    """Tell `outs` each moment that there is something to follow, until `ended` says so; how many there were."""
    index, frame, next_ns = 0, None, clock.now_ns()
    tell_trouble = show.warner()
    while not ended():
        clock.sleep_until_ns(next_ns)
        now = clock.now_ns()
        next_ns = max(next_ns + round(NS / RATE_HZ), now)
        frame = receiver.poll(now) or frame
        tell_trouble(receiver.trouble)
        if frame is None or receiver.watchdog.mode != "following":
            continue
        target = receiver.buffer.target_at(receiver.gate.sender_ns(now))
        moment = Moment(
            index, frame.seq, frame.report_id, target, frame.vel[0].astype(float), frame.root[0].astype(float)
        )
        for out in outs:
            out(moment)
        index += 1
    return index


def line(moment: Moment, rig: Rig) -> dict[str, Any]:
    """`moment` as plain data."""
    joints = dict(zip(rig.joint_names(), np.round(moment.pos, 6).tolist(), strict=True))
    root = np.round(moment.root, 6).tolist()
    return {"index": moment.index, "seq": moment.seq, "report_id": moment.report_id, "root": root, "joints": joints}


def _sonic(stack: ExitStack, address: str, rig: Rig, insecure: bool) -> Callable[[Moment], None]:
    """Publishes on `address`. Raises StreamError for another rig than G1, and where other machines reach it."""
    import zmq

    from drivers.endpoint import endpoints
    from drivers.keys import require_guarded
    from drivers.messages import MAX_MESSAGE_BYTES
    from drivers.sockets import open_socket
    from drivers.sonic import require_g1, sonic_message

    require_g1(rig)
    require_guarded(endpoints(address), None, insecure)
    context = stack.enter_context(zmq.Context())
    socket: Socket = stack.enter_context(open_socket(context, zmq.PUB, address, bind=True, max_bytes=MAX_MESSAGE_BYTES))

    def tell(moment: Moment) -> None:
        socket.send(sonic_message(moment.index, moment.pos[None], moment.vel[None], moment.root[None, 3:]))

    return tell


def _vmc(stack: ExitStack, address: str, rig: Rig) -> Callable[[Moment], None]:
    """Sends datagrams to `address`. Raises StreamError where it is none, RigError where the model cannot be had."""
    import socket

    from drivers.vmc import datagrams
    from retarget.as_human import as_human, body_of

    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise StreamError(f"address {address!r}: give HOST:PORT, such as 127.0.0.1:39539")
    body = body_of(rig)
    mouth = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    try:
        mouth.connect((host, int(port)))
    except OSError as error:
        raise StreamError(f"address {address!r}: {error.strerror}") from None

    def tell(moment: Moment) -> None:
        person = as_human(body, np.concatenate([moment.root, moment.pos])[None], RATE_HZ)
        for data in datagrams(person, 0, moment.index / RATE_HZ):
            with suppress(OSError):  # nobody listens there yet
                mouth.send(data)

    return tell
