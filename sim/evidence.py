"""What a check looks at, and how its verdict is put into words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from sim.balance import Balance
from sim.geometry import Geometry
from sim.report import Check
from sim.scene import Scene
from sim.simulate import Rollout
from sim.thresholds import THRESHOLDS, limit_for

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Evidence:
    """A trajectory as it was asked for and as physics did it: `asked` and `done` are the geometry of the two.

    `scene` is the one it was done in. `balance` of what was asked for; None where the rig is held or has no feet.
    """

    trajectory: Trajectory
    scene: Scene
    rollout: Rollout
    asked: Geometry
    done: Geometry
    balance: Balance | None

    @property
    def rig(self) -> Rig:
        return self.scene.rig

    @property
    def mount(self) -> Mount:
        return self.scene.mount

    def seconds(self, frame: int) -> float:
        """Time of a frame in seconds since the first."""
        return float(frame / self.trajectory.fps)


@dataclass(frozen=True)
class Peak:
    """The largest entry of a (T, N) array: its value, frame and column; all zero where the array is empty."""

    value: float
    frame: int
    column: int


def peak(values: Array) -> Peak:
    """Where (T, N) `values` are largest."""
    if values.size == 0:
        return Peak(0.0, 0, 0)
    frame, column = divmod(int(np.argmax(values)), values.shape[1])
    return Peak(float(values[frame, column]), frame, column)


def verdict(e: Evidence, name: str, value: float, at_s: float | None, found: str, remedy: str) -> Check:
    """Hold `value` against the threshold of `name`; the advice is `found`, and where it failed also `remedy`."""
    limit = limit_for(name, e.rig)
    ok = bool(value <= limit)
    return Check(
        name=name,
        value=float(value),
        limit=limit,
        unit=THRESHOLDS[name].unit,
        ok=ok,
        advice=f"{found}." if ok else f"{found}: {remedy}.",
        at_s=at_s,
    )


def not_here(e: Evidence, name: str, where: str = "") -> Check:
    """The check of a fault that this rig cannot have; `where` says why, if not for its mount."""
    unit, limit = THRESHOLDS[name].unit, limit_for(name, e.rig)
    advice = f"Does not apply {where or f'with mount {e.mount}'}."
    return Check(name, 0.0, limit, unit, ok=True, advice=advice, applies=False)
