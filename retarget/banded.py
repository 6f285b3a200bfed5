"""Normal equations of a trajectory: a block for every frame, and diagonal blocks between frames up to three apart.

Stored as LAPACK's lower band, `band[t, j, d]` = A[n t + j + d, n t + j], so that every frame costs the same.
"""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array

REACH = 3  # frames: a third difference spans four
THIRD = np.array([-1.0, 3.0, -3.0, 1.0])
FIRST = np.array([-1.0, 1.0])


class Equations:
    """A x = right, A symmetric and positive definite, for x (T, n): what the methods add is a sum of squares."""

    def __init__(self, frames: int, size: int) -> None:
        self.frames, self.size = frames, size
        self.band = np.zeros((frames, size, REACH * size + 1))
        self.right = np.zeros((frames, size))

    def blocks(self, blocks: Array) -> None:
        """Add `blocks` (T, n, n), symmetric, each to its frame's own."""
        for j in range(self.size):
            self.band[:, j, : self.size - j] += blocks[:, j:, j]

    def diagonal(self, weight: Array, gradient: Array) -> None:
        """Add ½ weight x² + gradient x, both (T, n)."""
        self.band[..., 0] += weight
        self.right -= gradient

    def differences(self, stencil: Array, weight: Array, value: Array) -> None:
        """Add ½ weight (D x)² + weight value (D x), where D is `stencil` (k,) over neighbouring frames.

        `weight` and `value` are (T − k + 1, n).
        """
        count = len(weight)
        for i, a in enumerate(stencil):
            self.right[i : i + count] -= a * weight * value
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
        right = self.right[known:].ravel()
        x = solveh_banded(band.T, right, overwrite_ab=True, lower=True, check_finite=False)
        return np.concatenate([np.zeros((known, self.size)), x.reshape(-1, self.size)])
