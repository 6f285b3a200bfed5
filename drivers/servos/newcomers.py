"""Servos on a wire that no rig names yet: who they are, and one of them moved a little, to see what it turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from drivers.bus import BusError
from drivers.calibration import calibration_of
from drivers.clock import MonotonicClock, Ticker
from drivers.servos.connect import connect
from drivers.servos.port import Wire
from drivers.servos.setup import Found
from drivers.servos.wiggle import wiggle
from drivers.trust import GENTLE_TORQUE
from retarget.rig import FULL_TORQUE_ERROR, PLANNED_SPEED, Bus, Joint, Pose, Rig, Sensors, Servo
from retarget.servos import ServoModel, servo_models


def stranger(found: Sequence[Found]) -> Rig:
    """A rig without a body: a joint "servo ID" for each servo, about its middle, as far as it goes to both sides.

    Raises BusError where there are none, of several protocols or rates, or one that `retarget/servos.toml` lacks.
    """
    if not found:
        raise BusError("no servo answered: check power, cable, --protocol and --baud")
    buses = sorted({(f.protocol, f.baud) for f in found})
    if len(buses) > 1:
        told = ", ".join(f"{protocol} at {baud}" for protocol, baud in buses)
        raise BusError(f"servos of several kinds answered: {told}; name one by --protocol and --baud")
    known = servo_models()
    if foreign := [f for f in found if f.model not in known]:
        raise BusError(f"servo {foreign[0].id} is of model {foreign[0].model}; known are {', '.join(known)}")
    [(protocol, baud)] = buses
    return Rig(
        name="new",
        folder=Path(),
        model=Path(),
        root="",
        mount="stand",
        stand_clearance=0.0,
        joints=tuple(_joint(f.id, known[f.model]) for f in found),
        follow=(),
        feet=(),
        nominal=Pose(1.0, {}),
        safe=Pose(1.0, {}),
        sensors=Sensors(True, False, 0.0),
        power=None,
        buses=(Bus("main", protocol, baud),),
        servos=tuple(Servo(f"servo {f.id}", "main", f.id, known[f.model]) for f in found),
    )


def show(rig: Rig, wire: str | Wire, ident: int, clock: Ticker | None = None) -> int:
    """Turn servo `ident` of the `stranger` a little and back, weakly, all others held, then let all go.

    Gives back which way it went first: +1 or, where its end is near, -1, by its ticks. Raises BusError as `wiggle`.
    """
    ways: list[int] = []

    def seen(_: str, way: int) -> bool:
        ways.append(way)
        return True

    bus = connect(rig, wire, calibration=calibration_of(rig, {}), torque_share=GENTLE_TORQUE, guarded=True)
    with bus:
        wiggle(rig, bus, [f"servo {ident}"], lambda joint, way: lambda: seen(joint, way), clock or MonotonicClock())
    return ways[0]


def _joint(ident: int, made: ServoModel) -> Joint:
    first, last = made.ticks
    reach = (last - first) // 2 / made.ticks_per_turn * 2 * math.pi
    speed, torque = made.no_load_speed, made.stall_torque
    return Joint(f"servo {ident}", -reach, reach, PLANNED_SPEED * speed, torque, speed, torque / FULL_TORQUE_ERROR, 0.0)
