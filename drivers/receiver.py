"""The receiving end of a stream: newest frame only, stop and hello, and the rig's state on the way back."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Iterator
from types import TracebackType

import zmq

from drivers.buffer import Buffer
from drivers.endpoint import DEFAULT, StreamError, endpoints
from drivers.frame import MAX_BYTES, Frame, FrameError
from drivers.gate import Gate
from drivers.keys import Keys, require_guarded
from drivers.line import Line
from drivers.messages import MAX_MESSAGE_BYTES, Hello, RigState, Stop, news_in, pack, unpack
from drivers.roster import Roster
from drivers.sockets import HELLO_QUEUE, LINGER_MS, Context, Curve, open_socket
from drivers.watchdog import Patience, Watchdog

FRAME_QUEUE = 64  # with a buffer: a third of a second at 200 Hz
MOST_AT_ONCE = 8  # A flooded socket may not keep a control loop busy.
TEND_EVERY_NS = 100_000_000


class Receiver:
    """Receives a stream for the rig with `rig_hash`, named `rig`; a context manager, used from one thread.

    `gate` counts what was refused, `watchdog` knows the mode, `roster` what the rigs on this stream have told the
    publisher; `preview` is for what only draws (see `Gate`). `run`: 32 random bits, for the states that it sends.
    `buffer` says what the frames ask for; it plays them `buffer_s` s late and then takes every frame, not the newest
    alone. With `keys` it follows the machine named `leader` alone, or the only one that may lead. Raises StreamError
    where the address is no endpoint, or on another machine with neither `keys` nor `insecure`, and for a `buffer_s`
    that is longer than the silence after which a rig holds.
    """

    def __init__(
        self,
        address: str = DEFAULT,
        *,
        rig_hash: int,
        rig: str = "another",
        preview: bool = False,
        patience: Patience | None = None,
        buffer_s: float = 0.0,
        keys: Keys | None = None,
        leader: str = "",
        insecure: bool = False,
    ) -> None:
        patience = patience or Patience()
        if not 0 <= buffer_s <= patience.hold_s:
            raise StreamError(f"buffer {buffer_s:g} s; it must be in 0…{patience.hold_s:g}, after which a rig holds")
        self.buffer = Buffer(buffer_s)
        self.gate = Gate(rig_hash, preview=preview, max_age_s=patience.hold_s)
        self.watchdog = Watchdog(patience)
        self.roster = Roster()
        self.run = secrets.randbits(32)
        self.hello: Hello | None = None
        self._rig, self._rig_hash = rig, rig_hash
        self._at = endpoints(address)
        require_guarded(self._at, keys, insecure)
        self._curve = None if keys is None else Curve(keys.secret, server=keys.leader(leader))
        self._context: Context = zmq.Context()
        self._state: Line | None = None
        self._tend_ns = 0
        try:
            self._frames = self._connect(zmq.SUB, self._at.frames, newest=buffer_s == 0, queue=FRAME_QUEUE)
            self._hello = self._connect(zmq.SUB, self._at.hello, queue=HELLO_QUEUE)
            self._stop = self._connect(zmq.SUB, self._at.stop)
        except BaseException:
            self._context.destroy(0)
            raise

    @property
    def trouble(self) -> str:
        """Why the publisher and we do not understand each other, in one line; "" where we do or nobody is there."""
        lines = (line for line in (self._frames, self._stop, self._state) if line is not None)
        return next((line.trouble for line in lines if line.trouble), "") or self._foreign

    @property
    def _foreign(self) -> str:
        told = self.hello
        if told is None or told.rig_hash == self._rig_hash:
            return ""
        theirs, ours = (
            f"{name!r} ({hash:016x})" for name, hash in ((told.rig, told.rig_hash), (self._rig, self._rig_hash))
        )
        return f"the stream is for the rig {theirs}; this one is {ours}"

    def poll(self, now_ns: int) -> Frame | None:
        """The newest frame that came since the last call and was accepted; never waits.

        Reads a waiting stop and hello too, and brings the watchdog to `now_ns`. A silence that has been too long is
        noted before the frame that ends it.
        """
        self._tend(now_ns)
        self.watchdog.update(now_ns)
        for data in self._waiting(self._stop):
            with self._counting():
                self.watchdog.stop(unpack(data, Stop).reason)
        for data in self._waiting(self._hello):
            with self._counting():
                news = news_in(data)
                if isinstance(news, Hello):
                    self.hello = news
                else:
                    self.roster.note("", news, now_ns)
        frame = None
        for data in self._waiting(self._frames, FRAME_QUEUE):
            if (accepted := self.gate.check(data, now_ns)) is not None:
                frame = accepted
                self.buffer.put(frame)
                self.watchdog.fresh(frame.state, now_ns)
        self.watchdog.update(now_ns)
        return frame

    def send_state(self, state: RigState) -> None:
        """Tell the publisher; dropped where nobody listens. Connects with the first: a preview has nothing to tell."""
        if self._state is None:
            self._state = self._connect(zmq.PUB, self._at.state)
        with contextlib.suppress(zmq.Again):
            self._state.socket.send(pack(state), zmq.NOBLOCK)

    def close(self) -> None:
        """Close all sockets; the object cannot be used again."""
        self._context.destroy(LINGER_MS)

    def __enter__(self) -> Receiver:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _connect(self, kind: int, address: str, *, newest: bool = False, queue: int = 2) -> Line:
        most, curve = MAX_BYTES if address == self._at.frames else MAX_MESSAGE_BYTES, self._curve
        socket = open_socket(
            self._context, kind, address, bind=False, max_bytes=most, newest=newest, queue=queue, curve=curve
        )
        return Line(socket, address)

    def _tend(self, now_ns: int) -> None:
        if now_ns >= self._tend_ns:
            self._tend_ns = now_ns + TEND_EVERY_NS
            for line in (self._frames, self._hello, self._stop, self._state):
                if line is not None:
                    line.tend(now_ns)

    def _waiting(self, line: Line, most: int = MOST_AT_ONCE) -> Iterator[bytes]:
        for _ in range(most):
            try:
                yield line.socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                return

    @contextlib.contextmanager
    def _counting(self) -> Iterator[None]:
        """Count a message that cannot be read, and go on."""
        try:
            yield
        except FrameError as error:
            self.gate.refused["message"] += 1
            self.gate.last_error = str(error)
