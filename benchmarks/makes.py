"""Three joints of the puppet on servos of each make, for the benchmarks of the buses."""

from __future__ import annotations

from dataclasses import replace

from retarget.rig import Bus, Rig, load_rig
from retarget.servos import servo_models

JOINTS = ("head_pan", "head_tilt", "left_elbow")
MAKES = {
    "dynamixel2": ("XM430-W350", 1_000_000),
    "dynamixel1": ("AX-12A", 1_000_000),
    "feetech": ("STS3215", 1_000_000),
    "lx16a": ("LX-16A", 115_200),
    "maestro": ("HS-645MG", 115_200),
    "ssc32": ("HS-645MG", 115_200),
}


def rig_of(protocol: str) -> Rig:
    """The rig on a bus of this protocol."""
    model, baud = MAKES[protocol]
    rig = load_rig("puppet")
    servos = tuple(replace(s, model=servo_models()[model]) for s in rig.servos if s.joint in JOINTS)
    return replace(rig, buses=(Bus("main", protocol, baud),), servos=servos)
