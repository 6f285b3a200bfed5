"""The sending end of a stream: frames at absolute deadlines, hello once a second, a stop that stays said."""

from __future__ import annotations

import contextlib
import secrets
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from types import TracebackType

import numpy as np
import zmq

from drivers.clock import MonotonicClock, Ticker
from drivers.doorkeeper import Doorkeeper
from drivers.endpoint import DEFAULT, Endpoints, StreamError, endpoints
from drivers.frame import UNCHECKED, Frame, FrameError, State, encode
from drivers.keys import Keys, Right, require_guarded
from drivers.messages import MAX_MESSAGE_BYTES, Hello, RigState, Stop, pack, unpack
from drivers.rate import Rate
from drivers.sockets import LINGER_MS, Context, Curve, Socket, open_socket
from retarget.rig import Rig
from retarget.trajectory import Trajectory

NS = 1_000_000_000
HELLO_EVERY_NS = NS
SUBSCRIBED = b"\x01"  # What an XPUB hands over when somebody asks for everything.
MOST_AT_ONCE = 64  # A flooded socket may not keep the next frame waiting.
MOST_STATES_PER_S = 1000  # Of one rig: as many as a control loop of 1 kHz tells.
CLOSING_FRAMES = 3  # The end of the stream is said this often: a newest-only link may drop one.


class Publisher:
    """Binds the four sockets of `address` and sends; a context manager, used from one thread.

    `hello` goes out each second, and to whoever joins, while frames or `tick` keep coming. With `keys` it encrypts, and
    only keys that may follow receive, only keys that may control send. Raises StreamError where the address is busy, or
    open to other machines with neither `keys` nor `insecure`.
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
        self._hello_message = pack(hello)
        self._stop_message: bytes | None = None
        self._next_hello_ns = self._clock.now_ns()
        self._heard = False
        self._refused: Counter[str] = Counter()
        self._rate = Rate(MOST_STATES_PER_S)
        at = endpoints(address)
        require_guarded(at, keys, insecure)
        self._context: Context = zmq.Context()
        self._doorkeeper = None if keys is None else Doorkeeper(self._context, keys)
        self._sockets: list[Socket] = []
        try:
            self._open(at, keys)
        except BaseException:
            self._end(0)
            raise

    def wait_for_subscriber(self, timeout_s: float) -> bool:
        """Wait until a receiver has subscribed to the frames; False where none has after `timeout_s`."""
        if not self._heard and self._frames.poll(int(timeout_s * 1000)):
            self._heard = self._frames.recv() == SUBSCRIBED
        return self._heard

    def send(self, frame: Frame) -> None:
        """Send one frame; receivers that cannot keep up lose it, nobody waits for them."""
        with contextlib.suppress(zmq.Again):
            self._frames.send(encode(frame), zmq.NOBLOCK)
        self.tick()

    def tick(self) -> None:
        """Send the hello, and the stop once there is one, where a second has passed or somebody new is there."""
        now = self._clock.now_ns()
        if now < self._next_hello_ns and not self._somebody_came():
            return
        self._next_hello_ns = now + HELLO_EVERY_NS
        with contextlib.suppress(zmq.Again):
            self._hello.send(self._hello_message, zmq.NOBLOCK)
            if self._stop_message is not None:
                self._stop.send(self._stop_message, zmq.NOBLOCK)

    def stop(self, reason: str) -> None:
        """Tell every rig to switch its torque off, now and, for those that join later, with every hello."""
        self._stop_message = pack(Stop(reason))
        self._stop.send(self._stop_message, zmq.NOBLOCK)

    def states(self) -> list[RigState]:
        """What the rigs have told since the last call, `MOST_AT_ONCE` at most; what cannot be read is skipped."""
        found: list[RigState] = []
        with contextlib.suppress(zmq.Again):
            for _ in range(MOST_AT_ONCE):
                message = self._state.recv(zmq.NOBLOCK, copy=False)
                if not self._rate.allows(self._sender(message), self._clock.now_ns()):
                    self._refused["rate"] += 1
                    continue
                try:
                    found.append(unpack(message.bytes, RigState))
                except FrameError:
                    self._refused["message"] += 1
        return found

    @property
    def refused(self) -> Counter[str]:
        """How often who or what was refused: `message` and `rate`; with keys also `stranger` and `handshake`."""
        return self._refused + (self._doorkeeper.refused if self._doorkeeper else Counter())

    def close(self) -> None:
        """Let the last messages leave (for at most `LINGER_MS`) and close all sockets."""
        self._end(LINGER_MS)

    def _somebody_came(self) -> bool:
        came = False
        with contextlib.suppress(zmq.Again):
            for _ in range(MOST_AT_ONCE):
                came |= self._hello.recv(zmq.NOBLOCK) == SUBSCRIBED
        return came

    def _open(self, at: Endpoints, keys: Keys | None) -> None:
        try:
            # XPUB is PUB that also hands over the subscriptions, so that the first frame can wait for one, and whoever
            # comes is greeted at once.
            self._frames = self._bind(zmq.XPUB, at.frames, keys, "follow")
            self._hello = self._bind(zmq.XPUB, at.hello, keys, "follow")
            self._hello.setsockopt(zmq.XPUB_VERBOSE, 1)
            self._stop = self._bind(zmq.PUB, at.stop, keys, "follow")
            self._state = self._bind(zmq.SUB, at.state, keys, "control")
        finally:
            if self._doorkeeper is not None:
                self._doorkeeper.start()

    def _bind(self, kind: int, address: str, keys: Keys | None, right: Right) -> Socket:
        curve = None if keys is None else Curve(keys.secret, right)
        socket = open_socket(self._context, kind, address, bind=True, max_bytes=MAX_MESSAGE_BYTES, curve=curve)
        self._sockets.append(socket)
        if self._doorkeeper is not None:
            self._doorkeeper.watch(socket)
        return socket

    def _sender(self, message: zmq.Frame) -> str:
        return "" if self._doorkeeper is None else str(message.get("User-Id"))

    def _end(self, linger_ms: int) -> None:
        for socket in self._sockets:
            socket.close(linger_ms)
        self._context.term()

    def __enter__(self) -> Publisher:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def require_free(address: str) -> None:
    """Find out before any work that a publisher could not bind `address`; raises StreamError as it would.

    An ipc path is not tried: binding one takes it away from whoever has it.
    """
    if (at := endpoints(address)).frames.startswith("tcp:"):
        with zmq.Context() as context:
            for each in (at.frames, at.hello, at.stop, at.state):
                open_socket(context, zmq.PUB, each, bind=True, max_bytes=MAX_MESSAGE_BYTES).close(0)


def hello_for(trajectory: Trajectory, rig: Rig, report_id: str, stream: int) -> Hello:
    """The hello of a stream that plays `trajectory` on `rig`."""
    return Hello(
        rig=rig.name,
        rig_hash=rig.hash,
        joints=rig.joint_names(),
        lower=tuple(j.lower for j in rig.joints),
        upper=tuple(j.upper for j in rig.joints),
        velocity=tuple(j.velocity for j in rig.joints),
        rate_hz=trajectory.fps,
        stream=stream,
        report_id=report_id,
        text="; ".join(label.text for label in trajectory.labels)[:1000],
        source=" ".join(filter(None, (trajectory.source.generator, trajectory.source.weights)))[:1000],
        licence=trajectory.source.licence[:1000],
    )


def frames_of(trajectory: Trajectory, rig: Rig, report_id: str, stream: int, start_ns: int) -> Iterator[Frame]:
    """The frames of `trajectory`, one sample each, due from `start_ns` on, and closing frames that say IDLE.

    `capture_ns` is the due time: a sender sends each frame when it is due. Raises StreamError where the trajectory's
    joints are not the rig's.
    """
    if trajectory.joints != rig.joint_names():
        raise StreamError(
            f"the trajectory's joints are not those of rig {rig.name!r}: it was made for {trajectory.rig!r}"
        )
    pos = trajectory.joint_pos.astype(np.float32)
    root = trajectory.qpos[:, :7].astype(np.float32)
    vel = np.gradient(pos, 1 / trajectory.fps, axis=0).astype(np.float32) if len(pos) > 1 else np.zeros_like(pos)
    contacts = np.zeros(len(pos), np.uint32)
    for bit, foot in enumerate(rig.feet):
        if foot.name in trajectory.contacts:
            contacts |= trajectory.contacts[foot.name].astype(np.uint32) << np.uint32(bit)
    for seq in range(len(pos) + CLOSING_FRAMES):
        at, closing = min(seq, len(pos) - 1), seq >= len(pos)
        due = start_ns + round(seq * NS / trajectory.fps)
        yield Frame(
            stream=stream,
            seq=seq,
            rig_hash=rig.hash,
            report_id=report_id,
            capture_ns=due,
            due_ns=due,
            period_ns=round(NS / trajectory.fps),
            pos=pos[at : at + 1],
            vel=np.zeros_like(vel[:1]) if closing else vel[at : at + 1],
            root=root[at : at + 1],
            contacts=contacts[at : at + 1],
            state=State.IDLE if closing else State.PLAY,
        )


@dataclass(frozen=True)
class Published:
    """What `publish` did: frames sent, the time of the first, how late the latest was, whether anybody listened.

    `refused`: who and what was turned away, by reason (see `Publisher.refused`).
    """

    frames: int
    first_ns: int
    worst_late_s: float
    heard: bool
    refused: dict[str, int]
    states: tuple[RigState, ...] = field(default=(), repr=False)


def publish(
    trajectory: Trajectory,
    rig: Rig,
    report_id: str = UNCHECKED,
    address: str = DEFAULT,
    *,
    wait_s: float = 0.0,
    keys: Keys | None = None,
    insecure: bool = False,
    clock: Ticker | None = None,
) -> Published:
    """Stream `trajectory` once, in real time; frame k leaves at start + k / fps, whatever the ones before it cost.

    Waits up to `wait_s` for a first receiver. Without a `report_id` only previews will follow. `keys` and `insecure`
    are the Publisher's. Raises StreamError as it does, and where the trajectory is not of this rig.
    """
    clock = clock or MonotonicClock()
    stream = secrets.randbits(32)
    states: list[RigState] = []
    hello = hello_for(trajectory, rig, report_id, stream)
    with Publisher(hello, address, keys=keys, insecure=insecure, clock=clock) as publisher:
        heard = publisher.wait_for_subscriber(wait_s)
        start = clock.now_ns()
        worst, count = 0, 0
        for frame in frames_of(trajectory, rig, report_id, stream, start):
            clock.sleep_until_ns(frame.due_ns)
            worst = max(worst, clock.now_ns() - frame.due_ns)
            publisher.send(frame)
            states += publisher.states()
            count += 1
        heard = publisher.wait_for_subscriber(0) or heard
        refused = dict(publisher.refused)
    return Published(count, start, worst / NS, heard, refused, tuple(states))
