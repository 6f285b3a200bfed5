"""The ranges, speeds and accelerations of joints: of a whole trajectory, and from one frame to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.rotation import Array
from retarget.banded import FIRST, SECOND
from retarget.rig import Rig

CLEARANCE = 0.01  # of a limit
RELAXED = 1.6  # Boyd et al. 3.4.3: 1.5 to 1.8 helps
ROUNDS = 5000  # captured clips take up to sixty


@dataclass(frozen=True)
class Limits:
    """Of nj joints: the ranges `reach` (2, nj) rad, by how much a frame's step may move one (`stride` (nj,) rad) and
    by how much the next step may differ from it (`bend` (nj,) rad).
    """

    reach: Array
    stride: Array
    bend: Array


def limits_of(rig: Rig, fps: float) -> Limits:
    """The limits of `rig`'s joints for frames at `fps`."""
    lower, upper, speed, acceleration = np.array([[j.lower, j.upper, j.velocity, j.acceleration] for j in rig.joints]).T
    return Limits(np.array([lower, upper]), speed / fps, acceleration / fps**2)


def within(angles: Array, limits: Limits) -> Array:
    """`angles` (T, nj) moved by as little as leaves them in their ranges, speeds and accelerations, without lag. Joints
    that keep to them stay.
    """
    out = _slowed(angles, limits)
    harsh = (np.abs(np.diff(out, n=2, axis=0)) > limits.bend).any(0)
    if harsh.any():
        out[:, harsh] = _gentle(out[:, harsh], Limits(limits.reach[:, harsh], limits.stride[harsh], limits.bend[harsh]))
    return out


def _slowed(angles: Array, limits: Limits) -> Array:
    """`angles` (T, nj) moved by as little as leaves them in their ranges and no frame's step above the stride.

    The middle of the highest and the lowest curve of that steepness that touch them (McShane's and Whitney's
    extensions): where they already keep to it, they stay.
    """
    high = np.clip(angles, *limits.reach)
    if (np.abs(np.diff(high, axis=0)) <= limits.stride).all():
        return high
    low = high.copy()
    for order in (range(1, len(angles)), range(len(angles) - 2, -1, -1)):
        for t in order:
            before = t - 1 if order.step > 0 else t + 1
            high[t] = np.minimum(high[t], high[before] + limits.stride)
            low[t] = np.maximum(low[t], low[before] - limits.stride)
    return (high + low) / 2


def _gentle(angles: Array, limits: Limits) -> Array:
    """The nearest (T, nj) to `angles`, by the sum of squares, that keeps to all limits: a quadratic program for each
    joint, by the alternating direction method of multipliers (Boyd et al. 2011, 5.2), with over-relaxation.

    It only comes ever nearer to the bounds, so it is given ones that are narrower by CLEARANCE. Raises RuntimeError
    where that does not bring it within the limits.
    """
    from scipy.linalg import cho_solve_banded, cholesky_banded

    spare = np.minimum(CLEARANCE * limits.bend, np.ptp(limits.reach, axis=0) / 4)
    narrow, share = (limits.reach[0] + spare, limits.reach[1] - spare), 1 - CLEARANCE
    bounds = (narrow, *((-share * most, share * most) for most in (limits.stride, limits.bend)))
    factor = cholesky_banded(_normal_band(len(angles)), lower=True)
    kept = [np.clip(np.diff(angles, n=n, axis=0), *bound) for n, bound in enumerate(bounds)]
    owed = [np.zeros_like(part) for part in kept]
    for _ in range(ROUNDS):
        asked = angles + sum(_undiff(k - o, n) for n, (k, o) in enumerate(zip(kept, owed, strict=True)))
        found = cho_solve_banded((factor, True), asked)
        if _keeps(found, limits):
            return np.asarray(found)
        for n, bound in enumerate(bounds):
            there = RELAXED * np.diff(found, n=n, axis=0) + (1 - RELAXED) * kept[n]
            kept[n] = np.clip(there + owed[n], *bound)
            owed[n] += there - kept[n]
    raise RuntimeError(f"joints of {len(angles)} frames are not within their limits after {ROUNDS} rounds")


def _normal_band(count: int) -> Array:
    """(3, count) lower band of 1 + Σ DₙᵀDₙ, where Dₙ takes the n-th differences of `count` values, n from 0 to 2."""
    band = np.zeros((3, count))
    band[0] = 2.0
    for stencil in (FIRST, SECOND):
        for i, a in enumerate(stencil):
            for j, b in enumerate(stencil[: i + 1]):
                band[i - j, j : j + count - len(stencil) + 1] += a * b
    return band


def _undiff(values: Array, n: int) -> Array:
    """Dₙᵀ of (T − n, nj) `values`."""
    for _ in range(n):
        values = -np.diff(np.pad(values, ((1, 1), (0, 0))), axis=0)
    return values


def _keeps(angles: Array, limits: Limits) -> bool:
    inside = (angles >= limits.reach[0]) & (angles <= limits.reach[1])
    slow, gentle = (np.abs(np.diff(angles, n=n, axis=0)) <= m for n, m in ((1, limits.stride), (2, limits.bend)))
    return bool(inside.all() and slow.all() and gentle.all())


def next_within(before: Array, wanted: Array, pace: Array, limits: Limits) -> Array:
    """(nj,) the frame after the two of `before` (2, nj): as near as the limits let it come to `wanted` (nj,), which
    goes on by `pace` (nj,) a frame; able to stop before the ends of the ranges.
    """
    last, rate = before[1], before[1] - before[0]
    behind = wanted - pace - last
    step = pace + np.sign(behind) * np.minimum(np.abs(behind), _stopping(np.abs(behind), limits.bend))
    low = np.maximum(np.maximum(-limits.stride, rate - limits.bend), -_stopping(last - limits.reach[0], limits.bend))
    high = np.minimum(np.minimum(limits.stride, rate + limits.bend), _stopping(limits.reach[1] - last, limits.bend))
    return np.clip(last + np.clip(step, low, np.maximum(low, high)), *limits.reach)


def _stopping(way: Array, bend: Array) -> Array:
    """The longest next step that leaves room to stop within `way`, where each step is by `bend` shorter than the one
    before: way/n + bend (n − 1)/2 for the n steps that it then takes.
    """
    way = np.maximum(way, 0.0)
    count = np.maximum(np.ceil((np.sqrt(1 + 8 * way / bend) - 1) / 2), 1)
    return way / count + bend * (count - 1) / 2
