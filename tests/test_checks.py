"""Checks whose figure can be told beforehand: jerk, contact timing, balance, heat, supply, pinch; and the command."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from two_arm_rig import BASE_MASS, GRAVITY, HALF_FOOT, HEIGHT, REACH, STALL_CURRENT, TIP_MASS, TORQUE, WEIGHT
from two_arm_rig import two_arm_motion as motion
from two_arm_rig import two_arm_rig as make_rig

from retarget.files import save_trajectory
from retarget.rig import Power, load_rig
from retarget.trajectory import Trajectory
from rigcast.__main__ import main
from sim.checks import judge
from sim.electric import heat_resistance, heat_time
from sim.report import Check

FORWARD = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
COM_X = 2 * TIP_MASS * REACH / (BASE_MASS + 2 * TIP_MASS)


def found(name: str, trajectory, rig) -> Check:
    return next(c for c in judge(trajectory, rig)[0].checks if c.name == name)


def test_jerk_of_a_swing(tmp_path):
    swing = motion(seconds=3, left=lambda t: 0.2 * np.sin(6 * t))
    assert found("jerk", swing, make_rig(tmp_path, mount="stand")).value == pytest.approx(0.2 * 6**3, rel=0.01)


def test_a_foot_that_hangs_where_it_should_stand_is_timed(tmp_path):
    lifted = motion(root=lambda t: 0.05 * (t >= 0.5)[:, None] * UP)  # the harness lifts it within a tenth of a second
    late = found("contact_timing", lifted, make_rig(tmp_path, mount="hung"))
    assert late.value == pytest.approx(0.5, abs=0.06)
    assert late.at_s == pytest.approx(0.5, abs=0.1)
    assert "is in the air where it should stand" in late.advice


def test_a_foot_that_drags_where_it_should_swing_is_timed(tmp_path):
    swing = motion(root=lambda t: 0.05 * ((t >= 0.3) & (t < 0.7))[:, None] * UP)
    flying = replace(swing, contacts={"foot": swing.root_pos[:, 2] == HEIGHT})
    drags = found("contact_timing", flying, make_rig(tmp_path))  # nothing lifts it
    assert drags.value == pytest.approx(0.4)
    assert drags.at_s == pytest.approx(0.3)
    assert "drags" in drags.advice


def test_a_lean_that_lasts_rests_beside_the_feet_and_a_sway_does_not(tmp_path):
    rig = make_rig(tmp_path)
    angle = 0.25
    lean = motion(quat=(float(np.cos(angle / 2)), 0.0, float(np.sin(angle / 2)), 0.0))
    com = COM_X * np.cos(angle)  # ahead of the root; the sole's edges are behind it by the lean
    front = HALF_FOOT * np.cos(angle) - HEIGHT * np.sin(angle)
    assert found("com_outside", lean, rig).value == pytest.approx(com - front, abs=1e-6)
    turned = 0.12 * np.sin(np.pi * np.arange(51) / 25)  # it is over the edge for less than it takes to fall
    half = 0.5 * turned
    qpos = lean.qpos.copy()
    qpos[:, 3:7] = np.stack([np.cos(half), 0 * half, np.sin(half), 0 * half], axis=1)
    assert found("com_outside", replace(lean, qpos=qpos), rig).value == 0


def test_how_far_the_zero_moment_point_leaves_the_sole(tmp_path):
    """Steady acceleration moves it back by ẍ z / g."""
    speeding = motion(root=lambda t: 0.5 * 2.5 * t[:, None] ** 2 * FORWARD)
    outside = 2.5 * HEIGHT / GRAVITY - COM_X - HALF_FOOT
    assert outside > 0
    assert found("zmp_outside", speeding, make_rig(tmp_path)).value == pytest.approx(outside, rel=0.02)


def test_help_from_outside_is_told_in_weights(tmp_path):
    sinking = motion(root=lambda t: -0.5 * 1.5 * GRAVITY * t[:, None] ** 2 * UP, seconds=0.4)
    check = found("residual_wrench", sinking, make_rig(tmp_path))
    assert check.value == pytest.approx(0.5, rel=1e-3)
    assert f"{0.5 * WEIGHT:.1f} N" in check.advice


def test_heat_and_supply_of_a_servo_that_holds(tmp_path):
    rig = replace(make_rig(tmp_path, mount="stand"), power=Power(12.0, 0.5))
    model = rig.servos[0].model
    watts = (TIP_MASS * GRAVITY * REACH / TORQUE) ** 2 * 12.0 * STALL_CURRENT
    rise = watts * heat_resistance(model) * (1 - np.exp(-1800 / heat_time(model)))
    assert found("servo_heat", motion(), rig).value == pytest.approx(rise / 40, rel=1e-3)  # from 25 to 65 °C
    assert found("supply", motion(), rig).value == pytest.approx(watts / 6, rel=1e-3)
    bare = replace(rig, servos=(), power=None)
    for name in ("servo_heat", "supply"):
        assert not found(name, motion(), bare).applies


def test_a_gap_that_was_always_narrow_does_not_pinch(tmp_path):
    rig = make_rig(tmp_path, mount="stand", torque=100.0, kp=1000.0, kv=20.0)
    closing, close = motion(right=lambda t: 0.35 * t), motion(right=lambda t: np.full(len(t), 0.35))
    assert found("pinch", closing, rig).value > 50
    assert found("pinch", close, rig).value == 0


def test_the_command_runs_trials(tmp_path, capsys):
    rig = load_rig("puppet")
    row = [0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)]
    feet = {foot.name: np.ones(10, bool) for foot in rig.feet}
    save_trajectory(Trajectory(np.tile(row, (10, 1)), 50.0, "puppet", rig.joint_names(), feet), tmp_path / "t.npz")
    assert main(["check", str(tmp_path / "t.npz"), "--mount", "free", "--trials", "2", "--seed", "3", "--json"]) == 0
    trials = json.loads(capsys.readouterr().out)["report"]["trials"]
    assert trials == {"count": 2, "passed": 2, "seed": 3, "failures": []}
    assert main(["check", str(tmp_path / "t.npz"), "--trials", "1"]) == 0
    assert "1 of 1 trials passed (seed 0)" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "t.npz"), "--trials", "-1"]) == 2
    assert "-1 trials" in capsys.readouterr().err


@pytest.mark.parametrize("seconds", [0.1, 1800])
def test_a_tenth_of_a_second_and_half_an_hour_are_judged(tmp_path, seconds):
    held = motion(seconds=seconds)
    report, rollout = judge(held, make_rig(tmp_path, mount="stand"))
    assert report.ok
    assert len(rollout.qpos) == len(held)
    np.testing.assert_allclose(rollout.torque[:, 0], TIP_MASS * GRAVITY * REACH, rtol=1e-3)
