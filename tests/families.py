"""The small rig of three servos, with the servos of any family; for the tests of the buses."""

from __future__ import annotations

from dataclasses import replace

from small_rig import small_rig

from retarget.rig import Bus, Rig
from retarget.servos import servo_models

MADE = {
    "dynamixel2": ("dynamixel2", "XM430-W350", 1_000_000),
    "dynamixel1": ("dynamixel1", "AX-12A", 1_000_000),
    "feetech": ("feetech", "STS3215", 1_000_000),
    "feetech scs": ("feetech", "SCS0009", 1_000_000),
    "lx16a": ("lx16a", "LX-16A", 115_200),
    "maestro": ("maestro", "HS-645MG", 115_200),
    "ssc32": ("ssc32", "HS-645MG", 115_200),
}
FAMILIES = tuple(MADE)


def rig_of(kind: str, models: dict[str, str] | None = None) -> Rig:
    """Joints a, b, c on servos 3, 7, 1 of a family; `models` names others of it by joint."""
    protocol, model, baud = MADE[kind]
    rig = small_rig()
    servos = tuple(replace(s, model=servo_models()[(models or {}).get(s.joint, model)]) for s in rig.servos)
    return replace(rig, buses=(Bus("main", protocol, baud),), servos=servos)
