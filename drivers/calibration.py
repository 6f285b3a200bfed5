"""Direction and zero of each servo of one *unit*: the same rig built twice has two calibrations.

The file is `<config>/rigcast/calibration/<rig>.toml`, `<config>` being `$XDG_CONFIG_HOME` or `~/.config`:

    [left_elbow]
    direction = -1   # +1 or -1: which way the joint turns when the servo's ticks grow
    zero = 2071      # ticks where the joint's angle is zero
"""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.bus import Array, BusError
from motiongen.files import replacing
from retarget.rig import Rig, Servo


@dataclass(frozen=True)
class Calibration:
    """Ticks of n servos against the angles of their joints; all arrays (n,). The default is the middle, forwards."""

    direction: NDArray[np.int64]
    zero: NDArray[np.int64]
    ticks_per_turn: Array

    def ticks(self, angle: ArrayLike) -> NDArray[np.int64]:
        """Nearest ticks of joint angles (n,) in rad."""
        turn = self.ticks_per_turn / (2 * math.pi)
        return self.zero + self.direction * np.rint(np.asarray(angle) * turn).astype(np.int64)

    def angle(self, ticks: ArrayLike) -> Array:
        """Joint angles (n,) in rad of `ticks`."""
        return (np.asarray(ticks) - self.zero) * self.direction * (2 * math.pi / self.ticks_per_turn)

    def check_reach(self, rig: Rig) -> None:
        """Raises BusError where the limits of a joint of `rig` lie outside the ticks of its servo."""
        joints = {j.name: j for j in rig.joints}
        ends = [self.ticks([getattr(joints[s.joint], end) for s in rig.servos]) for end in ("lower", "upper")]
        for servo, low, high in zip(rig.servos, *np.sort(ends, axis=0).tolist(), strict=True):
            first, last = servo.model.ticks
            if low < first or high > last:
                raise BusError(
                    f"joint {servo.joint!r}: its limits are ticks {low}…{high} by this calibration; servo "
                    f"{servo.id} has {first}…{last}"
                )


def calibration_path(rig: str) -> Path:
    """Where this user keeps the calibration of `rig`."""
    return unit_path("calibration", rig)


def unit_path(what: str, rig: str) -> Path:
    """Where this user keeps `what` is known of the built unit of `rig`."""
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config) / "rigcast" / what / f"{rig}.toml"


def unit_tables(path: Path) -> dict[str, Any]:
    """The tables of such a file by name; none where there is no file. Raises BusError where it is damaged."""
    try:
        return tomllib.loads(path.read_text())
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BusError(f"{path}: {error}") from None


@dataclass(frozen=True)
class Mark:
    """Of one joint: which way it turns when ticks grow (+1 or -1), and the ticks at its zero angle."""

    direction: int
    zero: int


def load_calibration(rig: Rig, path: Path | None = None) -> Calibration:
    """Calibration of the servos of `rig`, in their order; the default where there is no file or no entry.

    Raises BusError naming the file and the entry that is wrong.
    """
    path = path or calibration_path(rig.name)
    return _calibration(rig, _entries(rig, path), str(path))


def calibration_of(rig: Rig, marks: Mapping[str, Mark]) -> Calibration:
    """Calibration of the servos of `rig` by the marks of some joints, the default for the others."""
    return _calibration(rig, {joint: asdict(mark) for joint, mark in marks.items()}, "marks")


def save_marks(rig: Rig, marks: Mapping[str, Mark], path: Path | None = None) -> Path:
    """Write the marks of some joints into the calibration file of `rig`, beside what is there; the file.

    Raises BusError where what is there is wrong, OSError where it cannot be written.
    """
    path = path or calibration_path(rig.name)
    entries = _entries(rig, path) | {joint: asdict(mark) for joint, mark in marks.items()}
    _calibration(rig, entries, str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        tables = ("\n".join([f"[{j}]", *(f"{k} = {v}" for k, v in e.items())]) for j, e in entries.items())
        temporary.write_text("\n\n".join(tables) + "\n")
    return path


def _entries(rig: Rig, path: Path) -> dict[str, Any]:
    """The tables of the file by joint; none where there is no file."""
    given = unit_tables(path)
    joints = [s.joint for s in rig.servos]
    if unknown := sorted(set(given) - set(joints)):
        raise BusError(f"{path}: no joint {unknown[0]!r} with a servo in rig {rig.name!r}; it has {', '.join(joints)}")
    return given


def _calibration(rig: Rig, given: Mapping[str, Any], path: str) -> Calibration:
    direction, zero = [], []
    for servo in rig.servos:
        entry = given.get(servo.joint, {})
        if not isinstance(entry, dict) or set(entry) - {"direction", "zero"}:
            raise BusError(f"{path}: [{servo.joint}] takes direction and zero, not {entry}")
        direction.append(entry.get("direction", 1))
        first, last = servo.model.ticks
        if direction[-1] not in (1, -1):
            raise BusError(f"{path}: [{servo.joint}] direction {direction[-1]!r}; it is 1 or -1")
        zero.append(entry.get("zero", _default_zero(rig, servo, direction[-1])))
        if type(zero[-1]) is not int or not first <= zero[-1] <= last:
            raise BusError(f"{path}: [{servo.joint}] zero {zero[-1]!r}; it is in {first}…{last}")
    turn = np.array([s.model.ticks_per_turn for s in rig.servos])
    return Calibration(np.array(direction, np.int64), np.array(zero, np.int64), turn)


def _default_zero(rig: Rig, servo: Servo, direction: int) -> int:
    """The servo's middle; where the joint's limits do not fit about it, the tick that has them in the middle."""
    first, last = servo.model.ticks
    middle = (first + last + 1) // 2
    [joint] = [j for j in rig.joints if j.name == servo.joint]
    turn = servo.model.ticks_per_turn / (2 * math.pi)
    ends = [direction * angle * turn for angle in (joint.lower, joint.upper)]
    if first <= middle + min(ends) and middle + max(ends) <= last:
        return middle
    return middle - round(sum(ends) / 2)
