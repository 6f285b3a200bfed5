"""From a frame to the next command: where the rig should be now, and the largest step that is allowed towards it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivers.bus import Array
from drivers.frame import Frame

NS = 1_000_000_000


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


def target_at(frame: Frame, sender_ns: int) -> Array:
    """Joint angles (nj,) in rad that `frame` asks for at `sender_ns` on its sender's clock.

    Linear between the samples of a block; the first before it is due; past the last, on with its velocity for at most
    one period, since the next frame is on its way then.
    """
    last = len(frame.pos) - 1
    at = max(0.0, (sender_ns - frame.due_ns) / frame.period_ns)
    if at >= last:
        ahead_s = min(at - last, 1.0) * frame.period_ns / NS
        return (frame.pos[last] + frame.vel[last] * ahead_s).astype(float)
    k = int(at)
    return (frame.pos[k] + (frame.pos[k + 1] - frame.pos[k]) * (at - k)).astype(float)


def step(command: Array, target: Array, limits: Limits, speed: Array, dt: float) -> tuple[Array, bool]:
    """The command (n,) after `dt` s from `command` towards `target`, at most at `speed` (n,) rad/s, within the limits.

    The second value says whether a limit held it back.
    """
    allowed = np.clip(target, limits.lower, limits.upper)
    reach = speed * dt
    moved = np.clip(allowed - command, -reach, reach)
    held = bool(np.any(np.abs(command + moved - target) > 1e-6))
    return command + moved, held
