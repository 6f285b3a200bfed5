"""Springs that only push: where a sole is below the floor or two bodies are too near, by as much as is lacking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.rotation import Array
from retarget import sparse
from retarget.contacts import Flags
from retarget.kinematics import Indices
from retarget.paces import Paces
from retarget.sparse import Ways

SLIGHT = 0.1  # of a gap, or of what a joint may do: a spring that is out by less is not asked again


@dataclass(frozen=True)
class Springs:
    """n springs, `stiff` (1/m²) each: with `room` (n,) metres in its `frame` (n,), below 0 where it pushes, and `rows`
    (n, nv) more for a unit rate of each degree of freedom. One that is out by `slight` m is not asked again.
    """

    frame: Indices
    rows: Array
    room: Array
    stiff: float
    slight: float

    def and_those(self, more: Springs) -> Springs:
        """Both."""
        frame, rows, room = (
            np.concatenate([getattr(s, part) for s in (self, more)]) for part in ("frame", "rows", "room")
        )
        return Springs(frame, rows, room, self.stiff, self.slight)

    def after(self, step: Array) -> Springs:
        """The same after `step` (T, nv) of the configurations, all as linear as here."""
        room = sparse.after(self.frame, self.rows, self.room, step)
        return Springs(self.frame, self.rows, room, self.stiff, self.slight)

    def added(self, curvature: Array, gradient: Array, pushing: Flags) -> tuple[Array, Array]:
        """The lower half of the curvature (T, nv, nv) and the gradient (T, nv) with ½ `stiff` (row · x + room)² more
        for each spring that is `pushing` (n,), in its frame.
        """
        if not pushing.any():
            return curvature, gradient
        curvature, gradient = curvature.copy(), gradient.copy()
        sparse.add_springs(curvature, gradient, self.frame, self.rows, self.room, pushing, self.stiff)
        return curvature, gradient


@dataclass(frozen=True)
class Pushes:
    """All that only pushes: `springs`, and the `paces` of joints."""

    springs: Springs
    paces: Paces

    def after(self, step: Array) -> Pushes:
        """The same after `step` (T, nv) of the configurations, all as linear as here."""
        return Pushes(self.springs.after(step), self.paces.after(step))

    def pushing(self) -> tuple[Flags, Ways]:
        """Which of both push."""
        return self.springs.room < 0, self.paces.hasty()

    def amiss(self, pushing: tuple[Flags, Ways]) -> bool:
        """Whether some push, or would have to pull, that do not as `pushing` says, by more than a little."""
        wrong = self.springs.room[(self.springs.room < 0) != pushing[0]]
        return bool((np.abs(wrong) > self.springs.slight).any()) or self.paces.amiss(pushing[1], SLIGHT)

    def strain(self, pushing: tuple[Flags, Ways]) -> float:
        """What those cost that are `pushing`."""
        room = self.springs.room[pushing[0]]
        return self.springs.stiff * float(room @ room) + self.paces.strain(pushing[1])
