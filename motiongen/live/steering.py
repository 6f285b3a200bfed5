"""Where to go, beside what to do: twelve numbers a frame that a live network hears, each group of them or not.

| columns | what | unit |
|---|---|---|
| 0:3 | yaw rate and planar velocity of the pelvis, without the sway of the strides | normalised as the features are |
| 3 | whether they are given | 0 or 1 |
| 4:7, 8:11 | left and right wrist in the heading frame, from below the pelvis at the height of the floor | 0.5 m |
| 7, 11 | whether it is given | 0 or 1 |
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.weights import Weights
from motiongen.features import FPS, PLANAR, YAW
from motiongen.generator import PromptError
from motiongen.motion import SMPL_JOINTS
from motiongen.nn import Floats

WIDTH = 12
ROOT, ROOT_GIVEN = slice(0, 3), 3
HANDS = (slice(4, 7), slice(8, 11))
HANDS_GIVEN = (7, 11)
WRISTS = [SMPL_JOINTS.index(f"{side}_wrist") for side in ("left", "right")]
METRES = 0.5  # that a wrist's numbers count in
SWAY = 21  # frames over which speed and turn are averaged: a stride

FASTEST = 4.0  # m/s, of a run
QUICKEST = 1.5  # rad/s, of a turn in walking
TURN_S = 0.7  # s in which most of a turn is made
AHEAD = 0.6  # m on the path where the way goes to
STROLL = 0.9  # m/s along a path, where nobody says how fast
ARRIVED = 0.15  # m
REACH_S = 0.6  # s that a hand has to get to its place
ARM = 0.9  # m from the middle of the shoulders that no wrist gets beyond
SHOULDERS = 1.35  # m over the floor, of a standing adult

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Area:
    """The floor that may be walked on, in metres: from `low` to `high` in x and y of the world."""

    low: tuple[float, float]
    high: tuple[float, float]

    def holds(self, at: Array) -> bool:
        """Whether a place (2,) lies within."""
        return bool((at >= np.array(self.low)).all() and (at <= np.array(self.high)).all())

    def __str__(self) -> str:
        return f"x {self.low[0]:g}…{self.high[0]:g} m, y {self.low[1]:g}…{self.high[1]:g} m"


@dataclass(frozen=True)
class Steer:
    """What is wanted beside the text; None: as the text says.

    `speed` m/s forward; `heading` rad in the world; `path` (N, 2) m in the world, walked to its end at `speed` and
    then stood still at, with no `heading` beside it; `left_hand`, `right_hand` (3,) m of the wrist in the heading
    frame: forward and left of the pelvis, above the floor.

    Raises PromptError naming what is out of range.
    """

    speed: float | None = None
    heading: float | None = None
    path: tuple[tuple[float, float], ...] = ()
    left_hand: tuple[float, float, float] | None = None
    right_hand: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        numbers = [self.speed or 0.0, self.heading or 0.0, *np.ravel(self.path), *(self.left_hand or ())]
        if not np.isfinite([*numbers, *(self.right_hand or ())]).all():
            raise PromptError(f"steering must be in finite numbers, not {self}")
        if self.speed is not None and not 0 <= self.speed <= FASTEST:
            raise PromptError(f"speed {self.speed:g} m/s; between 0 and {FASTEST:g} are possible")
        if self.path and self.heading is not None:
            raise PromptError("a path says where to head; give a path or a heading")
        for side, hand in (("left", self.left_hand), ("right", self.right_hand)):
            if hand is not None and (far := math.dist(hand, (0.0, 0.0, SHOULDERS))) > ARM:
                raise PromptError(f"{side}_hand {hand}: {far:.2f} m from between the shoulders, at most {ARM:g}")

    @property
    def moves_root(self) -> bool:
        return self.speed is not None or self.heading is not None or bool(self.path)

    def require_within(self, area: Area | None) -> None:
        """Raises PromptError where the path leaves the `area`."""
        if area is not None:
            for x, y in self.path:
                if not area.holds(np.array([x, y])):
                    raise PromptError(f"the path leaves the floor at ({x:g}, {y:g}) m; it is allowed within {area}")


def signals(model: Weights, steer: Steer, heading: float, place: Array, cruise: float, since: int) -> Floats:
    """(H + C, 12) for a chunk that begins at a `heading` in rad and a `place` (2,) in m of the world.

    `cruise` m/s is the speed so far, kept where a heading alone is asked for; the hands were asked for `since` frames.
    """
    history = int(model.sizes["history"])
    out = np.zeros((model.window, WIDTH), np.float32)
    told = out[history:]
    if steer.moves_root:
        root = _root(steer, heading, place, cruise, len(told))
        columns = [YAW, *range(PLANAR.start, PLANAR.stop)]
        told[:, ROOT] = (root - model.mean[columns]) / model.std[columns]
        told[:, ROOT_GIVEN] = 1.0
    reached = np.arange(len(told)) + since >= REACH_S * FPS
    for hand, place_at, flag in zip((steer.left_hand, steer.right_hand), HANDS, HANDS_GIVEN, strict=True):
        if hand is not None:
            told[reached, place_at] = np.array(hand) / METRES
            told[reached, flag] = 1.0
    return out


def _root(steer: Steer, heading: float, place: Array, cruise: float, count: int) -> Array:
    """(count, 3) yaw rate in rad/s and planar velocity in m/s: the turn is made like a spring that does not swing."""
    speed = cruise if steer.speed is None else steer.speed
    wanted = steer.heading
    if steer.path:
        way = _way(np.array(steer.path), place)
        left = float(np.linalg.norm(np.array(steer.path[-1]) - place))
        speed = min(STROLL if steer.speed is None else steer.speed, left / TURN_S) if left > ARRIVED else 0.0
        wanted = math.atan2(way[1], way[0]) if left > ARRIVED else None
    out = np.zeros((count, 3))
    off = 0.0 if wanted is None else math.remainder(wanted - heading, math.tau)
    for row in out:
        row[0] = np.clip(off / TURN_S, -QUICKEST, QUICKEST)
        row[1] = speed * max(0.0, math.cos(off))
        off -= row[0] / FPS
    return out


def _way(path: Array, place: Array) -> Array:
    """Vector (2,) from `place` to the point of the path that lies a little ahead of the nearest one ("pure pursuit",
    Coulter 1992)."""
    points = np.concatenate([place[None], path]) if len(path) == 1 else path
    dense = np.concatenate([a + np.linspace(0, 1, 33)[:, None] * (b - a) for a, b in pairwise(points)])
    near = int(np.linalg.norm(dense - place, axis=1).argmin())
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(dense[near:], axis=0), axis=1))])
    return dense[near + min(int(np.searchsorted(gone, AHEAD)), len(gone) - 1)] - place
