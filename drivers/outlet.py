"""The five sockets that a stream is sent from, and who may connect to them."""

from __future__ import annotations

import contextlib
from collections import Counter

import zmq

from drivers.doorkeeper import ANYBODY, Doorkeeper
from drivers.endpoint import Endpoints, endpoints
from drivers.keys import Keys, require_guarded
from drivers.messages import MAX_MESSAGE_BYTES
from drivers.sockets import HELLO_QUEUE, LINGER_MS, Context, Curve, Socket, open_socket

MOST_AT_ONCE = 64  # A flooded socket may not keep the next frame waiting.
CONTROL_QUEUE = 64
SUBSCRIBED = b"\x01"  # What an XPUB hands over when somebody asks for everything.


class Outlet:
    """Binds `frames`, `hello` and `stop` to send on, `state` to hear the rigs and `control` to be told what to do; for
    use from one thread.

    With `keys` all is encrypted, keys that may follow receive, keys that may control send states, and every key that
    is known may speak on `control`. Raises StreamError where the address is busy, or open to other machines with
    neither `keys` nor `insecure`.
    """

    def __init__(self, address: str, keys: Keys | None, insecure: bool) -> None:
        at = endpoints(address)
        require_guarded(at, keys, insecure)
        self._context: Context = zmq.Context()
        self._names = {} if keys is None else {key.hex(): name for key, name in keys.everybody().items()}
        self._sayers = None if keys is None else {key.hex() for key in keys.allowed("say")}
        self._doorkeeper = None if keys is None else Doorkeeper(self._context, keys)
        self._sockets: list[Socket] = []
        self._heard = False
        try:
            self._open(at, keys)
        except BaseException:
            self.close(0)
            raise

    @property
    def refused(self) -> Counter[str]:
        """Connections that were not let in: `stranger` and `handshake`; none are counted without keys."""
        return Counter() if self._doorkeeper is None else Counter(self._doorkeeper.refused)

    def wait_for_subscriber(self, timeout_s: float) -> bool:
        """Wait until somebody has subscribed to the frames; False where nobody has after `timeout_s`."""
        if not self._heard and self.frames.poll(int(timeout_s * 1000)):
            self._heard = self.frames.recv() == SUBSCRIBED
        return self._heard

    def somebody_came(self) -> bool:
        """Whether somebody has subscribed to the hello since the last call."""
        events = _drained(self.hello)
        if events:  # They come and go on both, and what is not read piles up.
            self._heard |= SUBSCRIBED in _drained(self.frames)
        return SUBSCRIBED in events

    def sender(self, message: zmq.Frame) -> str:
        """Whose key a message on `state` or `control` came with, by name; "" without keys."""
        return "" if self._doorkeeper is None else self._names[str(message.get("User-Id"))]

    def may_say(self, message: zmq.Frame) -> bool:
        """Whether who sent a message on `control` may say what the rig shall do."""
        return self._sayers is None or message.get("User-Id") in self._sayers

    def close(self, linger_ms: int = LINGER_MS) -> None:
        """Let the last messages leave, for at most `linger_ms`, and close all sockets."""
        for socket in self._sockets:
            socket.close(linger_ms)
        self._context.term()

    def _open(self, at: Endpoints, keys: Keys | None) -> None:
        try:
            # XPUB is PUB that also hands over the subscriptions, so that the first frame can wait for one, and whoever
            # comes is greeted at once.
            self.frames = self._bind(zmq.XPUB, at.frames, keys, "follow")
            self.hello = self._bind(zmq.XPUB, at.hello, keys, "follow", HELLO_QUEUE)
            self.hello.setsockopt(zmq.XPUB_VERBOSE, 1)
            self.stop = self._bind(zmq.PUB, at.stop, keys, "follow")
            self.state = self._bind(zmq.SUB, at.state, keys, "control")
            self.control = self._bind(zmq.ROUTER, at.control, keys, ANYBODY, CONTROL_QUEUE)
        finally:
            if self._doorkeeper is not None:
                self._doorkeeper.start()

    def _bind(self, kind: int, address: str, keys: Keys | None, domain: str, queue: int = 2) -> Socket:
        curve = None if keys is None else Curve(keys.secret, domain)
        most = MAX_MESSAGE_BYTES
        socket = open_socket(self._context, kind, address, bind=True, max_bytes=most, queue=queue, curve=curve)
        self._sockets.append(socket)
        if self._doorkeeper is not None:
            self._doorkeeper.watch(socket)
        return socket


def _drained(socket: Socket) -> list[bytes]:
    events: list[bytes] = []
    with contextlib.suppress(zmq.Again):
        while len(events) < MOST_AT_ONCE:
            events.append(socket.recv(zmq.NOBLOCK))
    return events
