"""Turning points of a signal that swing far enough: what every count of repetitions is made from."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from motiongen.rotation import Array


@dataclass(frozen=True)
class Turning:
    """Where a signal turns round: its `frame`, whether it was `high` or low there, by how much it swung on the smaller
    of both sides (`depth`, in the signal's unit), and from which frame to which (`first`, `last`), and for how many
    `seconds`, it stayed in that half of the swing."""

    frame: int
    high: bool
    depth: float
    first: int
    last: int
    seconds: float


def smoothed(signal: Array, fps: float, seconds: float = 0.1) -> Array:
    """`signal` (T, …) averaged over about `seconds` along time with a triangle, ends held: takes jitter out."""
    half = max(1, round(seconds * fps / 2))
    weights = np.concatenate([np.arange(1, half + 1), [half + 1], np.arange(half, 0, -1)]).astype(float)
    weights /= weights.sum()
    padded = np.concatenate([np.repeat(signal[:1], half, 0), signal, np.repeat(signal[-1:], half, 0)])
    out = np.zeros(np.shape(signal))
    for i, weight in enumerate(weights):
        out += weight * padded[i : i + len(signal)]
    return out


def turnings(signal: Array, fps: float, least: float) -> list[Turning]:
    """Turning points of `signal` (T,), high and low in turn, between which it swings by at least `least`.

    The ends of the signal are none: nobody knows whether it turned there.
    """
    points = _extremes(np.asarray(signal, float), least)
    out = []
    for before, (at, high), after in zip(points, points[1:], points[2:], strict=False):
        depth = float(min(abs(signal[at] - signal[before[0]]), abs(signal[at] - signal[after[0]])))
        sign = 1.0 if high else -1.0
        above = sign * (signal[before[0] : after[0] + 1] - signal[at]) + depth / 2
        start = at - before[0]
        back, on = _crossing(above[start::-1]), _crossing(above[start:])
        out.append(Turning(at, high, depth, at - math.ceil(back) + 1, at + math.ceil(on) - 1, (back + on) / fps))
    return out


def _crossing(above: Array) -> float:
    """Where `above` (N,), positive at first, comes to 0, in frames, between frames by a straight line."""
    past = int(np.argmax(above <= 0))
    return float(past - 1 + above[past - 1] / (above[past - 1] - above[past]))


def _extremes(signal: Array, least: float) -> list[tuple[int, bool]]:
    """Frame and whether high, of all extremes with `least` between neighbours; the first and the last are ends, since
    the signal need not have come to them, or left them, by as much."""
    lowest = highest = 0
    points: list[tuple[int, bool]] = []
    rising: bool | None = None
    for i, value in enumerate(signal):
        if value > signal[highest]:
            highest = i
        if value < signal[lowest]:
            lowest = i
        if rising is not False and signal[highest] - value >= least:
            points.append((highest, True))
            rising, lowest = False, i
        elif rising is not True and value - signal[lowest] >= least:
            points.append((lowest, False))
            rising, highest = True, i
    if points:
        points.append((highest, True) if rising else (lowest, False))
    return points
