"""The loop that puts a stream on a servo bus, and every way it ends: with the torque off.

Torque comes on with the first frame that may be followed, at the pose that the servos are in. Commands ease from there
to the stream and then follow it; each is held to the rig's limits of position and speed. A silent stream is held, then
ends in the rig's safe pose. A stop, a servo that does not follow, a lost port or a signal ends at once. So does a servo
that fails, unless the rig says that the others go to their safe pose before.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drivers.buffer import Buffer
from drivers.bus import Array, BusError, Reading, ServoBus, ServoError
from drivers.clock import MonotonicClock, Ticker
from drivers.follow import Limits, slowed, step
from drivers.frame import Frame
from drivers.gate import Gate
from drivers.halts import Halt
from drivers.messages import OPEN_LOOP, Hello, Mode, RigState
from drivers.signals import caught_signals
from drivers.trips import Ceilings, Trips
from drivers.upright import Imu, Standing, missing
from drivers.watchdog import Watchdog
from retarget.reach import lever_arms
from retarget.rig import Rig

NS = 1_000_000_000


class Source(Protocol):
    """Where frames come from: a `Receiver`, or a trajectory that is there (`played.py`)."""

    gate: Gate
    watchdog: Watchdog
    buffer: Buffer
    run: int
    hello: Hello | None

    def poll(self, now_ns: int) -> Frame | None:
        """The newest frame that was accepted, None where none came since the last call; never waits."""
        ...

    def send_state(self, state: RigState) -> None:
        """Take what the rig measured."""
        ...


@dataclass(frozen=True)
class Settings:
    """Of the loop: `rate_hz` cycles a second; `ease_velocity` rad/s at most while joining a stream or going safe.

    `hand_speed` m/s: no hand, foot or head goes faster, for the first runs of a rig; None: as fast as its joints may.
    A joint more than `following_error` rad from its command for `following_s` s trips, so does one above the rig's
    limit of current or temperature for `load_s` s. `settle_s` s are waited at the safe pose before the torque goes off.
    """

    rate_hz: float = 50.0
    ease_velocity: float = 1.0
    following_error: float = 0.5
    following_s: float = 0.5
    load_s: float = 0.5
    settle_s: float = 0.5
    hand_speed: float | None = None


@dataclass(frozen=True)
class Driven:
    """What `drive` did, and why it ended.

    `rms_error` (n,) rad: commanded against what the next cycle read, in the order of `joints`, over the `followed`
    cycles. `held_back`: cycles in which a limit kept the command from the stream. `late`: cycles that began more than
    a period late. `refused`: frames by reason.
    """

    joints: tuple[str, ...]
    mode: Mode
    reason: str
    cycles: int
    followed: int
    held_back: int
    late: int
    rms_error: Array
    accepted: int
    gaps: int
    refused: dict[str, int]


def drive(
    rig: Rig,
    receiver: Source,
    bus: ServoBus,
    settings: Settings | None = None,
    *,
    clock: Ticker | None = None,
    stop: threading.Event | None = None,
    halts: Sequence[Halt] = (),
    watch: Callable[[RigState], None] | None = None,
    imu: Imu | None = None,
) -> Driven:
    """Follow the stream of `receiver` on `bus` until it ends, is stopped, trips, or a signal, `stop` or a halt comes.

    What needs a controller is followed only where it can run: `imu` is what keeps a rig upright that stands free.
    `watch` sees each cycle's state. Handles SIGINT, SIGTERM and SIGHUP when run in the main thread. Torque is off when
    it returns or raises; it raises BusError where the bus fails (a missing servo, a hardware error, a lost port). Where
    one servo fails and the rig's `on_fault` is "rest", the others go to the safe pose first.
    """
    loop = _Loop(rig, receiver, bus, settings or Settings(), clock or MonotonicClock(), watch, imu)
    with caught_signals() as caught, bus:
        try:
            while loop.cycle():
                asked = ["asked to"] if stop is not None and stop.is_set() else []
                if reasons := [*caught, *asked, *filter(None, (halt() for halt in halts))]:
                    loop.finish("stopped", reasons[0])
                    break
            if loop.fault is not None:
                raise loop.fault
        except BusError as error:
            loop.finish("tripped", str(error))
            raise
    return loop.result()


class _Loop:
    def __init__(
        self,
        rig: Rig,
        receiver: Source,
        bus: ServoBus,
        settings: Settings,
        clock: Ticker,
        watch: Callable[[RigState], None] | None,
        imu: Imu | None,
    ) -> None:
        names = rig.joint_names()
        self._columns = np.array([names.index(j) for j in bus.joints])
        joints = [rig.joints[c] for c in self._columns]
        self._limits = Limits(*(np.array([getattr(j, k) for j in joints]) for k in ("lower", "upper", "velocity")))
        self._ease = np.minimum(self._limits.velocity, settings.ease_velocity)
        self._arms = (
            lever_arms(rig)[:, self._columns] if settings.hand_speed is not None else np.zeros((0, len(joints)))
        )
        self._safe = np.array(rig.pose_vector(rig.safe))[self._columns]
        self._trips = _trips(rig, bus.joints, settings)
        self._rig, self._receiver, self._bus, self._settings = rig, receiver, bus, settings
        self._clock, self._watch, self._imu = clock, watch, imu
        self._standing: Standing | None = None  # what keeps the rig upright, where the stream needs it
        self._period_ns = int(NS / settings.rate_hz)
        self._next_ns = clock.now_ns()
        self._frame: Frame | None = None
        self._heard_ns = 0
        self._command: Array | None = None  # None while the torque is off
        self._told: Array | None = None
        self._joined = False
        self._reading: Reading | None = None
        self.fault: ServoError | None = None  # of a servo that is done without until the others are in the safe pose
        self._safe_ns = 0
        self._mode: Mode = "waiting"
        self._reason = ""
        self._squares = np.zeros(len(joints))
        self._cycles = self._followed = self._held_back = self._late = 0

    def cycle(self) -> bool:
        """Wait for the next cycle and do it; False where it was the last."""
        self._clock.sleep_until_ns(self._next_ns)
        now = self._clock.now_ns()
        if now > self._next_ns + self._period_ns:
            self._late += 1
            self._next_ns = now
        self._next_ns += self._period_ns
        self._cycles += 1
        if (newest := self._receiver.poll(now)) is not None:
            self._frame, self._heard_ns = newest, now
        held = self._mode == "hold"
        self._mode, self._reason = self._receiver.watchdog.mode, self._receiver.watchdog.reason
        self._told = self._command  # what the reading answers to
        self._reading = self._measure()
        if self.fault is not None and self._mode != "stopped":
            self._mode, self._reason = "tripped", str(self.fault)
        more = self._act(self._reading, now, held)
        self._tell(now)
        return more

    def finish(self, mode: Mode, reason: str) -> None:
        """End in `mode` for `reason`, and tell the publisher."""
        self._mode, self._reason = mode, reason
        self._tell(self._clock.now_ns())

    def result(self) -> Driven:
        """What was done so far."""
        gate = self._receiver.gate
        rms = np.sqrt(self._squares / max(1, self._followed))
        return Driven(
            self._bus.joints,
            self._mode,
            self._reason,
            self._cycles,
            self._followed,
            self._held_back,
            self._late,
            rms,
            gate.accepted,
            gate.gaps,
            dict(gate.refused),
        )

    def _measure(self) -> Reading:
        try:
            return self._bus.read()
        except ServoError as error:
            if self._rig.on_fault == "limp" or self._command is None or self.fault is not None:
                raise
            self.fault = error
        self._bus.leave_out(self.fault.joint)
        return self._bus.read()

    def _act(self, reading: Reading, now: int, held: bool) -> bool:
        measured = reading.position
        hello = self._receiver.hello
        if self._command is None and hello is not None and hello.controller != OPEN_LOOP:
            if reason := missing(hello.controller, self._imu):
                self._mode, self._reason = "stopped", reason
                return False
            if self._standing is None and self._imu is not None:
                self._standing = Standing(self._rig, self._imu, self._settings.rate_hz)
        if self._mode == "waiting":
            return True
        if self._command is None:
            if self._mode != "following":
                return self._mode == "hold"  # Nothing has moved: there is nothing to make safe.
            self._bus.torque(True)
            self._command = measured
            self._trips.start(now)
        elif held and self._mode == "following":
            self._command = measured  # whoever moved it in the meantime is not fought: it eases from where it is
        if self._mode == "stopped":
            return False
        error = self._command - measured
        if self.fault is not None:
            error[self._bus.joints.index(self.fault.joint)] = 0.0
        if reason := self._trips.reason(error, reading, now):
            self._mode, self._reason = "tripped", reason
            return False
        self._move(self._command, measured, now)
        return not self._settled(now)

    def _move(self, command: Array, measured: Array, now: int) -> None:
        frame = self._frame if self._mode == "following" else None
        following = frame is not None
        if frame is not None:
            target = self._receiver.buffer.target_at(self._receiver.gate.sender_ns(now))[self._columns]
            if self._standing is not None:
                target = target + self._standing.added(frame)[self._columns]
        else:
            target = self._safe if self._goes_safe else command
        speed = self._limits.velocity if following and self._joined else self._ease
        self._command, held = step(command, target, self._limits, speed, self._period_ns / NS)
        if self._settings.hand_speed is not None:
            reach = self._settings.hand_speed * self._period_ns / NS
            self._command, slower = slowed(command, self._command, self._arms, reach)
            held = held or slower
        self._bus.write(self._command)
        self._joined = following and (self._joined or not held)
        if following:
            self._followed += 1
            self._held_back += held
            self._squares += (command - measured) ** 2

    @property
    def _goes_safe(self) -> bool:
        return self._mode == "safe" or self.fault is not None

    def _settled(self, now: int) -> bool:
        if not self._goes_safe or self._command is None or np.abs(self._command - self._safe).max() > 1e-6:
            self._safe_ns = now
        return now - self._safe_ns > self._settings.settle_s * NS

    def _tell(self, now: int) -> None:
        if self._reading is None:
            return
        frame, measured = self._frame, self._reading
        state = RigState(
            rig=self._rig.name,
            rig_hash=self._rig.hash,
            mode=self._mode,
            reason=self._reason[:1000],
            seq=0 if frame is None else frame.seq,
            time_ns=now,
            position=tuple(measured.position.tolist()),
            current=tuple(measured.current.tolist()),
            temperature=tuple(measured.temperature.tolist()),
            voltage=tuple(measured.voltage.tolist()),
            frame_ns=0 if frame is None else frame.capture_ns,
            heard_ns=self._heard_ns,
            run=self._receiver.run,
            command=() if self._told is None else tuple(self._told.tolist()),
        )
        self._receiver.send_state(state)
        if self._watch is not None:
            self._watch(state)


def _trips(rig: Rig, joints: tuple[str, ...], settings: Settings) -> Trips:
    servos = {s.joint: s for s in rig.servos}
    ceilings = Ceilings(
        error=np.full(len(joints), settings.following_error),
        current=np.array([servos[j].max_current for j in joints]),
        temperature=np.array([servos[j].max_temperature for j in joints]),
    )
    return Trips(joints, ceilings, following_s=settings.following_s, load_s=settings.load_s)
