"""The ranges, speeds and accelerations of joints: of a whole trajectory, and from one frame to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.rotation import Array
from retarget.rig import Rig


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
