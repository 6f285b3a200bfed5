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
from drivers.endpoint import DEFAULT, StreamError, endpoints
from drivers.frame import UNCHECKED, Frame, FrameError, State, encode
from drivers.keys import Keys
from drivers.messages import MAX_MESSAGE_BYTES, OPEN_LOOP, Hello, RigState, Stop, pack, unpack
from drivers.outlet import MOST_AT_ONCE, Outlet
from drivers.rate import Rate
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
        self._refused: Counter[str] = Counter()
        self._rate = Rate(MOST_STATES_PER_S)
        self._outlet = Outlet(address, keys, insecure)

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
            self._outlet.hello.send(self._hello_message, zmq.NOBLOCK)
            if self._stop_message is not None:
                self._outlet.stop.send(self._stop_message, zmq.NOBLOCK)

    def stop(self, reason: str) -> None:
        """Tell every rig to switch its torque off, now and, for those that join later, with every hello."""
        self._stop_message = pack(Stop(reason))
        self._outlet.stop.send(self._stop_message, zmq.NOBLOCK)

    def states(self) -> list[RigState]:
        """What the rigs have told since the last call, `MOST_AT_ONCE` at most; what cannot be read is skipped."""
        found: list[RigState] = []
        with contextlib.suppress(zmq.Again):
            for _ in range(MOST_AT_ONCE):
                message = self._outlet.state.recv(zmq.NOBLOCK, copy=False)
                if not self._rate.allows(self._outlet.sender(message), self._clock.now_ns()):
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
        return self._refused + self._outlet.refused

    def close(self) -> None:
        """Let the last messages leave and close all sockets."""
        self._outlet.close()

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


def hello_for(trajectory: Trajectory, rig: Rig, report_id: str, stream: int, controller: str = OPEN_LOOP) -> Hello:
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
        controller=controller,
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
    pos = trajectory.targets.astype(np.float32)
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
    """What `publish` did: frames sent, the time of the first, whether anybody listened.

    How late frames left after their deadline, in seconds: half of them, 99 in 100 and the latest. `skipped` were so
    late that no rig would have followed them, and were not sent. `refused`: who and what was turned away, by reason
    (see `Publisher.refused`).
    """

    frames: int
    first_ns: int
    median_late_s: float
    p99_late_s: float
    worst_late_s: float
    skipped: int
    heard: bool
    refused: dict[str, int]
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
    states: list[RigState] = []
    hello = hello_for(trajectory, rig, report_id, stream, controller)
    carried = report_id if controller == OPEN_LOOP else UNCHECKED
    with Publisher(hello, address, keys=keys, insecure=insecure, clock=clock) as publisher:
        heard = publisher.wait_for_subscriber(wait_s)
        start = clock.now_ns()
        late: list[int] = []
        skipped = 0
        for frame in frames_of(trajectory, rig, carried, stream, start):
            clock.sleep_until_ns(frame.due_ns)
            late.append(clock.now_ns() - frame.due_ns)
            if late[-1] > TOO_LATE_NS and frame.state == State.PLAY:
                skipped += 1
                continue
            publisher.send(frame)
            states += publisher.states()
        heard = publisher.wait_for_subscriber(0) or heard
        refused = dict(publisher.refused)
    median, p99, worst = (float(np.quantile(late, q, method="higher")) / NS for q in (0.5, 0.99, 1.0))
    return Published(len(late) - skipped, start, median, p99, worst, skipped, heard, refused, tuple(states))
