"""What `rigcast drive` and `say --drive` share: the bus of a rig, who looks after a drive, and what is told of it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from tyro.conf import arg

from retarget.rig import Mount, Rig
from rigcast import show

if TYPE_CHECKING:
    from drivers.bus import ServoBus
    from drivers.clock import Ticker
    from drivers.drive import Driven, Source
    from drivers.halts import Halt
    from drivers.messages import RigState
    from drivers.trust import Trust
    from drivers.upright import Imu

SIMULATED, EMULATED = "sim", "emulated"  # ports that are no ports: servos, or a whole bus with a body, in this process

FILM_HZ, FILM_SIZE = 10.0, (360, 360)


@dataclass(frozen=True)
class Driving:
    """How a drive is looked after."""

    trusted: bool = False
    """All torque and speed at once, and no sign test before: for emulated buses, and at your own risk."""
    button: Annotated[str | None, arg(metavar="PORT:LINE")] = None
    """An emergency stop: a button that opens, between DTR and this line (cts, dsr) of a serial port of its own."""
    record: Annotated[Path | None, arg(metavar="FILE")] = None
    """Write every command and measurement to this new .rigrec file."""
    film: Annotated[Path | None, arg(metavar="FILE")] = None
    """With `--drive emulated`: film (.mp4, .gif) what the servos make of the motion."""


def run(
    rig: Rig, port: str, source: Source, how: Driving, trouble: Callable[[], str], mount: Mount | None = None
) -> Driven:
    """Drive `rig` on `port` by the frames of `source`. `trouble` says why none come; `mount` how an emulated body is
    held, which has an IMU where the rig has one. No other port has.

    Raises BusError where the bus fails, or where nobody has seen that the unit's joints turn the right way.
    """
    from drivers.drive import Settings, drive
    from drivers.trust import GENTLE_HAND, GENTLE_RUNS, GENTLE_TORQUE, Trust, fingerprint, remember

    trust = None if how.trusted or port in (SIMULATED, EMULATED) else trust_of(rig, port)
    gentle = trust is not None and trust.gentle
    settings = Settings(hand_speed=GENTLE_HAND if gentle else None)
    with ExitStack() as stack:
        halts = _halts(stack, how)
        log = _log(stack, how, rig, settings.rate_hz)
        bus, clock = bus_on(port, rig, gentle=gentle, mount=mount)
        if gentle and trust is not None:
            which = f"gentle run {trust.runs + 1} of {GENTLE_RUNS}"
            show.warn(f"{which}: {GENTLE_TORQUE:.0%} of the torque, {GENTLE_HAND} m/s at the hand at most")
        tell, seen = _teller(trouble), _Film(clock) if how.film is not None else None

        def watch(state: RigState) -> None:
            log(state)
            tell(state)
            if seen is not None and state.mode == "following":
                seen.look()

        driven = drive(rig, source, bus, settings, clock=clock, halts=halts, watch=watch, imu=_imu_of(clock, rig))
    if how.film is not None and seen is not None:
        seen.write(settings.rate_hz, rig, how.film)
    if trust is not None and gentle and driven.followed and driven.mode == "safe":
        remember(rig, fingerprint(rig, port), Trust(trust.runs + 1))
    return driven


def trust_of(rig: Rig, port: str) -> Trust:
    """What the unit on `port` has shown; raises BusError where nobody has seen its joints turn the right way."""
    from drivers.bus import BusError
    from drivers.trust import fingerprint, trust_in

    trust = trust_in(rig, fingerprint(rig, port))
    if trust is None:
        raise BusError(
            f"nobody has seen yet that the joints of {rig.name} on {port} turn the right way as calibrated: "
            f"rigcast bus wiggle --port {port} --rig {rig.name}; an emulated bus may be --trusted"
        )
    return trust


def bus_on(port: str, rig: Rig, *, gentle: bool = False, mount: Mount | None = None) -> tuple[ServoBus, Ticker]:
    """The servo bus of `rig` on `port`, not yet opened, and the clock that it runs on. Raises BusError."""
    from drivers.clock import MonotonicClock
    from drivers.servos.connect import connect
    from drivers.trust import GENTLE_TORQUE

    if port == SIMULATED:
        from drivers.simulated import SimulatedBus

        return SimulatedBus(rig), MonotonicClock()
    if port == EMULATED:
        from drivers.emulation.body import Body
        from drivers.emulation.in_process import InProcess

        wire = InProcess(rig, body=Body(rig, mount=mount))
        return connect(rig, wire), wire
    return connect(rig, port, guarded=True, torque_share=GENTLE_TORQUE if gentle else 1.0), MonotonicClock()


def _imu_of(clock: Ticker, rig: Rig) -> Imu | None:
    from drivers.emulation.in_process import InProcess

    return clock if isinstance(clock, InProcess) and rig.sensors.imu else None


def require_port(port: str) -> None:
    """Find out before any work that there is no such port; raises BusError."""
    from drivers.servos.port import not_opened

    if port not in (SIMULATED, EMULATED) and "://" not in port and not Path(port).exists():
        raise not_opened(port, 0, FileNotFoundError(2, "No such file or directory"))


def driven_dict(driven: Driven) -> dict[str, Any]:
    """What a drive did, as plain data for JSON."""
    return {**asdict(driven), "rms_error": driven.rms_error.tolist()}


def print_driven(driven: Driven) -> None:
    """What a drive did: the error of each joint, and a line of counts."""
    table = show.new_table("joint", "rms error (rad)", title=f"{driven.mode}: {driven.reason}")
    for joint, error in zip(driven.joints, driven.rms_error, strict=True):
        table.add_row(joint, f"{error:.4f}")
    show.console().print(table)
    rms = float(np.sqrt(np.mean(driven.rms_error**2)))
    refused = ", ".join(f"{count} {why}" for why, count in driven.refused.items() if count) or "none"
    print(
        f"{driven.followed} of {driven.cycles} cycles followed, rms {rms:.4f} rad, {driven.held_back} held back by a "
        f"limit, {driven.late} late; {driven.accepted} frames taken, {driven.gaps} missed, refused: {refused}"
    )


def exit_code(driven: Driven) -> int:
    """1 where nothing was followed or the rig tripped."""
    return 0 if driven.followed and driven.mode != "tripped" else 1


class _Film:
    """What the body on an emulated bus does, cycle by cycle."""

    def __init__(self, wire: Ticker) -> None:
        from drivers.emulation.in_process import InProcess

        if not isinstance(wire, InProcess):
            raise ValueError(f"--film films what an emulated bus does (--drive {EMULATED}), no other")
        self._wire = wire
        self._rows: list[np.ndarray] = []

    def look(self) -> None:
        """A cycle has passed."""
        self._rows.append(self._wire.qpos())

    def write(self, rate_hz: float, rig: Rig, path: Path) -> None:
        """Film `rate_hz` looks a second; one of nothing is not written."""
        from sim.render import render_video

        every = round(rate_hz / FILM_HZ)
        if self._rows:
            render_video(np.array(self._rows[::every]), rate_hz / every, rig, path, size=FILM_SIZE)
            print(f"wrote {path}", file=sys.stderr)


def _halts(stack: ExitStack, how: Driving) -> list[Halt]:
    from drivers.halts import any_key, button

    halts = [stack.enter_context(any_key())]
    if how.button is not None:
        halts.append(stack.enter_context(button(how.button)))
    return halts


def _log(stack: ExitStack, how: Driving, rig: Rig, rate_hz: float) -> Callable[[RigState], None]:
    if how.record is None:
        return lambda state: None
    from drivers.recording import Recorder
    from drivers.states import recorder_of

    return recorder_of(stack.enter_context(Recorder(how.record)), rig, rate_hz)


def _teller(trouble: Callable[[], str]) -> Callable[[RigState], None]:
    """Says each change of mode on stderr, and why no stream comes."""
    told = ""
    tell_trouble = show.warner()

    def tell(state: RigState) -> None:
        nonlocal told
        now = f"{state.mode}: {state.reason}" if state.reason else state.mode
        if now != told:
            print(now, file=sys.stderr, flush=True)
        told = now
        tell_trouble(trouble())

    return tell
