"""A stream passed on, byte for byte: to other networks, or to more receivers than one machine can serve."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

import zmq

from drivers.endpoint import endpoints
from drivers.frame import MAX_BYTES
from drivers.keys import Keys, require_guarded
from drivers.line import Line
from drivers.messages import MAX_MESSAGE_BYTES
from drivers.outlet import Outlet
from drivers.sockets import Context, Curve, Socket, open_socket

LOOK_UP_MS = 100


def relay(
    source: str,
    address: str,
    ended: Callable[[], bool],
    trouble: Callable[[str], None],
    *,
    keys: Keys | None = None,
    leader: str = "",
    source_keys: Keys | None = None,
    insecure: bool = False,
) -> int:
    """Pass the stream at `source` on at `address`, and rigs' states back, until `ended` says so; the frames passed.

    Of frames the newest is passed on where it cannot keep up. `keys` guard `address`; `source_keys` and `leader` are
    for `source`, of which `trouble` is told as by `listen`. Raises StreamError as Outlet and Receiver do.
    """
    at = endpoints(source)
    require_guarded(at, source_keys, insecure)
    curve = None if source_keys is None else Curve(source_keys.secret, server=source_keys.leader(leader))
    outlet = Outlet(address, keys, insecure)
    context: Context = zmq.Context()

    def dial(kind: int, where: str, *, newest: bool = False) -> Line:
        most = MAX_BYTES if newest else MAX_MESSAGE_BYTES
        return Line(open_socket(context, kind, where, bind=False, max_bytes=most, newest=newest, curve=curve), where)

    try:
        frames, hello = dial(zmq.SUB, at.frames, newest=True), dial(zmq.SUB, at.hello)
        stop, state = dial(zmq.SUB, at.stop), dial(zmq.PUB, at.state)
        ways: dict[Socket, Socket] = {
            frames.socket: outlet.frames,
            hello.socket: outlet.hello,
            stop.socket: outlet.stop,
            outlet.state: state.socket,
        }
        poller = zmq.Poller()
        for way in ways:
            poller.register(way, zmq.POLLIN)
        return _pass_on(poller, ways, (frames, hello, stop, state), outlet, ended, trouble)
    finally:
        outlet.close()
        context.destroy(0)


def _pass_on(
    poller: zmq.Poller,
    ways: dict[Socket, Socket],
    lines: tuple[Line, ...],
    outlet: Outlet,
    ended: Callable[[], bool],
    trouble: Callable[[str], None],
) -> int:
    passed, tend_ns = 0, 0
    last: dict[Socket, bytes] = {}  # What who joins later must know: the hello, and a stop that was said.
    while not ended():
        for socket, _ in poller.poll(LOOK_UP_MS):
            data = socket.recv()
            passed += ways[socket] is outlet.frames
            if ways[socket] in (outlet.hello, outlet.stop):
                last[ways[socket]] = data
            with contextlib.suppress(zmq.Again):
                ways[socket].send(data, zmq.NOBLOCK)
        if outlet.somebody_came():
            for out, data in last.items():
                with contextlib.suppress(zmq.Again):
                    out.send(data, zmq.NOBLOCK)
        if (now := time.monotonic_ns()) > tend_ns:
            tend_ns = now + LOOK_UP_MS * 1_000_000
            for line in lines:
                line.tend(now)
            trouble(lines[0].trouble)
    return passed
