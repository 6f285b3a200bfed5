"""Springs that hold joints back: where one goes farther or faster than it may, or gets faster or slower too soon."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.rotation import Array
from retarget.banded import FIRST, SECOND, Equations
from retarget.loops import ROOT

# How stiff they are, in 1/rad², against joints and their first and second differences; what is left `limits.py` cuts off.
STIFF = 1e4, 100.0, 1000.0
STENCILS = np.ones(1), FIRST, SECOND

Ways = tuple[Array, ...]  # for each of STENCILS 1 or −1 where a joint goes too far or fast that way, else 0


@dataclass(frozen=True)
class Paces:
    """`values`: how far joints are from the middle of their range, (T, nj) rad, and the first and second differences of
    that; `most`: how great each may be, (nj,) rad.
    """

    values: tuple[Array, ...]
    most: tuple[Array, ...]

    def after(self, step: Array) -> Paces:
        """The same after `step` (T, nv) of the configurations."""
        joints = step[:, ROOT:]
        return Paces(tuple(v + np.diff(joints, n=n, axis=0) for n, v in enumerate(self.values)), self.most)

    def hasty(self) -> Ways:
        """Where a joint goes too far or fast, and which way."""
        return tuple(np.sign(v) * (np.abs(v) > m) for v, m in zip(self.values, self.most, strict=True))

    def amiss(self, ways: Ways, share: float) -> bool:
        """Whether springs push by more than `share` of what may be, or pull, which are not those of `ways`."""
        now = self.hasty()
        excess = self._excess(tuple(n - w for n, w in zip(now, ways, strict=True)))
        return any((np.abs(e) > share * m).any() for e, m in zip(excess, self.most, strict=True))

    def strain(self, ways: Ways) -> float:
        """What the springs of `ways` cost."""
        return float(sum(stiff * (e**2).sum() for stiff, e in zip(STIFF, self._excess(ways), strict=True)))

    def hold(self, equations: Equations, ways: Ways) -> None:
        """Add the springs of `ways` to the equations of the next step."""
        for stencil, stiff, way, excess in zip(STENCILS, STIFF, ways, self._excess(ways), strict=True):
            if way.any():
                equations.add_differences(stencil, stiff * np.abs(way), excess, ROOT)

    def _excess(self, ways: Ways) -> tuple[Array, ...]:
        """Rad by which joints go farther or faster than they may the way that `ways` has them go; 0 elsewhere."""
        return tuple(np.abs(w) * v - w * m for w, v, m in zip(ways, self.values, self.most, strict=True))
