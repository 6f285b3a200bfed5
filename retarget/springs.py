"""Springs that only push: where a sole is below the floor or two bodies are too near, by as much as is lacking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.rotation import Array
from retarget import loops
from retarget.loops import Flags, Indices


@dataclass(frozen=True)
class Springs:
    """n springs of one stiffness: each has `room` (n,) metres in its `frame` (n,), below 0 where it pushes, and `rows`
    (n, nv) more for a unit rate of each degree of freedom.
    """

    frame: Indices
    rows: Array
    room: Array

    def after(self, step: Array) -> Springs:
        """The same after `step` (T, nv) of the configurations, all as linear as here."""
        return Springs(self.frame, self.rows, loops.after(self.frame, self.rows, self.room, step))

    def and_those(self, more: Springs) -> Springs:
        """Both."""
        return Springs(*(np.concatenate([getattr(s, part) for s in (self, more)]) for part in ("frame", "rows", "room")))

    def added(self, curvature: Array, gradient: Array, pushing: Flags, stiff: float) -> tuple[Array, Array]:
        """The lower half of the curvature (T, nv, nv) and the gradient (T, nv) with ½ `stiff` (row · x + room)² more
        for each spring that is `pushing` (n,), in its frame.
        """
        if not pushing.any():
            return curvature, gradient
        curvature, gradient = curvature.copy(), gradient.copy()
        loops.add_springs(curvature, gradient, self.frame, self.rows, self.room, pushing, stiff)
        return curvature, gradient
