"""ZeroMQ sockets with every option set before bind or connect: one that already is bound ignores them.

The library's defaults are unsafe here: queues of 1000 messages, messages of any size, no heartbeat.
"""

from __future__ import annotations

import zmq

from drivers.endpoint import StreamError

Context = zmq.Context[zmq.Socket[bytes]]
Socket = zmq.Socket[bytes]

LINGER_MS = 200  # Long enough for the last frame, or a stop, to leave before the process does.


def open_socket(
    context: Context, kind: int, address: str, *, bind: bool, max_bytes: int, newest: bool = False
) -> Socket:
    """A socket of `kind` on `address`, bounded in queue, message size and silence; `newest` keeps one message only.

    Raises StreamError where the address is in use or cannot be bound or reached.
    """
    socket = context.socket(kind)
    socket.setsockopt(zmq.LINGER, LINGER_MS)
    socket.setsockopt(zmq.MAXMSGSIZE, max_bytes)
    socket.setsockopt(zmq.HEARTBEAT_IVL, 1000)
    socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, 3000)
    socket.setsockopt(zmq.RECONNECT_IVL, 50)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
    socket.setsockopt(zmq.SNDHWM, 2)
    socket.setsockopt(zmq.RCVHWM, 2)
    if newest:
        socket.setsockopt(zmq.CONFLATE, 1)
    if kind == zmq.SUB:
        socket.setsockopt(zmq.SUBSCRIBE, b"")
    try:
        if bind:
            socket.bind(address)
        else:
            socket.connect(address)
    except zmq.ZMQError as error:
        socket.close(0)
        if error.errno == zmq.EADDRINUSE:
            raise StreamError(f"{address} is busy: something else publishes there; choose another endpoint") from None
        raise StreamError(f"cannot {'bind' if bind else 'connect to'} {address}: {error.strerror}") from None
    return socket
