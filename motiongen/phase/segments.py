"""The primary segment of a motion: the part that can go on for as long as one likes (DiffusionPhase, Sec. 3.1)."""

from __future__ import annotations

import numpy as np

from motiongen.nn import Floats
from motiongen.phase.phases import Frames, Timing

ALIKE, LONG, AWAY = 1.0, 1.0, 0.15  # c₁, c₂ and c₃ of Eq. 1
SHORTEST = 20  # steps from the start of a segment to its end
LONGEST_END = 45  # steps of a head or a tail: more, and it is no straight line any more
POOL = 4  # segments of a motion among which training chooses: the periodicity-based augmentation
_EVERY = 3  # frames: ends are looked for on this grid
_APART = 0.2  # of the motion's length: at least as far, both ends together, are the segments of a pool from each other


def primary_segments(x: Floats, count: int = POOL) -> Frames:
    """First and last frames (N, 2) of up to `count` primary segments of normalised features (T, D), best first.

    Eq. 1: c₁·‖f_s − f_e‖² − c₂·(e − s)/T − c₃·(‖f_0 − f_s‖² + ‖f_T − f_e‖²) is least, distances in units of their mean
    over all pairs of frames; and heads and tails must be short. A motion too short for any is one segment. Raises
    ValueError for fewer than two frames.
    """
    if len(x) < 2:
        raise ValueError(f"a motion of {len(x)} frames has no segment; it needs two or more")
    last = len(x) - 1
    if last <= SHORTEST:
        return np.array([[0, last]])
    at = np.unique(np.append(np.arange(0, last, _EVERY), last))
    apart = _squares(x[at])
    apart /= max(float(apart.mean()), 1e-9)
    lasts = at - at[:, None]
    cost = ALIKE * apart - LONG * lasts / last - AWAY * (apart[:1].T + apart[-1:])
    cost[(lasts < SHORTEST) | (at[:, None] > LONGEST_END) | (last - at > LONGEST_END)] = np.inf
    found: list[tuple[int, int]] = []
    while len(found) < count and np.isfinite(cost).any():
        s, e = divmod(int(cost.argmin()), len(at))
        found.append((int(at[s]), int(at[e])))
        cost[np.abs(at - at[s])[:, None] + np.abs(at - at[e]) < _APART * last] = np.inf
    return np.array(found)


def timing_of(segments: Frames, counts: Frames) -> Timing:
    """Timing of motions of `counts` (B,) frames whose primary segments are `segments` (B, 2)."""
    start, stop = segments[:, 0], segments[:, 1]
    return Timing(start, stop - start, counts - 1 - stop)


def _squares(x: Floats) -> Floats:
    """Squared distances (T, T) between the rows of `x` (T, D)."""
    size = (x * x).sum(1)
    return np.maximum(size[:, None] + size - 2 * x @ x.T, 0.0)
