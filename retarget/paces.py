"""Springs that hold joints back: where one goes farther or faster than it may, or gets faster or slower too soon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.rotation import Array
from retarget import sparse
from retarget.banded import Equations
from retarget.sparse import ROOT, Ways

# In 1/rad², against joints and their first and second differences; what is left `limits.py` cuts off.
STIFF = np.array([1e4, 1e4, 1e4])


@dataclass(frozen=True)
class Paces:
    """`values` (3, T, nj) rad: how far joints are from the middle of their range, and the first and second differences
    of that from each frame on (0 where none follows); `most` (3, nj): how great each may be.
    """

    values: Array
    most: Array

    def after(self, step: Array) -> Paces:
        """The same after `step` (T, nv) of the configurations."""
        return Paces(sparse.paced(self.values, step[:, ROOT:]), self.most)

    def hasty(self) -> Ways:
        """(3, T, nj): 1 or −1 where a joint goes too far or fast, that way; else 0."""
        return sparse.hasty(self.values, self.most)

    def amiss(self, ways: Ways, share: float) -> bool:
        """Whether springs push by more than `share` of what may be, or pull, which are not those of `ways`."""
        return sparse.amiss(self.values, self.most, ways, share)

    def strain(self, ways: Ways) -> float:
        """What the springs of `ways` cost."""
        return sparse.strain(self.values, self.most, ways, STIFF)

    def hold(self, equations: Equations, ways: Ways) -> None:
        """Add the springs of `ways` to the equations of the next step."""
        sparse.hold(equations.across, equations.downhill, self.values, self.most, ways, STIFF)


def paces_of(joints: Array, most: Array) -> Paces:
    """Of `joints` (T, nj) rad from the middle of their range."""
    return Paces(sparse.paced(np.zeros((3, *joints.shape)), joints), most)
