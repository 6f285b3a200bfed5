"""Who may connect: the ZAP handler (ZeroMQ RFC 27) of a context, which admits keys by the right that a socket asks for.

The socket that binds names the right as its ZAP domain. Without a doorkeeper, nobody comes in.
"""

from __future__ import annotations

import threading
from collections import Counter

import zmq
from zmq.utils.monitor import recv_monitor_message

from drivers.keys import RIGHTS, Keys
from drivers.sockets import Context, Socket

ANYBODY = "anybody"  # the domain of sockets that every key may come to, whatever it may do
ZAP = "inproc://zeromq.zap.01"
CAME, SHOWED_A_KEY = zmq.Event.ACCEPTED, zmq.Event.HANDSHAKE_SUCCEEDED | zmq.Event.HANDSHAKE_FAILED_AUTH


class Doorkeeper:
    """Admits to each socket of `context` the keys that have its right, from a thread of its own.

    `refused` counts who was not let in: `stranger`, a key that has not the right, and `handshake`, a connection that
    has shown no key: without CURVE, with another key than ours, with bytes that make no sense, or not yet. Close the
    sockets, then end the context.
    """

    def __init__(self, context: Context, keys: Keys) -> None:
        self.refused: Counter[str] = Counter(stranger=0, handshake=0)  # both there: another thread may copy it
        self._allowed = {right.encode(): keys.allowed(right) for right in RIGHTS}
        self._allowed[ANYBODY.encode()] = frozenset(keys.everybody())
        self._zap = context.socket(zmq.REP)
        self._zap.bind(ZAP)
        self._watched: list[Socket] = []

    def watch(self, socket: Socket) -> None:
        """Count those who come to `socket` and show no key too; before `start`."""
        self._watched.append(socket.get_monitor_socket(CAME | SHOWED_A_KEY))

    def start(self) -> None:
        """Begin to answer; until then whoever connects is kept waiting."""
        threading.Thread(target=self._work, name="doorkeeper", daemon=True).start()

    def _work(self) -> None:
        # Monitors are drained here and not where frames are sent: a full one would stop the sockets' own thread.
        poller = zmq.Poller()
        for socket in (self._zap, *self._watched):
            poller.register(socket, zmq.POLLIN)
        try:
            while True:
                for socket, _ in poller.poll():
                    if socket is self._zap:
                        self._answer()
                    else:
                        came = recv_monitor_message(socket)["event"] == CAME
                        self.refused["handshake"] += 1 if came else -1
        except zmq.ContextTerminated:
            pass
        finally:
            for socket in (self._zap, *self._watched):
                socket.close(0)

    def _answer(self) -> None:
        version, request, domain, _address, _identity, mechanism, *credentials = self._zap.recv_multipart()
        known = mechanism == b"CURVE" and credentials[0] in self._allowed.get(domain, ())
        self.refused["stranger"] += not known
        status = (b"200", b"", credentials[0].hex().encode()) if known else (b"400", b"key not allowed", b"")
        self._zap.send_multipart([version, request, *status, b""])
