"""The next command: the largest step that is allowed towards where the rig should be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.bus import Array


@dataclass(frozen=True)
class Limits:
    """Of n joints, all (n,): `lower` and `upper` rad, `velocity` rad/s at most."""

    lower: Array
    upper: Array
    velocity: Array


def slowed(command: Array, moved: Array, arms: Array, reach: float) -> tuple[Array, bool]:
    """`moved` (n,), or so far from `command` towards it that no hand goes further than `reach` m; whether it was held.

    `arms` (hands, n) m: how far from each joint's axis each hand can be, so that a hand moves by the sum of its arms
    times the turns at most.
    """
    furthest = float((arms @ np.abs(moved - command)).max(initial=0.0))
    if furthest <= reach:
        return moved, False
    return command + (moved - command) * (reach / furthest), True


def step(command: Array, target: Array, limits: Limits, speed: Array, dt: float) -> tuple[Array, bool]:
    """The command (n,) after `dt` s from `command` towards `target`, at most at `speed` (n,) rad/s, within the limits.

    The second value says whether a limit held it back.
    """
    allowed = np.clip(target, limits.lower, limits.upper)
    reach = speed * dt
    moved = np.clip(allowed - command, -reach, reach)
    held = bool(np.any(np.abs(command + moved - target) > 1e-6))
    return command + moved, held
