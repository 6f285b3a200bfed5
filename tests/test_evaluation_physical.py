"""Physical measures against motions whose figures are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motions import FORWARD, LEFT, motion, skeleton, walk

from motiongen.evaluation.physical import low_toes, measure_physics, summarise
from motiongen.motion import Motion
from motiongen.rotation import axis_angle_to_quat, quat_mul
from rigcast.pass_rate import pass_rate


def moved(clip: Motion, path: np.ndarray) -> Motion:
    return replace(clip, root_pos=clip.root_pos + path)


def standing(seconds: float = 2, fps: float = 30) -> Motion:
    return motion(seconds, fps, {}, "stand")


def test_standing_still_is_beyond_reproach() -> None:
    found = measure_physics(standing())
    assert (found.skate_ratio, found.skate_speed, found.jerk) == pytest.approx((0, 0, 0), abs=1e-6)
    assert (found.penetration, found.floating, found.broken) == (0, 0, "")


@pytest.mark.parametrize(("speed", "ratio"), [(0.19, 0.0), (0.21, 1.0)])
@pytest.mark.parametrize("fps", [20.0, 120.0])
def test_a_statue_that_glides_skates_at_every_frame_rate(speed: float, ratio: float, fps: float) -> None:
    clip = standing(fps=fps)
    found = measure_physics(moved(clip, np.arange(len(clip))[:, None] / fps * np.array([0, speed, 0])))
    assert found.skate_ratio == ratio
    assert found.skate_speed == pytest.approx(speed)


def test_a_toe_is_low_only_in_two_frames_that_follow() -> None:
    height = np.array([0.0, 0.0, 0.06, 0.0, 0.049])[:, None]
    planar = np.array([[0, 0], [3, 4], [3, 4], [3, 4], [3, 5]], float)[:, None]
    low, speed = low_toes(height, planar, fps=2.0)
    assert low[:, 0].tolist() == [True, False, False, True]
    assert speed[:, 0].tolist() == [10, 0, 0, 2]


@pytest.mark.parametrize("fps", [30.0, 100.0])
def test_jerk_of_a_cubic_is_its_third_derivative(fps: float) -> None:
    clip = standing(fps=fps)
    t = np.arange(len(clip)) / fps
    found = measure_physics(moved(clip, np.stack([0 * t, 5 * t**3, 0 * t], axis=1)))
    assert found.jerk == pytest.approx(30.0, rel=1e-6)


def test_heights_beyond_five_millimetres_count() -> None:
    clip, up = standing(), np.array([0, 0, 1.0])
    assert measure_physics(moved(clip, -0.03 * up)).penetration == pytest.approx(0.025)
    assert measure_physics(moved(clip, 0.03 * up)).floating == pytest.approx(0.025)
    near = measure_physics(moved(clip, 0.004 * up))
    assert (near.penetration, near.floating) == (0, 0)


def test_what_no_body_does_is_broken() -> None:
    clip = standing(fps=30)
    jump = np.zeros((len(clip), 3))
    jump[20:, 0] = 0.6  # m in a thirtieth of a second
    assert measure_physics(moved(clip, jump)).broken == "a body moves at 18.0 m/s"
    quat = clip.joint_quat.copy()
    quat[20:, 15] = axis_angle_to_quat(FORWARD, 1.5)
    assert measure_physics(replace(clip, joint_quat=quat)).broken == "a joint turns at 45 rad/s"
    aloft = np.zeros((len(clip), 3))
    aloft[10:39, 2] = 0.3
    assert measure_physics(moved(clip, aloft)).broken == ""
    aloft[39, 2] = 0.3
    assert measure_physics(moved(clip, aloft)).broken == "in the air for 1.0 s"


def test_planted_feet_of_a_walk_do_not_skate_but_a_treadmill_does() -> None:
    clip = walk(1.2)
    on_the_spot = replace(clip, root_pos=clip.root_pos * [0, 1, 1])
    planted, sliding = measure_physics(clip), measure_physics(on_the_spot)
    assert planted.skate_ratio is not None
    assert sliding.skate_ratio is not None
    assert planted.skate_ratio < 0.3 < 0.7 < sliding.skate_ratio


def test_a_single_frame_has_no_speed() -> None:
    found = measure_physics(Motion(np.array([[0, 0, 1.0]]), np.tile([1.0, 0, 0, 0], (1, 22, 1)), 30, skeleton()))
    assert (found.skate_ratio, found.skate_speed, found.jerk, found.broken) == (None, None, None, "")


def test_the_summary_is_the_mean_over_motions() -> None:
    clip = standing()
    aloft = moved(clip, np.array([0, 0, 0.3]))
    found = summarise([clip, aloft])
    assert found.floating == pytest.approx((0.295 / 2, 1.96 * (0.295 / 2) / np.sqrt(2)))
    assert found.broken == 0.5
    assert found.skate_ratio == (0, 0)  # of the one whose toes are ever low
    with pytest.raises(ValueError, match="no motions"):
        summarise([])


def test_the_gate_is_that_of_say() -> None:
    upright = standing(1)
    turns = upright.joint_quat.copy()
    turns[:, 0] = quat_mul(axis_angle_to_quat(LEFT, np.pi / 2), turns[:, 0])
    lying = replace(upright, joint_quat=turns, root_pos=upright.root_pos * [1, 1, 0.2])
    found = pass_rate([upright, lying], "puppet", mount="free")
    assert (found.motions, found.passed, found.rate, found.unreadable) == (2, 1, 0.5, ())
    assert "fall_tilt" in dict(found.failures)
    with pytest.raises(ValueError, match="no motions"):
        pass_rate([], "puppet")
