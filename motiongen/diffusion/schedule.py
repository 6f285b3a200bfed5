"""Noise schedules and time grids: how much of the data is left at each level, and which levels a sampler visits.

Time runs from 0 (data) to 1 (noise), level i of a chain of 1,000 being i / 1000. At time t there is
x_t = α(t)·x_0 + σ(t)·ε with α² + σ² = 1, the closed form of the forward chain (Ho et al. 2020, Eq. 4, with α = √ᾱ).
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEVELS = 1000  # of the published chains
OFFSET = 0.008  # Nichol & Dhariwal 2021, Eq. 17: keeps the first noise levels from vanishing
_MIN_SIGNAL = 1e-3  # their cap on β in effect: the last level stays invertible
_LOG_SIGNAL = np.concatenate([[0.0], np.cumsum(np.log1p(-np.linspace(1e-4, 0.02, LEVELS))) / 2])
_FINE = 1_000_000  # a grid's times are whole multiples of 1 / _FINE


@dataclass(frozen=True)
class Schedule:
    """A variance-preserving schedule; `signal` is α(t), which falls from 1 at t = 0 to almost nothing at t = 1."""

    name: str
    signal: Callable[[float], float]

    def signal_and_noise(self, t: float) -> tuple[float, float]:
        """α(t) and σ(t) for t in [0, 1]."""
        alpha = self.signal(t)
        return alpha, math.sqrt(1 - alpha**2)

    def levels(self, t: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """α and σ (B,) of times `t` (B,)."""
        alpha, sigma = np.array([self.signal_and_noise(float(each)) for each in t]).T
        return alpha, sigma

    def log_ratio(self, t: float) -> float:
        """λ(t) = log(α/σ), for t in (0, 1]: half the logarithm of the signal-to-noise ratio."""
        alpha, sigma = self.signal_and_noise(t)
        return math.log(alpha / sigma)


def _cosine(t: float) -> float:
    start = math.cos(OFFSET / (1 + OFFSET) * math.pi / 2)
    return max(_MIN_SIGNAL, math.cos((t + OFFSET) / (1 + OFFSET) * math.pi / 2) / start)


def _linear(t: float) -> float:
    return math.exp(np.interp(t * LEVELS, np.arange(LEVELS + 1), _LOG_SIGNAL))


COSINE = Schedule("cosine", _cosine)
"""Nichol & Dhariwal 2021, Eq. 17; MDM's."""

LINEAR = Schedule("linear", _linear)
"""β from 1e-4 to 0.02 in equal steps (Ho et al. 2020, Sec. 4), MotionDiffuse's: α = √Π(1 − β) at the 1,000 levels
themselves, geometric between two of them."""

SCHEDULES = {each.name: each for each in (COSINE, LINEAR)}


def even_times(steps: int) -> list[float]:
    """Times from 1 down to 0, `steps` + 1 of them, evenly apart; raises ValueError unless steps is 1 to 1,000."""
    _check(steps)
    return [1 - i / steps for i in range(steps + 1)]


def even_ratios(schedule: Schedule, steps: int) -> list[float]:
    """Times from 1 down to the first of the 1,000 levels, evenly apart in λ (as in DPM-Solver, Lu et al. 2022), then 0.

    There are `steps` + 1 of them; raises ValueError unless steps is 1 to 1,000.
    """
    _check(steps)
    wanted = np.linspace(schedule.log_ratio(1.0), schedule.log_ratio(1 / LEVELS), steps)[1:]
    fall = range(_FINE + 1)
    inner = [bisect_left(fall, -each, lo=1, key=lambda i: -schedule.log_ratio(i / _FINE)) / _FINE for each in wanted]
    return [1.0, *inner, 0.0]


def _check(steps: int) -> None:
    if not 1 <= steps <= LEVELS:
        raise ValueError(f"steps must be 1 to {LEVELS}, not {steps}")
