"""ZeroMQ sockets with every option set before bind or connect: one that already is bound ignores them.

The library's defaults are unsafe here: queues of 1000 messages, messages of any size, no heartbeat.
"""

from __future__ import annotations

import socket as plain_socket
from dataclasses import dataclass

import zmq
from zmq.utils import z85

from drivers.endpoint import StreamError

Context = zmq.Context[zmq.Socket[bytes]]
Socket = zmq.Socket[bytes]

HELLO_QUEUE = 64  # The hello socket carries what several rigs told, which comes in bursts.
BUSY = "{} is busy: something else publishes there; choose another endpoint"
LINGER_MS = 200  # Long enough for the last frame, or a stop, to leave before the process does.
HANDSHAKE_MS = 5000


@dataclass(frozen=True)
class Curve:
    """CURVE (ZeroMQ RFC 26) on a socket. `secret` is our own key, 32 bytes.

    A socket that binds admits the keys that have `right`; one that connects expects the owner of `server`, 32 bytes.
    """

    secret: bytes
    right: str = ""
    server: bytes = b""


def open_socket(
    context: Context,
    kind: int,
    address: str,
    *,
    bind: bool,
    max_bytes: int,
    newest: bool = False,
    queue: int = 2,
    curve: Curve | None = None,
) -> Socket:
    """A socket of `kind` on `address`, bounded in messages that wait, message size and silence.

    `newest` keeps one message only, else `queue` wait in each direction. Without `curve` nothing is encrypted.
    Raises StreamError where the address is in use or cannot be bound or reached.
    """
    if bind and address.startswith("ipc://") and hasattr(plain_socket, "AF_UNIX"):
        _require_nobody(address)
    socket = context.socket(kind)
    socket.setsockopt(zmq.LINGER, LINGER_MS)
    socket.setsockopt(zmq.MAXMSGSIZE, max_bytes)
    socket.setsockopt(zmq.HEARTBEAT_IVL, 1000)
    socket.setsockopt(zmq.HEARTBEAT_TIMEOUT, 3000)
    socket.setsockopt(zmq.RECONNECT_IVL, 50)
    socket.setsockopt(zmq.RECONNECT_IVL_MAX, 500)
    socket.setsockopt(zmq.HANDSHAKE_IVL, HANDSHAKE_MS)
    socket.setsockopt(zmq.SNDHWM, queue)
    socket.setsockopt(zmq.RCVHWM, queue)
    if newest:
        socket.setsockopt(zmq.CONFLATE, 1)
    if kind == zmq.SUB:
        socket.setsockopt(zmq.SUBSCRIBE, b"")
    if curve is not None:
        _secure(socket, curve)
    try:
        if bind:
            socket.bind(address)
        else:
            socket.connect(address)
    except zmq.ZMQError as error:
        socket.close(0)
        if error.errno == zmq.EADDRINUSE:
            raise StreamError(BUSY.format(address)) from None
        raise StreamError(f"cannot {'bind' if bind else 'connect to'} {address}: {error.strerror}") from None
    return socket


def _require_nobody(address: str) -> None:
    """Raise StreamError where somebody listens on an ipc path: binding it would take it away without a word."""
    with plain_socket.socket(plain_socket.AF_UNIX) as probe:
        try:
            probe.connect(address.removeprefix("ipc://"))
        except OSError:
            return
    raise StreamError(BUSY.format(address))


def _secure(socket: Socket, curve: Curve) -> None:
    secret = z85.encode(curve.secret)
    socket.setsockopt(zmq.CURVE_SECRETKEY, secret)
    socket.setsockopt(zmq.CURVE_PUBLICKEY, zmq.curve_public(secret))
    if curve.server:
        socket.setsockopt(zmq.CURVE_SERVERKEY, curve.server)
    else:
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # or else, without a doorkeeper, everybody may come in
        socket.setsockopt(zmq.ZAP_DOMAIN, curve.right.encode())
