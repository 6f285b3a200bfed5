"""When human feet stand, and where the feet of a rig are asked to be."""

from __future__ import annotations

from dataclasses import replace

import motions
import numpy as np
import pytest

from retarget.contacts import planted
from retarget.feet import CLEARANCE, pinned
from retarget.goals import Goal
from retarget.rest import Rest
from retarget.rig import load_rig


def test_contacts_are_found_where_the_walk_has_them() -> None:
    """The left foot of the synthetic walk stands while the phase is in [0, 0.55) of each second."""
    clip = motions.walk()
    phase = (np.arange(len(clip)) / clip.fps) % 1.0
    found = planted(clip)["left_ankle"]
    assert found[(phase > 0.05) & (phase < 0.50)].all()
    assert not found[(phase > 0.68) & (phase < 0.88)].any()


def standing_goals(aside: float) -> tuple[dict[str, Goal], Rest]:
    """Of 50 frames in which both feet stand at x = 0, `aside` m to the left and to the right."""
    sole = np.array([[-0.05, 0.0, -0.08], [0.15, 0.0, -0.08]])
    upright, feet = np.array([1.0, 0, 0, 0]), ("left_ankle", "right_ankle")
    rest = Rest(*(dict.fromkeys(feet, part) for part in (np.zeros(3), upright, sole, np.zeros((2, 2)))))
    goals = {}
    for foot, side in zip(feet, (1.0, -1.0), strict=True):
        follow = next(f for f in load_rig("humanoid").follow if f.human == foot)
        at = np.tile([0.0, side * aside, 0.08], (50, 1))
        goals[foot] = Goal(follow, "", at, np.tile(upright, (50, 1)), np.ones(50))
    return goals, rest


def test_a_foot_that_passes_the_other_clears_the_floor() -> None:
    """The left foot stands, the right one slides past it at 1 m/s along the floor: the goal lifts it, and it alone."""
    count, fps, height = 50, 50.0, 0.9
    goals, rest = standing_goals(aside=0.1)
    still = goals["left_ankle"].pos
    sliding = np.stack([np.arange(count) / fps, np.full(count, -0.1), np.full(count, 0.08)], axis=1)
    goals["right_ankle"] = replace(goals["right_ankle"], pos=sliding)
    flags = {"left_ankle": np.ones(count, bool), "right_ankle": np.zeros(count, bool)}
    out = pinned(goals, rest, flags, fps, height)
    assert out["right_ankle"].pos[:, 2] == pytest.approx(0.08 + CLEARANCE * height)
    assert out["left_ankle"].pos == pytest.approx(still)
    both_still = pinned(goals | {"right_ankle": replace(goals["right_ankle"], pos=still)}, rest, flags, fps, height)
    assert both_still["right_ankle"].pos[:, 2] == pytest.approx(0.08)
