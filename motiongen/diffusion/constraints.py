"""What a sample must hold to: wrappers of a denoiser that put it into the estimate of x_0 at every pass.

A sampler's last step hands out its last estimate, so the sample holds it too, to float precision. Of wrappers in each
other the outer one has the last word: a total around known values holds both where its weights are 0 on known frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.samplers import Denoiser, Samples


def keep_known(denoise: Denoiser, known: NDArray[np.floating], mask: NDArray[np.bool_]) -> Denoiser:
    """Overwrites x_0 (B, T, F) with `known` where `mask` says (MDM, Sec. 3, Editing); any frames and columns.

    `known` and `mask` are (B, T, F) or broadcast to it. Raises ValueError where a known value is not finite.
    """
    if not np.isfinite(np.where(mask, known, 0)).all():
        raise ValueError("the known values that are to be kept must all be finite numbers")

    def overwritten(x: Samples, t: float) -> Samples:
        x0 = denoise(x, t)
        return np.where(mask, known.astype(x0.dtype), x0)

    return overwritten


def with_total(
    denoise: Denoiser,
    column: int,
    frames: NDArray[np.bool_],
    total: NDArray[np.floating],
    weights: NDArray[np.floating],
) -> Denoiser:
    """Makes a column of x_0 (B, T, F) add up to `total` (B,) over each clip's `frames` (B, T); nan leaves a clip alone.

    A null-space projection, x̂ = A†y + (I − A†A)x (Wang et al. 2022, DDNM): of all corrections that meet the total it
    takes the one that is proportional to `weights` (B, T), at least 0 each; equal weights make A† the pseudo-inverse
    and the correction the smallest. A total is in x_0's own unit: where the column is a rate r = mean + std·x, n frames
    at `fps` come to an amount a with total = (a·fps − n·mean)/std. Raises ValueError for arrays of other shapes,
    weights that are negative or not finite, an infinite total, and a clip with a total whose frames have no weight.
    """
    if not total.shape == frames.shape[:1] == weights.shape[:1] or frames.shape != weights.shape:
        raise ValueError(f"shapes: frames {frames.shape}, total {total.shape}, weights {weights.shape}")
    if not np.isfinite(weights).all() or (weights < 0).any():
        raise ValueError("weights must be finite and at least 0")
    if np.isinf(total).any():
        raise ValueError("a total must be finite, or nan for a clip that has none")
    asked = ~np.isnan(total)
    reach = np.where(frames, weights, 0).sum(1, dtype=np.float64)
    idle = np.flatnonzero(asked & (reach == 0))
    if len(idle):
        raise ValueError(f"clip {idle[0]} has a total but no frame with a weight above 0")
    share = np.where(frames, weights, 0) / np.where(asked, reach, np.inf)[:, None]

    def projected(x: Samples, t: float) -> Samples:
        x0 = denoise(x, t).copy()
        found = np.where(frames, x0[..., column], 0).sum(1, dtype=np.float64)
        missing = np.where(asked, total - found, 0)
        x0[..., column] += (share * missing[:, None]).astype(x0.dtype)
        return x0

    return projected
