"""What `rigcast bus identify` measured of one built unit, joint by joint, and a rig as it was measured.

The file is `<config>/rigcast/measured/<rig>.toml`; see `calibration.py` for `<config>`:

    [left_elbow]
    no_load_speed = 4.61  # rad/s
    delay = 0.021         # s from a goal to the first motion
    friction = 0.09       # N·m
    backlash = 0.008      # rad of play in the gears
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from drivers.bus import BusError
from drivers.calibration import unit_path, unit_tables
from motiongen.files import replacing
from retarget.rig import Rig


@dataclass(frozen=True)
class Measured:
    """Of one joint: `no_load_speed` rad/s; `delay` s from a goal to the first motion; dry `friction` N·m;
    `backlash` rad of play in the gears."""

    no_load_speed: float
    delay: float
    friction: float
    backlash: float


def load_measured(rig: Rig) -> dict[str, Measured]:
    """What was measured of joints of `rig`; empty where nothing was. Raises BusError where the file is wrong."""
    path = unit_path("measured", rig.name)
    out = {}
    for joint, entry in unit_tables(path).items():
        if joint not in rig.joint_names():
            raise BusError(f"{path}: no joint {joint!r} in rig {rig.name!r}; it has {', '.join(rig.joint_names())}")
        try:
            out[joint] = Measured(**entry)
        except TypeError:
            raise BusError(f"{path}: [{joint}] should have no_load_speed, delay, friction and backlash") from None
        if bad := [k for k, v in entry.items() if not isinstance(v, float) or not 0 <= v < 1000]:
            raise BusError(f"{path}: [{joint}] {bad[0]} = {entry[bad[0]]!r} should be a number of at least 0")
    return out


def save_measured(rig: Rig, found: Mapping[str, Measured]) -> Path:
    """Write what was found beside what is there; the file. Raises as `load_measured`, and OSError."""
    path = unit_path("measured", rig.name)
    entries = load_measured(rig) | dict(found)
    path.parent.mkdir(parents=True, exist_ok=True)
    lines: list[str] = []
    with replacing(path) as temporary:
        for joint, measured in entries.items():
            lines += [f"[{joint}]", *(f"{key} = {float(value)!r}" for key, value in asdict(measured).items()), ""]
        temporary.write_text("\n".join(lines))
    return path


def as_measured(rig: Rig) -> Rig:
    """`rig` with the speeds, friction, play and delay of the unit that was measured, for the simulation.

    Its limits, and so what a stream is planned for, stay. The delay is the longest of all joints.
    """
    found = load_measured(rig)
    if not found:
        return rig
    joints = tuple(
        replace(j, no_load_speed=found[j.name].no_load_speed, friction=found[j.name].friction) if j.name in found else j
        for j in rig.joints
    )
    servos = tuple(
        replace(s, model=replace(s.model, play=found[s.joint].backlash)) if s.joint in found else s for s in rig.servos
    )
    delay = max(rig.sensors.delay, *(m.delay for m in found.values()))
    return replace(rig, joints=joints, servos=servos, sensors=replace(rig.sensors, delay=delay))
