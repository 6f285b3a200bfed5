"""A socket that connects and stays connected: it dials again where libzmq gives up, and says why nothing comes.

libzmq by itself comes back to a publisher that was gone, but never to one that refused its key or whose bytes, once,
made no sense: the key may be allowed by now, and the bytes were damaged on the way.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import zmq
from zmq.utils.monitor import recv_monitor_message

from drivers.sockets import Socket

REDIAL_NS = 500_000_000

_DIALLING = zmq.Event.CONNECTED | zmq.Event.CONNECT_DELAYED | zmq.Event.CONNECT_RETRIED | zmq.Event.HANDSHAKE_SUCCEEDED
_FAILED = zmq.Event.HANDSHAKE_FAILED_AUTH | zmq.Event.HANDSHAKE_FAILED_PROTOCOL | zmq.Event.HANDSHAKE_FAILED_NO_DETAIL
_MISMATCH = zmq.Event.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH


class Line:
    """The `socket` that connects to `address`. `trouble` says why it is not connected, where the other end told."""

    def __init__(self, socket: Socket, address: str) -> None:
        self.socket = socket
        self.trouble = ""
        self._address = address
        self._gone_ns: int | None = None
        self._events = socket.get_monitor_socket(_DIALLING | _FAILED | zmq.Event.DISCONNECTED)

    def tend(self, now_ns: int) -> None:
        """Read what has happened to the connection by `now_ns`, and dial again where libzmq no longer does."""
        with contextlib.suppress(zmq.Again):
            while True:
                self._note(recv_monitor_message(self._events, zmq.NOBLOCK), now_ns)
        if self._gone_ns is not None and now_ns - self._gone_ns > REDIAL_NS:
            self._gone_ns = None
            self.socket.disconnect(self._address)
            self.socket.connect(self._address)

    def _note(self, event: Mapping[str, Any], now_ns: int) -> None:
        kind = event["event"]
        self._gone_ns = None if kind & _DIALLING else now_ns
        if kind == zmq.Event.HANDSHAKE_SUCCEEDED:
            self.trouble = ""
        elif kind == zmq.Event.HANDSHAKE_FAILED_AUTH:
            self.trouble = f"{self._address} does not allow this machine's key"
        elif kind == zmq.Event.HANDSHAKE_FAILED_PROTOCOL and event["value"] == _MISMATCH:
            self.trouble = f"{self._address}: one end uses keys and the other does not"
        elif kind & _FAILED:
            self.trouble = f"{self._address} ended the handshake: its key is not the leader's, or it is no stream"
