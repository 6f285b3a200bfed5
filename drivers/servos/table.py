"""The families by the name that rig.toml gives them, and the servo models of each."""

from __future__ import annotations

from drivers.bus import BusError
from drivers.servos.dynamixel1 import AX_MX
from drivers.servos.family import Family, Model
from drivers.servos.feetech import FEETECH
from drivers.servos.lx16a import LX16A
from drivers.servos.x_series import X_SERIES
from retarget.rig import Rig

FAMILIES = {f.name: f for f in (X_SERIES, AX_MX, FEETECH, LX16A)}


def family_of(rig: Rig) -> Family:
    """The family on the one bus of `rig`; raises BusError where it is none, or has servos or a rate of another."""
    if len(rig.buses) != 1 or not rig.servos:
        raise BusError(f"rig {rig.name!r} has {len(rig.servos)} servos on {len(rig.buses)} buses; one bus is needed")
    [bus] = rig.buses
    if bus.protocol not in FAMILIES:
        raise BusError(f"bus protocol {bus.protocol!r} has no packets; these have: {', '.join(FAMILIES)}")
    family = FAMILIES[bus.protocol]
    if foreign := [s.model.name for s in rig.servos if s.model.name not in family.models]:
        raise BusError(f"servo model {foreign[0]!r} does not speak {family.name}; known are {', '.join(family.models)}")
    if bus.baud not in family.bauds:
        rates = ", ".join(str(b) for b in sorted(family.bauds))
        raise BusError(f"no {family.name} servo runs at {bus.baud} baud; it may be {rates}")
    return family


def model_of(name: str) -> Model | None:
    """The servo model `name` of any family; None where it has no wire of its own (PWM)."""
    return next((f.models[name] for f in FAMILIES.values() if name in f.models), None)
