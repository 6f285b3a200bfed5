"""The sending end of a stream: frames at absolute deadlines, hello once a second, a stop that stays said."""

from __future__ import annotations

import contextlib
import secrets
from collections import Counter
from dataclasses import dataclass, field, replace
from types import TracebackType

import numpy as np
import zmq

from drivers.clock import MonotonicClock, Ticker
from drivers.control import Answer, Look, Rest, Say, Told, request_in
from drivers.endpoint import DEFAULT, StreamError, endpoints
from drivers.frame import UNCHECKED, Frame, FrameError, State, encode
from drivers.keys import Keys
from drivers.messages import MAX_MESSAGE_BYTES, OPEN_LOOP, Hello, RigState, Stop, pack, unpack
from drivers.outlet import MOST_AT_ONCE, Outlet
from drivers.rate import Rate
from drivers.roster import Roster
from drivers.samples import CLOSING_FRAMES, frames_of, hello_for
from drivers.sockets import open_socket
from drivers.watchdog import Patience
from retarget.resample import resampled
from retarget.rig import Rig
from retarget.trajectory import Trajectory

NS = 1_000_000_000
HELLO_EVERY_NS = NS
MOST_HZ = 1000
TOO_LATE_NS = int(Patience().hold_s * NS)
MOST_STATES_PER_S = 1000  # Of one rig: as many as a control loop of 1 kHz tells.
MOST_REQUESTS_PER_S = 20
PASS_ON_EVERY_NS = 50_000_000  # What a rig told is passed on to viewers and recorders so often.


@dataclass(frozen=True)
class Caller:
    """Who asked on the control socket: `name` of the key or, without keys, what the caller says; `key` is of libzmq."""

    key: bytes
    name: str


class Publisher:
    """Binds the five sockets of `address` and sends; a context manager, used from one thread.

    `hello` goes out each second, and to whoever joins, while frames or `tick` keep coming; assign another to change it.
    `roster` knows the rigs from what they told. `stopped` says who stopped the stream and why, "" where nobody has.
    With `keys` it encrypts, and only keys that may follow receive, only keys that may control send states; every key
    may stop. Raises StreamError where the address is busy, or open to other machines with neither `keys` nor
    `insecure`.
    """

    def __init__(
        self,
        hello: Hello,
        address: str = DEFAULT,
        *,
        keys: Keys | None = None,
        insecure: bool = False,
        clock: Ticker | None = None,
    ) -> None:
        self._clock = clock or MonotonicClock()
        self.stopped = ""
        self.roster = Roster()
        self._hello = hello
        self._stop_message: bytes | None = None
        self._next_hello_ns = self._clock.now_ns()
        self._refused: Counter[str] = Counter()
        self._rate = Rate(MOST_STATES_PER_S)
        self._request_rate = Rate(MOST_REQUESTS_PER_S)
        self._outlet = Outlet(address, keys, insecure)

    @property
    def hello(self) -> Hello:
        """Who streams what."""
        return self._hello

    @hello.setter
    def hello(self, hello: Hello) -> None:
        self._hello = hello
        self._next_hello_ns = self._clock.now_ns()

    def wait_for_subscriber(self, timeout_s: float) -> bool:
        """Wait until a receiver has subscribed to the frames; False where none has after `timeout_s`."""
        return self._outlet.wait_for_subscriber(timeout_s)

    def send(self, frame: Frame) -> None:
        """Send one frame; receivers that cannot keep up lose it, nobody waits for them."""
        with contextlib.suppress(zmq.Again):
            self._outlet.frames.send(encode(frame), zmq.NOBLOCK)
        self.tick()

    def tick(self) -> None:
        """Send the hello, and the stop once there is one, where a second has passed or somebody new is there."""
        now = self._clock.now_ns()
        if now < self._next_hello_ns and not self._outlet.somebody_came():
            return
        self._next_hello_ns = now + HELLO_EVERY_NS
        with contextlib.suppress(zmq.Again):
            self._outlet.hello.send(pack(self._hello), zmq.NOBLOCK)
            if self._stop_message is not None:
                self._outlet.stop.send(self._stop_message, zmq.NOBLOCK)

    def stop(self, reason: str) -> None:
        """Tell every rig to switch its torque off, now and, for those that join later, with every hello."""
        self.stopped = self.stopped or reason
        self._stop_message = pack(Stop(reason[:1000]))
        self._outlet.stop.send(self._stop_message, zmq.NOBLOCK)

    def states(self) -> list[RigState]:
        """What the rigs have told since the last call, `MOST_AT_ONCE` at most; what cannot be read is skipped."""
        found: list[RigState] = []
        with contextlib.suppress(zmq.Again):
            for _ in range(MOST_AT_ONCE):
                message = self._outlet.state.recv(zmq.NOBLOCK, copy=False)
                now, sender = self._clock.now_ns(), self._outlet.sender(message)
                if not self._rate.allows(sender, now):
                    self._refused["rate"] += 1
                    continue
                try:
                    found.append(unpack(message.bytes, RigState))
                except FrameError:
                    self._refused["message"] += 1
                    continue
                self.roster.note(sender, found[-1], now)
        self._pass_on()
        return found

    def requests(self) -> list[tuple[Caller, Say | Rest | Look]]:
        """What was asked on the control socket since the last call, `MOST_AT_ONCE` at most; a stop has been obeyed.

        What cannot be read is skipped; a key that may not `say` is told so.
        """
        found: list[tuple[Caller, Say | Rest | Look]] = []
        with contextlib.suppress(zmq.Again):
            for _ in range(MOST_AT_ONCE):
                parts = self._outlet.control.recv_multipart(zmq.NOBLOCK, copy=False)
                sender = self._outlet.sender(parts[-1])
                caller = Caller(parts[0].bytes, sender)
                try:
                    request = request_in(parts[-1].bytes)
                    if len(parts) != 2:
                        raise FrameError(f"request: {len(parts) - 1} parts instead of one")
                except FrameError:
                    self._refused["message"] += 1
                    continue
                if not isinstance(request, Stop) and not self._request_rate.allows(sender, self._clock.now_ns()):
                    self._refused["rate"] += 1
                elif isinstance(request, Stop):
                    self.stop(f"{request.reason} ({sender})" if sender else request.reason)
                    self.tell(caller, Told("", "stopped", self.stopped))
                elif isinstance(request, Look) or self._outlet.may_say(parts[-1]):
                    found.append((Caller(caller.key, sender or request.sender), request))
                else:
                    self.tell(caller, Told(request.id, "refused", f"the key {sender!r} may not say what the rig does"))
        return found

    def tell(self, caller: Caller, answer: Answer) -> None:
        """Answer `caller`; dropped where it is no longer there."""
        with contextlib.suppress(zmq.Again):
            self._outlet.control.send_multipart([caller.key, pack(answer)], zmq.NOBLOCK)

    def ended(self) -> str:
        """Why nobody should play on: the stream was stopped or a rig is not well; "" where all is well.

        Reads the control socket: who asks for more than a stop is told that nobody listens.
        """
        for caller, request in self.requests():
            self.tell(
                caller, Told(request.id, "refused", "this stream plays what it was given; `rigcast serve` listens")
            )
        return f"stopped: {self.stopped}" if self.stopped else self.roster.unwell()

    def _pass_on(self) -> None:
        now = self._clock.now_ns()
        for member in self.roster:
            if member.heard_ns > member.passed_ns and now - member.passed_ns >= PASS_ON_EVERY_NS:
                member.passed_ns = now
                with contextlib.suppress(zmq.Again):
                    self._outlet.hello.send(pack(member.state), zmq.NOBLOCK)

    @property
    def refused(self) -> Counter[str]:
        """How often who or what was refused: `message` and `rate`; with keys also `stranger` and `handshake`."""
        return self._refused + self._outlet.refused

    def close(self) -> None:
        """Let the last messages leave and close all sockets."""
        self._outlet.close()

    def __enter__(self) -> Publisher:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def require_free(address: str) -> None:
    """Find out before any work that a publisher could not bind `address`; raises StreamError as it would."""
    at = endpoints(address)
    with zmq.Context() as context:
        for each in (at.frames, at.hello, at.stop, at.state, at.control):
            open_socket(context, zmq.PUB, each, bind=True, max_bytes=MAX_MESSAGE_BYTES).close(0)


@dataclass(frozen=True)
class Published:
    """What `publish` did: frames sent, the time of the first, whether anybody listened.

    How late frames left after their deadline, in seconds: half of them, 99 in 100 and the latest. `skipped` were so
    late that no rig would have followed them, and were not sent. `refused`: who and what was turned away, by reason
    (see `Publisher.refused`). `ended`: who or which rig ended it before its time, and why; "" where none did.
    """

    frames: int
    first_ns: int
    median_late_s: float
    p99_late_s: float
    worst_late_s: float
    skipped: int
    heard: bool
    refused: dict[str, int]
    ended: str = ""
    states: tuple[RigState, ...] = field(default=(), repr=False)


def publish(
    trajectory: Trajectory,
    rig: Rig,
    report_id: str = UNCHECKED,
    address: str = DEFAULT,
    *,
    rate_hz: float | None = None,
    wait_s: float = 0.0,
    keys: Keys | None = None,
    insecure: bool = False,
    clock: Ticker | None = None,
    controller: str = OPEN_LOOP,
) -> Published:
    """Stream `trajectory` once, in real time; frame k leaves at start + k / rate, whatever the ones before it cost.

    It ends early, and says so to the rigs, where it is stopped or a rig is not well: nobody walks on a tripped rig.
    `rate_hz` 1…1000 frames a second, linear between those of the trajectory; by default its own. Frames that are late
    leave at once; those that rigs would refuse as too old by then are skipped. Waits up to `wait_s` for a first
    receiver. Only previews follow without a `report_id`, or where the report needs another `controller` than
    `open_loop`. `keys` and `insecure` are the Publisher's. Raises StreamError as it does, and where the trajectory is
    not of this rig.
    """
    if rate_hz is not None:
        if not 1 <= rate_hz <= MOST_HZ:
            raise StreamError(f"rate {rate_hz:g} Hz; it must be in 1…{MOST_HZ}")
        trajectory = resampled(trajectory, rate_hz)
    clock = clock or MonotonicClock()
    stream = secrets.randbits(32)
    hello = hello_for(trajectory, rig, report_id, stream, controller)
    carried = report_id if controller == OPEN_LOOP else UNCHECKED
    with Publisher(hello, address, keys=keys, insecure=insecure, clock=clock) as publisher:
        heard = publisher.wait_for_subscriber(wait_s)
        start = clock.now_ns()
        late: list[int] = []
        skipped, ended = 0, ""
        states: list[RigState] = []
        for frame in frames_of(trajectory, rig, carried, stream, start):
            clock.sleep_until_ns(frame.due_ns)
            late.append(clock.now_ns() - frame.due_ns)
            if late[-1] > TOO_LATE_NS and frame.state == State.PLAY:
                skipped += 1
                continue
            publisher.send(frame)
            states += publisher.states()
            if ended := publisher.ended():
                break
        if ended:
            closing = replace(frame, state=State.IDLE, vel=np.zeros_like(frame.vel))
            for k in range(CLOSING_FRAMES):
                publisher.send(replace(closing, seq=frame.seq + 1 + k))
        heard = publisher.wait_for_subscriber(0) or heard
        refused = dict(publisher.refused)
    median, p99, worst = (float(np.quantile(late, q, method="higher")) / NS for q in (0.5, 0.99, 1.0))
    return Published(len(late) - skipped, start, median, p99, worst, skipped, heard, refused, ended, tuple(states))
