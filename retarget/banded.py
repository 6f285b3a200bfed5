"""Linear equations over the frames of a trajectory in which each frame is tied to the next two only.

Banded Cholesky factorisation solves them in time that grows with the number of frames, not with its cube. Memory is in
LAPACK's lower band, `band[n t + j, d]` = A[n t + j + d, n t + j].
"""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array
from retarget import sparse

REACH = 2  # frames: a second difference spans three
SECOND = np.array([1.0, -2.0, 1.0])
FIRST = np.array([-1.0, 1.0])


class Equations:
    """The x (T, n) that minimises a sum of squares: each frame's own, and those of differences between frames."""

    def __init__(self, curvature: Array, gradient: Array) -> None:
        """Start with each frame's ½ xᵀ `curvature` x + `gradient` x: (T, n, n), its lower half, and (T, n)."""
        frames, size = gradient.shape
        self.curvature = curvature
        self.across = np.zeros((frames, REACH + 1, size))  # what ties an unknown to itself, so many frames on
        self.downhill = -gradient

    def add_differences(self, stencil: Array, weight: Array, value: Array) -> None:
        """Add ½ weight (D x + value)², where D is `stencil` (k,) over neighbouring frames.

        `value` is (T − k + 1, n), and so is `weight`, or (n,) or (1,) where it is the same in all frames.
        """
        each = np.atleast_2d(weight)
        each = np.ascontiguousarray(np.broadcast_to(each, (len(each), value.shape[1])))
        sparse.add_differences(self.across, self.downhill, stencil, each, value)

    def solved(self, known: int, damping: Array) -> Array:
        """x (T, n), its first `known` frames held at zero and `damping` (T, n) added to the diagonal.

        Unknowns that nothing ties to the others, as the joints of an arm that touches nothing, are solved for apart:
        the band is as much narrower. Raises numpy.linalg.LinAlgError where the matrix is not positive definite.
        """
        from scipy.linalg.lapack import dpbsv

        x = np.zeros_like(self.downhill)
        parts = sparse.parts(self.curvature)
        for first in np.unique(parts):
            part = np.flatnonzero(parts == first)
            band = sparse.band_of(self.curvature, self.across, damping, known, part)
            _, found, wrong = dpbsv(band.T, self.downhill[known:, part].ravel(), lower=1, overwrite_ab=1, overwrite_b=1)
            if wrong:
                raise np.linalg.LinAlgError(f"the equations of {len(x)} frames are not positive definite")
            x[known:, part] = found.reshape(-1, len(part))
        return x
