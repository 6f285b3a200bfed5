"""Servos in physics against paper: play, friction, supply, heat, power, and the force on a finger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from two_arm_rig import (
    GRAVITY,
    HEIGHT,
    JOINTS,
    MASS,
    NO_LOAD_SPEED,
    REACH,
    STALL_CURRENT,
    TIP_MASS,
    TORQUE,
)
from two_arm_rig import two_arm_motion as motion
from two_arm_rig import two_arm_rig as make_rig

from retarget.rig import Power, load_rig
from sim import simulate as simulating
from sim.electric import ROOM, heat, heat_resistance, heat_time, power, temperature
from sim.pinch import closing_force
from sim.scene import build_scene
from sim.simulate import run, simulate

HOLD = TIP_MASS * GRAVITY * REACH  # N·m that hold an arm level
KP = 80.0


def test_an_arm_hangs_on_the_stop_of_its_gears(tmp_path):
    play = 0.02
    rig = make_rig(tmp_path, mount="stand", play=play)
    level = motion(seconds=2)
    tight = simulate(level, rig)
    loose = run(build_scene(rig, "stand", level.qpos[0], play=True), level)
    assert tight.qpos[-1, 7] == pytest.approx(-HOLD / KP, rel=1e-2)
    assert loose.qpos[-1, 7] == pytest.approx(-HOLD / KP - play / 2, rel=2e-2)
    assert loose.torque[-1, 0] == pytest.approx(HOLD, rel=1e-2)


def test_an_arm_without_a_load_swings_freely_between_the_stops(tmp_path):
    rig = make_rig(tmp_path, mount="stand", play=0.02)
    there_and_back = motion(seconds=2, right=lambda t: -0.3 * np.sin(np.pi * t))
    scene = build_scene(rig, "stand", there_and_back.qpos[0], play=True)
    tight, loose = simulate(there_and_back, rig), run(scene, there_and_back)
    apart = (loose.qpos - tight.qpos)[:, 8]
    assert 0.005 < np.abs(apart).max() < 0.025  # half of the play, and what the stop swings


def test_dry_friction_holds_a_joint_that_is_asked_for_less(tmp_path):
    """The right arm swings level, so that only friction acts: it sticks until kp · error is more."""
    asked = motion(seconds=1, right=lambda t: -0.01 * (t > 0.2))  # 0.8 N·m
    held = simulate(asked, make_rig(tmp_path, mount="stand", friction=1.0))
    slips = simulate(asked, make_rig(tmp_path, mount="stand", friction=0.4))
    assert abs(held.qpos[-1, 8]) < 2e-3  # MuJoCo's friction creeps a little
    assert slips.qpos[-1, 8] == pytest.approx(-0.01 + 0.4 / KP, abs=2e-3)


@pytest.mark.parametrize("volts", [6.0, 12.0, 14.0])
def test_torque_and_speed_rise_with_the_supply(tmp_path, volts):
    rig = replace(make_rig(tmp_path, mount="stand", kp=1e4, kv=0.0), power=Power(volts, 10.0))
    rollout = simulate(motion(seconds=0.3, right=lambda t: np.where(t > 0, -2.0, 0.0)), rig)
    ratio = volts / 12
    inertia = TIP_MASS * (REACH**2 + 0.4 * 0.04**2)
    tau = inertia * NO_LOAD_SPEED / TORQUE
    t = np.arange(len(rollout.qpos)) / rollout.fps
    angle = ratio * NO_LOAD_SPEED * (t - tau * (1 - np.exp(-t / tau)))
    np.testing.assert_allclose(-rollout.qpos[:, 8], np.minimum(angle, 2), atol=0.02)
    assert rollout.saturated[1:10, 1].min() == 1


def test_a_servo_held_against_gravity_warms_as_its_current_squared(tmp_path):
    rig = make_rig(tmp_path, mount="stand")
    rollout = simulate(motion(), rig)
    current = HOLD / TORQUE * STALL_CURRENT
    watts = current**2 * 12.0 / STALL_CURRENT
    np.testing.assert_allclose(heat(rig, rollout)[:, 0], watts, rtol=1e-3)
    np.testing.assert_allclose(heat(rig, rollout)[:, 1], 0, atol=1e-9)
    np.testing.assert_allclose(power(rig, rollout), watts, rtol=1e-3)


def test_a_servo_that_lifts_draws_what_it_lifts_with(tmp_path):
    """Lifting at a steady speed: g · m · height and the heat of its current."""
    rig = make_rig(tmp_path, mount="stand")
    rollout = simulate(motion(fps=500, left=lambda t: 0.5 * t), rig)  # at 50 Hz the steps of the target show
    k = slice(200, 450)
    torque, speed = rollout.torque[k, 0], 0.5
    expected = torque * speed + (torque / TORQUE * STALL_CURRENT) ** 2 * 12.0 / STALL_CURRENT
    np.testing.assert_allclose(power(rig, rollout)[k], expected, rtol=2e-2)


def test_temperature_is_that_of_a_body_that_cools():
    model = load_rig("puppet").servos[-1].model
    assert model.name == "XM430-W350"
    assert heat_resistance(model) == pytest.approx(12.6, abs=0.2)
    warm, watts, dt = ROOM, 3.0, 0.5
    capacity = heat_time(model) / heat_resistance(model)
    assert capacity == pytest.approx(0.082 * 700)
    for _ in range(2000):  # 1000 s of Euler's method
        warm += dt * (watts - (warm - ROOM) / heat_resistance(model)) / capacity
    assert temperature(model, watts, 1000) == pytest.approx(warm, rel=1e-3)
    assert temperature(model, watts, 1e9) == pytest.approx(ROOM + watts * heat_resistance(model))


def test_a_finger_is_pressed_by_springs_one_after_the_other(tmp_path):
    """Only `right` swings towards `left`, whose own hinge lies across; the tips are spheres of 40 mm."""
    rig, angle = make_rig(tmp_path, mount="stand"), 0.35
    left, swung = np.array([REACH, 0.1]), REACH * np.array([np.cos(angle), np.sin(angle)])
    apart = left - (swung - [0, 0.1])
    gap = np.linalg.norm(apart) - 0.08
    along = apart / np.linalg.norm(apart)
    lever = swung[0] * along[1] - swung[1] * along[0]
    row = np.array([0, 0, HEIGHT, 1, 0, 0, 0, 0.0, angle])
    force = closing_force(build_scene(rig, "stand", row), row, "left_arm", "right_arm")
    assert force == pytest.approx((0.025 - gap) * KP / lever**2, rel=1e-4)
    stiff = make_rig(tmp_path, mount="stand", kp=2 * KP)
    assert closing_force(build_scene(stiff, "stand", row), row, "left_arm", "right_arm") == pytest.approx(2 * force)
    strong = make_rig(tmp_path, mount="stand", kp=1e9)
    weak = make_rig(tmp_path, mount="stand", kp=1e9, torque=TORQUE / 2)
    full = closing_force(build_scene(strong, "stand", row), row, "left_arm", "right_arm")
    assert closing_force(build_scene(weak, "stand", row), row, "left_arm", "right_arm") == pytest.approx(full / 2)
    assert full == pytest.approx(TORQUE / lever)


def test_long_motions_are_run_in_pieces_that_join(tmp_path, monkeypatch):
    rig = make_rig(tmp_path, mount="hung")
    swing = motion(seconds=2, left=lambda t: 0.3 * np.sin(5 * t), root=lambda t: np.outer(t, [0.2, 0, 0]))
    whole = simulate(swing, rig)
    monkeypatch.setattr(simulating, "CHUNK", 33)
    pieces = simulate(swing, rig)
    for name in ("qpos", "torque", "saturated", "torque_squared", "drive", "harness"):
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), rtol=1e-3, atol=2e-4, err_msg=name)


def test_names_of_joints_are_those_of_the_rig(tmp_path):
    assert make_rig(tmp_path).joint_names() == JOINTS
    assert make_rig(tmp_path).servos[0].model.mass == MASS
