"""A stream passed on, byte for byte: to other networks, or to more receivers than one machine can serve."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

import zmq

from drivers.control import Told, request_in
from drivers.endpoint import endpoints
from drivers.frame import MAX_BYTES, FrameError
from drivers.keys import Keys, require_guarded
from drivers.line import Line
from drivers.messages import MAX_MESSAGE_BYTES, Hello, Stop, news_in, pack
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

    A stop that is said at `address` stops the rigs there and goes on to `source`; prompts are for `source` alone. Of
    frames the newest is passed on where it cannot keep up. `keys` guard `address`; `source_keys` and `leader` are
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
        stop, state, control = dial(zmq.SUB, at.stop), dial(zmq.PUB, at.state), dial(zmq.DEALER, at.control)
        ways: dict[Socket, Socket] = {
            frames.socket: outlet.frames,
            hello.socket: outlet.hello,
            stop.socket: outlet.stop,
            outlet.state: state.socket,
            outlet.control: control.socket,
        }
        poller = zmq.Poller()
        for way in ways:
            poller.register(way, zmq.POLLIN)
        return _pass_on(poller, ways, (frames, hello, stop, state, control), outlet, ended, trouble)
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
            data = _stop_in(outlet) if socket is outlet.control else socket.recv()
            if data is None:
                continue
            passed += ways[socket] is outlet.frames
            if ways[socket] is outlet.stop or (ways[socket] is outlet.hello and _is_hello(data)):
                last[ways[socket]] = data
            if socket is outlet.control:
                last[outlet.stop] = data
                outlet.stop.send(data, zmq.NOBLOCK)
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


def _is_hello(data: bytes) -> bool:
    with contextlib.suppress(FrameError):
        return isinstance(news_in(data), Hello)
    return False


def _stop_in(outlet: Outlet) -> bytes | None:
    """The stop that was said at our end; None for anything else, which is answered."""
    key, *parts = outlet.control.recv_multipart()
    try:
        request = request_in(parts[-1])
    except FrameError:
        return None
    if isinstance(request, Stop):
        answer = Told("", "stopped", request.reason)
    else:
        answer = Told(request.id, "refused", "a relay passes a stop on and nothing else: ask the publisher itself")
    with contextlib.suppress(zmq.Again):
        outlet.control.send_multipart([key, pack(answer)], zmq.NOBLOCK)
    return parts[-1] if isinstance(request, Stop) else None
