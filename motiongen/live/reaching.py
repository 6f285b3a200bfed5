"""Wrists brought to where they are asked to be: the arm's two bones in closed form, over whatever was drawn.

The network hears the places too, but has learnt next to nothing of them. What it draws after an arm that was moved here
goes on from there, as that is the history it sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.features import FPS, TURNS, features_to_motion
from motiongen.live.steering import REACH_S
from motiongen.motion import SMPL_JOINTS, Skeleton
from motiongen.rotation import matrix_from_6d, matrix_to_6d, quat_to_matrix, shortest_arc

ARMS = tuple(
    tuple(SMPL_JOINTS.index(f"{side}_{n}") for n in ("shoulder", "elbow", "wrist")) for side in ("left", "right")
)
SLACK = 0.001  # m from an arm that is stretched, or folded, all the way
DOWN = np.array([-0.2, 0.0, -0.2])  # times the upper arm: where an elbow goes that could go anywhere

Array = NDArray[np.float64]
Place = tuple[float, float, float]


@dataclass(frozen=True)
class Hands:
    """Where the `left` and the `right` wrist shall be (see `Steer`), asked for `since` frames."""

    left: Place | None = None
    right: Place | None = None
    since: int = 0


def reached(features: Array, skeleton: Skeleton, hands: Hands) -> Array:
    """Features (T, 140) with the wrists led to their places as REACH_S goes by, and kept there; what is out of reach is
    pointed at with the arm stretched."""
    wanted = [(arm, np.array(place)) for arm, place in zip(ARMS, (hands.left, hands.right), strict=True) if place]
    if not wanted:
        return features
    out = np.array(features)
    level = np.array(features)
    level[:, :3] = 0.0  # where it stands still, heading and place are the world's
    at = features_to_motion(level, skeleton).positions()
    turn = matrix_from_6d(features[:, TURNS].reshape(len(features), -1, 6))
    u = np.minimum((hands.since + 1 + np.arange(len(features))) / (REACH_S * FPS), 1.0)[:, None]
    share = u**3 * (10 - 15 * u + 6 * u**2)
    for (shoulder, elbow, wrist), place in wanted:
        goal = at[:, wrist] + share * (place - at[:, wrist])
        bent = _bent(at[:, shoulder], at[:, elbow], at[:, wrist], goal)
        upper = shortest_arc(_unit(at[:, elbow] - at[:, shoulder]), _unit(bent - at[:, shoulder]))
        lower = shortest_arc(_unit(at[:, wrist] - at[:, elbow]), _unit(goal - bent))
        turn[:, shoulder] = quat_to_matrix(upper) @ turn[:, shoulder]
        for joint in (elbow, wrist):
            turn[:, joint] = quat_to_matrix(lower) @ turn[:, joint]
    out[:, TURNS] = matrix_to_6d(turn).reshape(len(features), -1)
    return out


def _bent(shoulder: Array, elbow: Array, wrist: Array, goal: Array) -> Array:
    """Where the elbow (T, 3) is when the wrist is at the goal, or as near as it gets: on the side where it was."""
    upper, lower, far = (_length(b - a) for a, b in ((shoulder, elbow), (elbow, wrist), (shoulder, goal)))
    way = _unit(goal - shoulder)
    far = np.clip(far, np.abs(upper - lower) + SLACK, upper + lower - SLACK)
    along = (upper**2 + far**2 - lower**2) / (2 * far)  # the law of cosines
    side = elbow - shoulder + DOWN * upper
    side = _unit(side - (side * way).sum(1, keepdims=True) * way)
    return shoulder + along * way + np.sqrt(upper**2 - along**2) * side


def _length(vectors: Array) -> Array:
    return np.linalg.norm(vectors, axis=1, keepdims=True)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(_length(vectors), SLACK)
