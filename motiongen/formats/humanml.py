"""HumanML3D's 263 and KIT-ML's 251 features a frame, from joint positions and back, by the data sets' own rule.

Coordinates in here are the data sets': y up, facing +z, HumanML3D in metres. Rows of features for J joints:

| columns | what |
|---|---|
| 0 | half the yaw from this frame to the next, rad (the arcsine of the quaternion's y) |
| 1:3 | displacement of the root to the next frame along x and z, in the next frame's heading |
| 3 | height of the root |
| 3(J-1) more | the other joints: x and z from the root, absolute y, in this frame's heading |
| 6(J-1) more | rotations: 6-d form of the shortest arcs along each chain, which leave the twist of a bone free |
| 3J more | displacement of every joint to the next frame, in this frame's heading |
| 4 more | contacts: left ankle, left toe, right ankle, right toe |

T frames of positions give T - 1 rows. Rule: Guo et al. 2022, "Generating Diverse and Natural 3D Human Motions from
Text", and the data set's published sample, against which the tests hold it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from motiongen.rotation import (
    Array,
    matrix_to_6d,
    quat_conj,
    quat_mul,
    quat_rotate,
    quat_to_matrix,
    shortest_arc,
    yaw_quat,
)

SMOOTHING = 20.0  # frames: standard deviation of the Gaussian over the heading, cut at four of them
_LEFT, _UP, _FRONT = np.eye(3)
_SIDES = {"+x": _LEFT, "-x": -_LEFT, "+y": _UP, "-y": -_UP, "+z": _FRONT}


@dataclass(frozen=True)
class Layout:
    """A data set's joints. `chains`: joint rows from the root outwards. `directions`: where each joint lies from its
    parent in the pose of no rotation. `across`: pairs of joints (from, to) whose sum points from right to left as the
    data set has it. `feet`: left ankle, left toe, right ankle, right toe. `still`: squared displacement a frame, in the
    data set's unit of length, below which a foot is in contact.
    """

    name: str
    fps: float
    chains: tuple[tuple[int, ...], ...]
    directions: tuple[str, ...]
    across: tuple[tuple[int, int], tuple[int, int]]
    feet: tuple[int, int, int, int]
    still: float

    @property
    def joints(self) -> int:
        return len(self.directions) + 1

    @property
    def width(self) -> int:
        """Numbers a frame: 12 J - 1."""
        return 12 * self.joints - 1

    @property
    def places(self) -> slice:
        """Columns of the joint positions."""
        return slice(4, 4 + 3 * (self.joints - 1))


HUMANML3D = Layout(
    name="HumanML3D",
    fps=20.0,
    chains=((0, 2, 5, 8, 11), (0, 1, 4, 7, 10), (0, 3, 6, 9, 12, 15), (9, 14, 17, 19, 21), (9, 13, 16, 18, 20)),
    directions=(
        "+x", "-x", "+y", "-y", "-y", "+y", "-y", "-y", "+y", "+z", "+z", "+y", "+x", "-x", "+z", "-y", "-y", "-y",
        "-y", "-y", "-y",
    ),
    across=((2, 1), (16, 17)),  # hips right to left, but shoulders left to right: the slip is the data set's
    feet=(7, 10, 8, 11),
    still=0.002,
)  # fmt: skip
KIT_ML = Layout(
    name="KIT-ML",
    fps=12.5,
    chains=((0, 11, 12, 13, 14, 15), (0, 16, 17, 18, 19, 20), (0, 1, 2, 3, 4), (3, 5, 6, 7), (3, 8, 9, 10)),
    directions=(
        "+y", "+y", "+y", "+y", "+x", "-y", "-y", "-x", "-y", "-y", "+x", "-y", "-y", "+z", "+z", "-x", "-y", "-y",
        "+z", "+z",
    ),
    across=((11, 16), (8, 5)),
    feet=(19, 20, 14, 15),
    still=0.05,
)  # fmt: skip
LAYOUTS = {layout.width: layout for layout in (HUMANML3D, KIT_ML)}


def facing_front(where: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    """Positions (T, J, 3), z up, moved and turned as both data sets begin: the root over the origin, facing +x in the
    first frame, the clip's lowest joint on the floor. `pairs`: rows of joints, left and right, that tell the heading.
    """
    left = np.sum([where[0, a] - where[0, b] for a, b in pairs], axis=0)
    where = quat_rotate(yaw_quat(np.arctan2(left[0], left[1])), where)
    return where - [where[0, 0, 0], where[0, 0, 1], where[..., 2].min()]


def positions_to_features(positions: ArrayLike, layout: Layout = HUMANML3D) -> Array:
    """Features (T - 1, 12 J - 1) of joint positions (T, J, 3) that start at the origin, facing +z, on the floor.

    Raises ValueError where the shape is another, there are under two frames, a number is not finite, or two joined
    joints fall together.
    """
    where = np.asarray(positions, float)
    if where.ndim != 3 or where.shape[1:] != (layout.joints, 3) or len(where) < 2:
        raise ValueError(f"{layout.name} needs positions (T ≥ 2, {layout.joints}, 3), not {where.shape}")
    _require_finite(where)
    level = _headings(where, layout)
    step = np.diff(where, axis=0)
    yaw = quat_mul(level[1:], quat_conj(level[:-1]))
    root = quat_rotate(level[1:], step[:, 0])
    from_root = where - where[:, :1] * (_LEFT + _FRONT)
    place = quat_rotate(level[:, None], from_root)[:-1, 1:]
    turns = matrix_to_6d(quat_to_matrix(_chain_rotations(where, level, layout)[:-1, 1:]))
    speed = quat_rotate(level[:-1, None], step)
    touching = (step[:, layout.feet] ** 2).sum(-1) < layout.still
    rows = len(step)
    columns = [np.arcsin(yaw[:, 2:3]), root[:, [0, 2]], where[:-1, 0, 1:2], place, turns, speed, touching]
    return np.hstack([c.reshape(rows, -1) for c in columns])


def features_to_positions(features: ArrayLike) -> Array:
    """Joint positions (T, J, 3) of HumanML3D (T, 263) or KIT-ML (T, 251) features, from the origin, facing +z.

    Uses the root and position columns, which say all; raises ValueError on another width, no rows or NaN.
    """
    rows = np.asarray(features, float)
    if rows.ndim != 2 or rows.shape[1] not in LAYOUTS or not len(rows):
        known = " or ".join(f"(T, {w}) of {layout.name}" for w, layout in LAYOUTS.items())
        raise ValueError(f"features {rows.shape}, expected {known}")
    _require_finite(rows)
    layout = LAYOUTS[rows.shape[1]]
    half = np.concatenate([[0.0], np.cumsum(rows[:-1, 0])])
    back = np.stack([np.cos(half), 0 * half, -np.sin(half), 0 * half], axis=1)  # heading frame to world
    step = np.zeros((len(rows), 3))
    step[1:, [0, 2]] = rows[:-1, 1:3]
    root = np.cumsum(quat_rotate(back, step), axis=0)
    others = quat_rotate(back[:, None], rows[:, layout.places].reshape(len(rows), -1, 3)) + root[:, None]
    root[:, 1] = rows[:, 3]
    return np.concatenate([root[:, None], others], axis=1)


def _headings(where: Array, layout: Layout) -> Array:
    """Rotation (T, 4) of each frame that turns its smoothed forward direction to +z; the identity in frame 0."""
    across = np.sum([where[:, b] - where[:, a] for a, b in layout.across], axis=0)
    forward = _smooth(np.cross(_UP, _unit(across)))
    forward[:, 1] = 0.0
    level = shortest_arc(_unit(forward), _FRONT)
    level[0] = (1.0, 0.0, 0.0, 0.0)
    return level


def _smooth(values: Array) -> Array:
    """Gaussian over axis 0 of (T, n), the ends held."""
    reach = round(4 * SMOOTHING)
    weight = np.exp(-0.5 * (np.arange(-reach, reach + 1) / SMOOTHING) ** 2)
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
    return np.stack([np.convolve(c, weight / weight.sum(), mode="valid") for c in padded.T], axis=1)


def _chain_rotations(where: Array, level: Array, layout: Layout) -> Array:
    """Rotation (T, J, 4) of each joint relative to the one before it in its chain; every chain starts at the root's."""
    out = np.zeros((*where.shape[:2], 4))
    out[:, 0] = level
    for chain in layout.chains:
        before = level
        for a, b in pairwise(chain):
            turn = shortest_arc(_SIDES[layout.directions[b - 1]], _unit(where[:, b] - where[:, a]))
            out[:, b] = quat_mul(quat_conj(before), turn)
            before = turn
    return out


def _unit(v: Array) -> Array:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    if (length < 1e-9).any():
        raise ValueError(f"frame {int((length[..., 0] < 1e-9).argmax())}: a bone or the heading has no length")
    return v / length


def _require_finite(values: Array) -> None:
    fine = np.isfinite(values.reshape(len(values), -1)).all(1)
    if not fine.all():
        raise ValueError(f"frame {int(fine.argmin())} holds NaN or infinity")
