"""Feet that stand beside each other, against MuJoCo's own distances between boxes."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from test_retarget_feet import standing_goals

from motiongen.rotation import Array
from retarget.contacts import Flags
from retarget.feet import BESIDE, pinned
from retarget.treads import kept_apart, tread_of

TREADS = np.array([[-0.04, -0.03], [0.09, 0.05]]), np.array([[-0.05, -0.05], [0.07, 0.02]])
BOXES = """<mujoco><worldbody>
<body name="one"><freejoint/><geom type="box" pos="0.025 0.01 0" size="0.065 0.04 1"/></body>
<body name="other"><freejoint/><geom type="box" pos="0.01 -0.015 0" size="0.06 0.035 1"/></body></worldbody></mujoco>"""


def apart(spots: tuple[Array, Array]) -> float:
    """Metres between boxes that stand on TREADS at `spots`, (x, y, yaw) each."""
    model = mujoco.MjModel.from_xml_string(BOXES)
    data = mujoco.MjData(model)
    data.qpos = np.concatenate([[x, y, 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)] for x, y, yaw in spots])
    mujoco.mj_kinematics(model, data)
    return mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)


@pytest.mark.parametrize("seed", range(20))
def test_feet_that_overlap_are_moved_to_the_gap_and_no_others(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, other = rng.uniform([-0.1, -0.1, -3], [0.1, 0.1, 3], (2, 3))
    gap = 0.01
    way = kept_apart(one, TREADS[0], other, TREADS[1], gap)
    before, after = apart((one, other)), apart((one + np.append(way, 0.0), other))
    assert after >= gap - 1e-6
    assert way.any() or before >= gap
    assert not way.any() or before < 2 * gap  # corner to corner they may be a little farther than any side tells
    if before < 0:
        assert after == pytest.approx(gap, abs=1e-5)
        assert np.linalg.norm(way) == pytest.approx(gap - before, abs=1e-5)


def test_what_a_foot_covers_is_what_can_touch() -> None:
    model = mujoco.MjModel.from_xml_string(BOXES)
    turned = np.array([np.cos(np.pi / 4), 0, 0, np.sin(np.pi / 4)])  # a quarter to the left: its x is the sole's y
    assert tread_of(model, 1, np.array([1.0, 0, 0, 0])) == pytest.approx(TREADS[0])
    assert tread_of(model, 1, turned) == pytest.approx(np.array([[-0.05, -0.04], [0.03, 0.09]]))
    model.geom_contype[0] = model.geom_conaffinity[0] = 0
    assert not tread_of(model, 1, turned).any()


@pytest.mark.parametrize(("late", "moves"), [("left_ankle", 1.0), ("right_ankle", 0.0), ("", 0.5)])
def test_of_two_feet_in_one_place_the_later_gives_way(late: str, moves: float) -> None:
    """Both are asked for the same spot; each covers 0.1 m to either side."""
    height, tread = 0.9, np.array([[-0.2, -0.1], [0.2, 0.1]])
    goals, rest = standing_goals(aside=0.0)
    rest = replace(rest, treads=dict.fromkeys(rest.treads, tread))
    flags: dict[str, Flags] = {foot: np.ones(len(goals[foot].pos), bool) for foot in goals}
    if late:
        flags[late][:10] = False
    out = pinned(goals, rest, flags, 50.0, height)
    way = 0.2 + BESIDE * height
    both = [abs(out[foot].pos[-1, 1]) for foot in ("left_ankle", "right_ankle")]
    assert both == pytest.approx([moves * way, (1 - moves) * way])
    assert np.ptp(out["left_ankle"].pos[10:], axis=0).max() < 1e-12
