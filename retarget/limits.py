"""The nearest way to keep a trajectory within the ranges and speeds of its joints."""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array


def within(angles: Array, reach: Array, stride: Array) -> Array:
    """`angles` (T, nj) moved by as little as leaves them within `reach` (2, nj) and no frame's step above `stride`.

    The middle of the highest and the lowest curve of that steepness that touch them (McShane's and Whitney's
    extensions): where they already keep to it, they stay.
    """
    high = np.clip(angles, *reach)
    if (np.abs(np.diff(high, axis=0)) <= stride).all():
        return high
    low = high.copy()
    for order in (range(1, len(angles)), range(len(angles) - 2, -1, -1)):
        for t in order:
            before = t - 1 if order.step > 0 else t + 1
            high[t] = np.minimum(high[t], high[before] + stride)
            low[t] = np.maximum(low[t], low[before] - stride)
    return (high + low) / 2
