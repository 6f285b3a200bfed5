"""Normal equations of a trajectory: a block for every frame, and diagonal blocks between frames up to two apart.

Stored as LAPACK's lower band, `band[t, j, d]` = A[n t + j + d, n t + j], so that every frame costs the same.
"""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array

REACH = 2  # frames: a second difference spans three
SECOND = np.array([1.0, -2.0, 1.0])
FIRST = np.array([-1.0, 1.0])


class Equations:
    """The x (T, n) that minimises a sum of squares: each frame's own, and those of differences between frames."""

    def __init__(self, curvature: Array, gradient: Array) -> None:
        """Start with each frame's ½ xᵀ `curvature` x + `gradient` x: (T, n, n), symmetric, and (T, n)."""
        frames, self.size = gradient.shape
        self.band = np.zeros((frames, self.size, REACH * self.size + 1))
        for j in range(self.size):
            self.band[:, j, : self.size - j] = curvature[:, j:, j]
        self.downhill = -gradient

    def add_differences(self, stencil: Array, weight: Array, value: Array) -> None:
        """Add ½ weight (D x + value)², where D is `stencil` (k,) over neighbouring frames.

        `weight` (broadcast) and `value` are (T − k + 1, n).
        """
        count = len(value)
        pull = weight * value
        for i, a in enumerate(stencil):
            self.downhill[i : i + count] -= a * pull
            for j, b in enumerate(stencil[: i + 1]):
                self.band[j : j + count, :, (i - j) * self.size] += a * b * weight

    def solved(self, known: int, damping: Array) -> Array:
        """x (T, n), its first `known` frames held at zero and `damping` (T, n) added to the diagonal.

        Good for one call: the band is factored in place.

        Raises numpy.linalg.LinAlgError where the matrix is not positive definite.
        """
        from scipy.linalg import solveh_banded

        band = self.band[known:].reshape(-1, self.band.shape[-1])  # leading columns are leading unknowns
        band[:, 0] += damping[known:].ravel()
        downhill = self.downhill[known:].ravel()
        x = solveh_banded(band.T, downhill, overwrite_ab=True, lower=True, check_finite=False)
        return np.concatenate([np.zeros((known, self.size)), x.reshape(-1, self.size)])
