"""From rest to rest: how a solved motion is led in, run and smoothed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from retarget.timeline import ease, plan, smoothed, stretch


def test_minimum_jerk_takes_the_time_that_the_slowest_joint_needs() -> None:
    nominal, pose = np.zeros(2), np.array([1.0, 0.5])
    velocity = np.array([2.0, 0.5])
    timeline = plan(pose, nominal, nominal, velocity, 10, 100.0)
    assert timeline.lead == np.ceil(15 / 8 * 0.5 / 0.5 * 100)  # peak speed 15/8 of the mean (Flash and Hogan 1985)
    assert timeline.tail == 50
    start, end = np.array([0, 0, 0, 1, 0, 0, 0, 0, 0.0]), np.array([0, 0, 0, 1, 0, 0, 0, *pose])
    path = np.vstack([ease(start, end, timeline.lead), end])
    speed = np.abs(np.diff(path[:, 7:], axis=0)) * 100
    assert (speed.max(0) <= velocity).all()
    assert speed[:, 1].max() == pytest.approx(0.5, rel=0.01)
    assert path[timeline.lead // 2, 7] == pytest.approx(0.5, abs=0.01)


def test_the_motion_is_shown_whole_from_rest_to_rest_and_never_faster() -> None:
    line = np.arange(101.0)[:, None]
    timeline = plan(np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1), 101, 50.0)
    shown = stretch(line, timeline)[:, 0]
    step = np.diff(shown)
    assert (shown[0], shown[-1]) == pytest.approx((0, 100))
    assert step.max() <= 1 + 1e-12
    assert max(step[0], step[-1]) < 0.01
    assert len(shown) == 101 + 15  # a ramp of 0.3 s costs half of it at each end


def test_smoothing_keeps_constants_lines_and_limits() -> None:
    rng = np.random.default_rng(0)
    noisy: NDArray[np.float64] = rng.normal(size=(50, 3))
    quiet = smoothed(noisy)
    assert (quiet.min(0) >= noisy.min(0)).all()
    assert (quiet.max(0) <= noisy.max(0)).all()
    assert np.abs(np.diff(quiet, axis=0)).max() <= np.abs(np.diff(noisy, axis=0)).max()
    line = np.arange(20.0)[:, None]
    assert smoothed(line)[2:-2] == pytest.approx(line[2:-2])
