"""Everything that comes on the wire, in order, as it comes: for recordings."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import zmq

from drivers.endpoint import endpoints
from drivers.frame import MAX_BYTES
from drivers.keys import Keys, require_guarded
from drivers.line import Line
from drivers.messages import MAX_MESSAGE_BYTES
from drivers.recording import Channel, Record
from drivers.sockets import Context, Curve, open_socket

QUEUE = 1000  # Five seconds of frames at 200 Hz: a slow disk loses none.
LOOK_UP_MS = 100


def listen(
    address: str,
    ended: Callable[[], bool],
    trouble: Callable[[str], None],
    *,
    keys: Keys | None = None,
    leader: str = "",
    insecure: bool = False,
) -> Iterator[Record]:
    """What the publisher at `address` sends, until `ended` (asked ten times a second) says so.

    `trouble` is told why nothing comes, "" where it does. The rest is the Receiver's. Raises StreamError as it does.
    """
    at = endpoints(address)
    require_guarded(at, keys, insecure)
    curve = None if keys is None else Curve(keys.secret, server=keys.leader(leader))
    context: Context = zmq.Context()
    try:
        lines: dict[Channel, Line] = {}
        poller = zmq.Poller()
        for channel, where in ((Channel.FRAMES, at.frames), (Channel.HELLO, at.hello), (Channel.STOP, at.stop)):
            most = MAX_BYTES if channel == Channel.FRAMES else MAX_MESSAGE_BYTES
            socket = open_socket(context, zmq.SUB, where, bind=False, max_bytes=most, queue=QUEUE, curve=curve)
            lines[channel] = Line(socket, where)
            poller.register(socket, zmq.POLLIN)
        channels = {line.socket: channel for channel, line in lines.items()}
        tend_ns = 0
        while not ended():
            for socket, _ in poller.poll(LOOK_UP_MS):
                yield Record(channels[socket], time.monotonic_ns(), socket.recv())
            if (now := time.monotonic_ns()) > tend_ns:
                tend_ns = now + LOOK_UP_MS * 1_000_000
                for line in lines.values():
                    line.tend(now)
                trouble(lines[Channel.FRAMES].trouble)
    finally:
        context.destroy(0)
