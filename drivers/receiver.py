"""The receiving end of a stream: newest frame only, stop and hello, and the rig's state on the way back."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from types import TracebackType

import zmq

from drivers.endpoint import DEFAULT, endpoints
from drivers.frame import MAX_BYTES, Frame, FrameError
from drivers.gate import Gate
from drivers.messages import MAX_MESSAGE_BYTES, Hello, Message, RigState, Stop, pack, unpack
from drivers.sockets import LINGER_MS, Context, Socket, open_socket
from drivers.watchdog import Patience, Watchdog

MOST_AT_ONCE = 8  # A flooded socket may not keep a control loop busy.


class Receiver:
    """Receives a stream for the rig with `rig_hash`; a context manager, used from one thread.

    `gate` counts what was refused, `watchdog` knows the mode; `preview` is for what only draws (see `Gate`).
    Raises StreamError where the address is no endpoint.
    """

    def __init__(
        self, address: str = DEFAULT, *, rig_hash: int, preview: bool = False, patience: Patience | None = None
    ) -> None:
        patience = patience or Patience()
        self.gate = Gate(rig_hash, preview=preview, max_age_s=patience.hold_s)
        self.watchdog = Watchdog(patience)
        self.hello: Hello | None = None
        at = endpoints(address)
        self._context: Context = zmq.Context()
        try:
            self._frames = open_socket(self._context, zmq.SUB, at.frames, bind=False, max_bytes=MAX_BYTES, newest=True)
            self._hello = open_socket(self._context, zmq.SUB, at.hello, bind=False, max_bytes=MAX_MESSAGE_BYTES)
            self._stop = open_socket(self._context, zmq.SUB, at.stop, bind=False, max_bytes=MAX_MESSAGE_BYTES)
            self._state = open_socket(self._context, zmq.PUB, at.state, bind=False, max_bytes=MAX_MESSAGE_BYTES)
        except BaseException:
            self._context.destroy(0)
            raise

    def poll(self, now_ns: int) -> Frame | None:
        """The newest frame that came since the last call and was accepted; never waits.

        Reads a waiting stop and hello too, and brings the watchdog to `now_ns`.
        """
        for data in self._waiting(self._stop):
            if (stop := self._read(data, Stop)) is not None:
                self.watchdog.stop(stop.reason)
        for data in self._waiting(self._hello):
            self.hello = self._read(data, Hello) or self.hello
        frame = None
        for data in self._waiting(self._frames):
            if (accepted := self.gate.check(data, now_ns)) is not None:
                frame = accepted
                self.watchdog.fresh(frame.state, now_ns)
        self.watchdog.update(now_ns)
        return frame

    def send_state(self, state: RigState) -> None:
        """Tell the publisher; dropped where nobody listens."""
        with contextlib.suppress(zmq.Again):
            self._state.send(pack(state), zmq.NOBLOCK)

    def close(self) -> None:
        """Close all sockets; the object cannot be used again."""
        self._context.destroy(LINGER_MS)

    def __enter__(self) -> Receiver:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _waiting(self, socket: Socket) -> Iterator[bytes]:
        for _ in range(MOST_AT_ONCE):
            try:
                yield socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                return

    def _read(self, data: bytes, kind: type[Message]) -> Message | None:
        try:
            return unpack(data, kind)
        except FrameError as error:
            self.gate.refused["message"] += 1
            self.gate.last_error = str(error)
            return None
