"""A position servo: proportional, first order near its goal, at constant speed far from it, as long as it has no load.

Where it has one, `emulation/body.py` says what becomes of its motor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Demand:
    """What a servo is told: go to `goal` rad (None: let go), at `speed` rad/s and `share` of its torque at most."""

    goal: float | None
    speed: float
    share: float = 1.0


@dataclass
class Motor:
    """State of one motor. `angle` rad, `speed` rad/s; `temperature` °C and `voltage` V, None where nothing models them.

    Within `full_error` rad of the goal the speed is proportional to the error, reaching `no_load_speed` rad/s at its
    edge; the motor's inertia, gravity and the profile's acceleration are left out. `jammed` holds the shaft still.
    `play` rad between the stops of the gears: the shaft, which `angle` and the encoder are of, stands until the motor,
    `slack` rad ahead of the middle between them, has come to the other one.
    """

    no_load_speed: float
    full_error: float
    angle: float = 0.0
    speed: float = 0.0
    effort: float = 0.0
    jammed: bool = False
    temperature: float | None = None
    voltage: float | None = None
    play: float = 0.0
    slack: float = 0.0

    def advance(self, dt: float, goal: float | None, max_speed: float) -> None:
        """Move for `dt` s towards `goal` rad, at most at `max_speed` rad/s; None is torque off: nothing moves.

        Exact for a goal that stands: constant speed until the linear band, then e' = -e/τ, τ = full_error /
        no_load_speed. `effort` is the share of stall current, 0 in free motion, since back-EMF then balances PWM.
        """
        if goal is None or self.jammed:
            self.speed = 0.0
            error = 0.0 if goal is None else goal - self.angle
            self.effort = max(-1.0, min(1.0, error / self.full_error))
            return
        top = min(max_speed, self.no_load_speed)
        tau = self.full_error / self.no_load_speed
        error = goal - self.angle
        dt -= self._cross(dt, max(-top, min(top, error / tau)))
        far_s = max(0.0, (abs(error) - top * tau) / top) if top > 0 else dt
        at_top = min(dt, far_s)
        error -= math.copysign(top * at_top, error)
        error *= math.exp(-(dt - at_top) / tau)
        self.angle = goal - error
        self.speed = max(-top, min(top, error / tau))
        self.effort = 0.0

    def _cross(self, dt: float, speed: float) -> float:
        """Seconds of `dt` that the motor takes to its stop at `speed` rad/s, which stays while the shaft stands."""
        left = 0.5 * self.play - math.copysign(1.0, speed) * self.slack
        if left <= 0 or speed == 0:
            return 0.0
        taken = min(dt, left / abs(speed))
        self.slack += speed * taken
        return taken
