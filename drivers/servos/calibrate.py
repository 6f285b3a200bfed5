"""Where each joint of a built rig has its zero, and which way it turns: found by moving it by hand, torque off."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from drivers.bus import BusError
from drivers.calibration import Mark, calibration_of
from drivers.servos.line import Line, Unit
from drivers.servos.port import Port, Wire
from drivers.servos.table import family_of
from retarget.rig import Rig, Servo
from retarget.servos import BOARDS

LEAST_MOVE = 1 / 36  # of a turn, 10°: less might be backlash, or a hand that shook


def calibrate(rig: Rig, wire: str | Wire, joints: Sequence[str], ask: Callable[[str], None]) -> dict[str, Mark]:
    """Have somebody move each of `joints` of `rig` to its zero and then forwards; `ask` says what to do and waits.

    The torque of all servos goes off first and stays off. Raises BusError where a joint has no servo or its servo
    cannot be felt, where a joint did not move or its servo passed the end of its ticks, and where the joint's limits
    would lie beyond the servo's.
    """
    if rig.buses and rig.buses[0].protocol in BOARDS:
        raise BusError(f"hobby servos on a {rig.buses[0].protocol} cannot be felt: write their pulses by hand")
    servos = {s.joint: s for s in rig.servos}
    if unknown := [j for j in joints if j not in servos]:
        raise BusError(f"no joint {unknown[0]!r} with a servo in rig {rig.name!r}; it has {', '.join(servos)}")
    family = family_of(rig)
    units = [Unit(s.id, s.joint, family.models[s.model.name], s.model.name) for s in rig.servos]
    marks: dict[str, Mark] = {}
    with Port(wire, rig.buses[0].baud) as port:
        line = Line(port, family, units)
        line.check_models()
        line.write("torque_enable", dict.fromkeys(line.units, 0))
        if on := [i for i, value in line.read("torque_enable").items() if value]:
            raise BusError(f"{line.units[on[0]]}: keeps its torque on")
        for joint in joints:
            servo = servos[joint]
            ask(f"{joint}: move it to its zero")
            zero = line.read("present_position", [servo.id])[servo.id]
            ask(f"{joint}: move it forwards (to larger angles), by 10° or more")
            marks[joint] = mark(servo, zero, line.read("present_position", [servo.id])[servo.id])
            calibration_of(rig, marks).check_reach(rig)
    return marks


def mark(servo: Servo, zero: int, forwards: int) -> Mark:
    """Of ticks at a joint's zero and forwards of it; raises BusError as `calibrate`."""
    first, last = servo.model.ticks
    for ticks in (zero, forwards):
        if not first <= ticks <= last:
            raise BusError(f"{servo.joint}: stands at {ticks} ticks, beyond {first}…{last}: turn the horn on the servo")
    moved, turn = forwards - zero, servo.model.ticks_per_turn
    if abs(moved) > turn / 2:
        raise BusError(
            f"{servo.joint}: went from {zero} to {forwards} ticks, past the servo's end: turn the horn on the servo"
        )
    if abs(moved) < turn * LEAST_MOVE:
        raise BusError(f"{servo.joint}: moved {abs(moved)} ticks only, of {turn * LEAST_MOVE:.0f} that it takes")
    return Mark(1 if moved > 0 else -1, zero)
