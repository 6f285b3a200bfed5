"""Joints that jerk, smoothed without lag: the cut-off of a Gaussian low-pass falls until the gate's check passes."""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array
from sim.commanded import sustained_jerk

HIGHEST = 20.0  # Hz, of the first cut-off tried
FALLS = 0.9  # from one to the next


def smoothed(angles: Array, fps: float, limit: float) -> tuple[Array, Array]:
    """`angles` (T, nj) rad of which no joint jerks by more than `limit` rad/s³, and the cut-off (nj,) in Hz at which
    each was cut, infinite where it did not have to be.

    A Gaussian neither overshoots nor is faster than what goes in, so ranges and speeds keep.
    """
    from scipy.ndimage import gaussian_filter1d

    out, cut = angles.copy(), np.full(angles.shape[1], np.inf)
    for i in np.flatnonzero(sustained_jerk(angles, fps) > limit):
        cut[i] = HIGHEST / FALLS
        while sustained_jerk(out[:, i : i + 1], fps)[0] > limit:
            cut[i] *= FALLS
            spread = np.sqrt(np.log(2)) / (2 * np.pi * cut[i]) * fps  # frames: half the power is left at the cut-off
            out[:, i] = gaussian_filter1d(angles[:, i], spread, mode="nearest")
    return out, cut
