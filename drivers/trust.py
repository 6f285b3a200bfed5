"""What one built unit of a rig has shown: that its joints turn the right way, and how many gentle runs ended in order.

Kept by a fingerprint of everything that the showing rests on: the rig's joints and servos, the calibration, and the USB
adapter (its serial number; where it has none, the port's name). Another calibration, another adapter: shown anew.
The file is `<config>/rigcast/trust/<rig>.toml`; see `calibration.py` for `<config>`.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.bus import BusError
from drivers.calibration import Calibration, load_calibration, unit_path, unit_tables
from motiongen.files import replacing
from retarget.rig import Rig

GENTLE_RUNS = 3
GENTLE_TORQUE = 0.3  # of what the servos can
GENTLE_HAND = 0.25  # m/s


@dataclass(frozen=True)
class Trust:
    """`runs`: gentle drives of this unit that ended in order, since all its joints were seen to turn the right way."""

    runs: int

    @property
    def gentle(self) -> bool:
        """Whether the next run should be gentle."""
        return self.runs < GENTLE_RUNS


def fingerprint(rig: Rig, port: str, calibration: Calibration | None = None) -> str:
    """16 hex digits of the unit of `rig` on the serial `port`."""
    known = calibration or load_calibration(rig)
    servos = [(s.joint, s.bus, s.id, s.model.name) for s in rig.servos]
    marks = [known.direction.tolist(), known.zero.tolist()]
    return hashlib.sha256(repr((rig.hash, servos, marks, _adapter(port))).encode()).hexdigest()[:16]


def trust_in(rig: Rig, unit: str) -> Trust | None:
    """What the `unit` (its fingerprint) has shown; None where its joints were not seen to turn the right way.

    Raises BusError where the file is damaged.
    """
    entry = _entries(rig).get(unit)
    return None if entry is None else Trust(entry["runs"])


def remember(rig: Rig, unit: str, trust: Trust) -> Path:
    """Write down what the `unit` has shown; the file. Raises BusError and OSError as reading and writing do."""
    path = unit_path("trust", rig.name)
    entries = _entries(rig) | {unit: {"runs": trust.runs}}
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        temporary.write_text("\n".join(f"[{name}]\nruns = {entry['runs']}\n" for name, entry in entries.items()))
    return path


def _entries(rig: Rig) -> dict[str, dict[str, Any]]:
    path = unit_path("trust", rig.name)
    entries = unit_tables(path)
    for name, entry in entries.items():
        if not isinstance(entry, dict) or type(entry.get("runs")) is not int or entry["runs"] < 0:
            raise BusError(f"{path}: [{name}] should be a table with runs, a whole number from 0")
    return entries


def _adapter(port: str) -> str:
    from serial.tools.list_ports import comports

    return next((p.serial_number for p in comports() if p.device == port and p.serial_number), port)
