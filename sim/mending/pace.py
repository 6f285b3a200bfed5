"""When things happen in the mended motion: never two feet in the air, and time enough for every step and servo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array
from sim.mending.steps import BOTH, REST, SWING, Steps

SMOOTH = 0.06  # s over which a change of pace is spread
HURRIED = 0.8  # of the time that steps should have, where else they would take too long


@dataclass(frozen=True)
class Pace:
    """`at` (T',): the frame (fractional) of the motion that is shown in each frame of the mended one. `marks`
    (2 n + 2,): its first and last frame, and in between those in which each of n swings begins and ends.
    """

    at: Array
    marks: Array

    @property
    def swings(self) -> list[tuple[int, int]]:
        """First frame and last (exclusive) of each swing."""
        return list(zip(self.marks[1:-1:2].astype(int).tolist(), self.marks[2:-1:2].astype(int).tolist(), strict=True))


def find_pace(steps: Steps, drawn: Array, beat: float, fps: float) -> Pace:
    """The pace at which `steps` can be trodden; `drawn` (2 n + 1,) is by how much the time before, in, between and
    after the n swings is drawn out for other reasons, 1 where it is not.
    """
    from scipy.ndimage import gaussian_filter1d

    keys = _keys(steps)
    marks = np.concatenate([[0.0], keys, [max(steps.frames - 1, keys[-1:].sum() + 1)]])
    least = np.zeros(len(marks) - 1)
    if len(keys):
        least[1::2], least[2::2] = SWING, BOTH
        least[0] = least[-1] = REST
    lasts = np.maximum(np.diff(marks), least * beat * fps) * drawn
    then = np.rint(np.concatenate([[0.0], np.cumsum(lasts)]))
    at = np.interp(np.arange(int(then[-1]) + 1), then, marks)
    around = min(round(4 * SMOOTH * fps), len(at) - 1)
    padded = np.pad(at, around, mode="reflect", reflect_type="odd")  # so that the ends stay where they are
    at = gaussian_filter1d(padded, SMOOTH * fps)[around : around + len(at)]
    return Pace(np.clip(at, 0, steps.frames - 1), then)


def hurried(steps: Steps, beat: float, fps: float, longest: float) -> float:
    """By how much `steps` are to be drawn out so that they take no more than `longest` frames: 1 or a little less."""
    lasts = float(find_pace(steps, np.ones(2 * len(steps.swings) + 1), beat, fps).marks[-1])
    return float(np.clip(longest / lasts, HURRIED, 1.0))


def segments(pace: Pace) -> NDArray[np.intp]:
    """(T',) which of the 2 n + 1 stretches of time each frame is in."""
    return np.searchsorted(pace.marks[1:-1], np.arange(len(pace.at)), side="right")


def _keys(steps: Steps) -> Array:
    """(2 n,) rising frames at which feet leave and reach the floor: a flight is halved between its two swings."""
    keys = [0.0]
    for swing in steps.swings:
        start, end = float(swing.start), float(swing.end)
        if start <= keys[-1]:
            start = 0.5 * (start + keys[-1])
            keys[-1] = max(start, keys[-2] + 1) if len(keys) > 1 else 0.0
        start = max(start, keys[-1] + 1)
        keys += [start, max(end, start + 1)]
    return np.array(keys[1:])
