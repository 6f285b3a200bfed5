"""Springs that only push: where a sole is below the floor or two bodies are too near, by as much as is lacking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.rotation import Array
from retarget.contacts import Flags
from retarget.kinematics import Indices


@dataclass(frozen=True)
class Springs:
    """n springs of one stiffness, in the order of their `frame` (n,): each has `room` (n,) metres, below 0 where it
    pushes, and `rows` (n, nv) more for a unit rate of each degree of freedom.
    """

    frame: Indices
    rows: Array
    room: Array

    def after(self, step: Array) -> Array:
        """(n,) metres of room after `step` (T, nv)."""
        return self.room + np.einsum("nv,nv->n", self.rows, step[self.frame])

    def of(self, which: Flags) -> Springs:
        """Those where `which` (n,) is set."""
        return Springs(self.frame[which], self.rows[which], self.room[which])

    def and_those(self, more: Springs) -> Springs:
        """Both in the order of their frames."""
        frame = np.concatenate([self.frame, more.frame])
        order = np.argsort(frame, kind="stable")
        rows, room = np.concatenate([self.rows, more.rows]), np.concatenate([self.room, more.room])
        return Springs(frame[order], rows[order], room[order])


def add_springs(curvature: Array, gradient: Array, springs: Springs, stiff: float) -> None:
    """Add ½ `stiff` (row · x + room)² for each of `springs` to the curvature (T, nv, nv) and the gradient (T, nv) of
    its frame.
    """
    if not len(springs.frame):
        return
    those, first, count = np.unique(springs.frame, return_index=True, return_counts=True)
    group, slot = np.repeat(np.arange(len(those)), count), np.arange(len(springs.frame)) - np.repeat(first, count)
    dense = np.zeros((len(those), gradient.shape[1], count.max()))
    dense[group, :, slot] = springs.rows
    curvature[those] += stiff * dense @ dense.swapaxes(1, 2)
    forces = np.zeros((len(those), count.max(), 1))
    forces[group, slot, 0] = springs.room
    gradient[those] += stiff * (dense @ forces)[..., 0]
