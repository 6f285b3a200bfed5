"""The sender's end of a control socket: ask, and hear what becomes of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from types import TracebackType

import msgspec
import zmq

from drivers.control import Answer, answer_in
from drivers.endpoint import DEFAULT, StreamError, endpoints
from drivers.frame import FrameError
from drivers.keys import Keys, require_guarded
from drivers.line import Line
from drivers.messages import MAX_MESSAGE_BYTES, pack
from drivers.sockets import Context, Curve, open_socket

LOOK_UP_MS = 100


class ControlLine:
    """A line to the publisher at `address`; a context manager, used from one thread.

    With `keys` it speaks to the machine named `leader` alone, or the only one that may lead. Raises StreamError where
    the address is no endpoint, or on another machine with neither `keys` nor `insecure`.
    """

    def __init__(
        self, address: str = DEFAULT, *, keys: Keys | None = None, leader: str = "", insecure: bool = False
    ) -> None:
        at = endpoints(address)
        require_guarded(at, keys, insecure)
        curve = None if keys is None else Curve(keys.secret, server=keys.leader(leader))
        self._context: Context = zmq.Context()
        socket = open_socket(
            self._context, zmq.DEALER, at.control, bind=False, max_bytes=MAX_MESSAGE_BYTES, queue=64, curve=curve
        )
        self._line = Line(socket, at.control)

    @property
    def trouble(self) -> str:
        """Why nothing comes, in one line; "" where nothing is known to be wrong."""
        return self._line.trouble

    def ask(self, request: msgspec.Struct) -> None:
        """Send `request`; it waits here until the publisher is there."""
        self._line.socket.send(pack(request))

    def answers(self, ended: Callable[[], bool], silence_s: float) -> Iterator[Answer]:
        """What is answered, until `ended`, asked ten times a second, says so.

        Raises StreamError where nothing at all has come after `silence_s`, and for an answer that makes no sense.
        """
        give_up = time.monotonic() + silence_s
        heard = False
        while not ended():
            self._line.tend(time.monotonic_ns())
            if self._line.socket.poll(LOOK_UP_MS):
                heard = True
                try:
                    yield answer_in(self._line.socket.recv())
                except FrameError as error:
                    raise StreamError(str(error)) from None
            elif not heard and time.monotonic() > give_up:
                raise StreamError(self.trouble or f"nobody answered within {silence_s:g} s: does a service run there?")

    def close(self) -> None:
        """Close the line; what could not be sent is forgotten."""
        self._context.destroy(0)

    def __enter__(self) -> ControlLine:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()
