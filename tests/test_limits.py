"""What keeps joints within their ranges, speeds and accelerations, against what is known of each."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import minimize

from motiongen.rotation import Array
from retarget.limits import Limits, limits_of, next_within, within
from retarget.rig import GETS_UP, load_rig

ONE = Limits(np.array([[-1.0], [1.0]]), np.array([0.1]), np.array([0.02]))


def followed(wanted: Array, limits: Limits) -> Array:
    """`wanted` (T, nj) from rest at zero, a frame at a time."""
    out = [np.zeros_like(wanted[0])] * 2
    for before, now in pairwise(wanted):
        out.append(next_within(np.array(out[-2:]), now, now - before, limits))
    return np.array(out)


def test_within_moves_only_what_is_beyond() -> None:
    smooth = 0.9 * np.sin(np.linspace(0, 6, 200))[:, None]
    assert within(smooth, ONE) == pytest.approx(smooth)
    jumps = np.random.default_rng(9).normal(size=(200, 1))
    kept = within(jumps, ONE)
    assert np.abs(kept).max() <= 1.0
    assert np.abs(np.diff(kept, axis=0)).max() <= 0.1 + 1e-12
    assert np.abs(np.diff(kept, n=2, axis=0)).max() <= 0.02 + 1e-12
    step = np.where(np.arange(41) < 20, 0.0, 1.0)[:, None]
    harsh = replace(ONE, bend=np.array([np.inf]))
    assert within(step, harsh)[19:21, 0] == pytest.approx([0.45, 0.55])  # half of the jump on either side


def test_what_bends_too_sharply_goes_to_the_nearest_that_does_not() -> None:
    """Against a general solver of constrained least squares (SLSQP)."""
    wanted = 0.9 * np.sin(np.linspace(0, 9, 40)) ** 3
    limits = Limits(ONE.reach, np.array([0.3]), np.array([0.05]))
    first, second = np.diff(np.eye(40), n=1, axis=0), np.diff(np.eye(40), n=2, axis=0)
    rows = np.concatenate([0.3 - np.zeros(39), 0.3 - np.zeros(39), np.full(38, 0.05), np.full(38, 0.05)])
    sides = np.concatenate([first, -first, second, -second])
    nearest = minimize(
        lambda x: 0.5 * ((x - wanted) ** 2).sum(),
        np.zeros(40),
        jac=lambda x: x - wanted,
        bounds=[(-1.0, 1.0)] * 40,
        constraints={"type": "ineq", "fun": lambda x: rows - sides @ x, "jac": lambda x: -sides},
        method="SLSQP",
    )
    kept = within(wanted[:, None], limits)[:, 0]
    assert np.abs(nearest.x - wanted).max() > 0.03
    assert kept == pytest.approx(nearest.x, abs=0.01)  # bounds are narrower by a hundredth


def test_the_next_frame_keeps_to_every_limit_whatever_is_wanted() -> None:
    wanted = 3 * np.random.default_rng(4).normal(size=(500, 1)).repeat(3, axis=0)
    kept = followed(wanted, ONE)
    assert np.abs(kept).max() <= 1.0
    assert np.abs(np.diff(kept, axis=0)).max() <= 0.1 + 1e-12
    assert np.abs(np.diff(kept, n=2, axis=0)).max() <= 0.02 + 1e-12
    assert np.abs(kept).max() > 0.9


def test_the_next_frame_is_the_one_wanted_where_the_limits_allow_it() -> None:
    t = np.arange(200)[:, None]
    wanted = 0.8 * (1 - np.cos(0.1 * t)) / 2  # bends by 0.004 at most
    assert followed(wanted, ONE)[2:] == pytest.approx(wanted[1:], abs=1e-12)


def test_a_step_is_caught_up_with_in_the_least_time_and_not_overshot() -> None:
    """To go by 0.5 at a bend of 0.02 and a stride of 0.1: 4 frames up, 1 at full speed, 4 down."""
    kept = followed(np.concatenate([np.zeros(1), np.full(30, 0.5)])[:, None], ONE)[2:, 0]
    assert kept.max() == pytest.approx(0.5)
    assert (np.diff(kept) >= -1e-12).all()
    assert kept[7] < 0.49
    assert kept[8] == pytest.approx(0.5, abs=1e-9)


def test_a_joint_without_an_acceleration_gets_up_to_speed_in_a_stated_time() -> None:
    rig = load_rig("puppet")
    limits = limits_of(rig, 50.0)
    assert limits.bend / limits.stride == pytest.approx(1 / (50 * GETS_UP))
    assert limits.stride[0] == pytest.approx(rig.joints[0].velocity / 50)
