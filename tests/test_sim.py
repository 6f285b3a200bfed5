"""Physics and the gate against cases worked out on paper."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from two_arm_rig import GRAVITY, HEIGHT, JOINTS, NO_LOAD_SPEED, REACH, TIP_MASS, TORQUE, WEIGHT
from two_arm_rig import two_arm_motion as motion
from two_arm_rig import two_arm_rig as make_rig

from retarget.rig import load_rig
from sim.checks import judge, report_id
from sim.geometry import measure
from sim.report import Check, Report
from sim.scene import build_scene
from sim.simulate import simulate
from sim.thresholds import THRESHOLDS, limit_for, rig_size

UP = np.array([0.0, 0.0, 1.0])
FORWARD = np.array([1.0, 0.0, 0.0])
LEANING = (float(np.cos(0.15)), 0.0, float(np.sin(0.15)), 0.0)  # 0.3 rad; the foot tips at atan(0.15 / 0.93) = 0.16


def found(report: Report, name: str) -> Check:
    return next(c for c in report.checks if c.name == name)


def test_a_level_arm_is_held_with_the_torque_of_its_weight(tmp_path):
    rollout = simulate(motion(), make_rig(tmp_path, mount="stand"))
    hold = TIP_MASS * GRAVITY * REACH
    np.testing.assert_allclose(rollout.torque[:, 0], hold, rtol=1e-3)
    np.testing.assert_allclose(rollout.torque[:, 1], 0, atol=1e-6)
    np.testing.assert_allclose(rollout.qpos[:, 7], -hold / 80.0, rtol=1e-2)  # a proportional servo sags by torque / kp
    assert rollout.saturated.max() == 0


def test_a_servo_speeds_up_along_its_torque_speed_line(tmp_path):
    """I·dω/dt = torque·(1 − ω/ω0), so θ = ω0·(t − τ·(1 − exp(−t/τ))) with τ = I·ω0/torque."""
    rig = make_rig(tmp_path, mount="stand", kp=1e4, kv=0.0)
    rollout = simulate(motion(seconds=0.3, right=lambda t: np.where(t > 0, -2.0, 0.0)), rig)
    inertia = TIP_MASS * (REACH**2 + 0.4 * 0.04**2)  # point and sphere
    tau = inertia * NO_LOAD_SPEED / TORQUE
    t = np.arange(len(rollout.qpos)) / rollout.fps  # row 0 ends the hold of frame 0: from there on, the step
    angle = NO_LOAD_SPEED * (t - tau * (1 - np.exp(-t / tau)))
    np.testing.assert_allclose(-rollout.qpos[:, 8], angle, atol=0.02)
    assert rollout.saturated[1:, 1].min() == 1


def test_a_servo_brakes_with_its_whole_torque(tmp_path):
    """Against the motion the line does not apply: braking from near ω0 takes I·ω/torque, not the time constant more."""
    rig = make_rig(tmp_path, mount="stand", kp=1e4, kv=0.0)
    there_and_back = motion(seconds=0.4, right=lambda t: np.where(t <= 0.2, -2.0 * (t > 0), 2.0))
    angle = -simulate(there_and_back, rig).qpos[:, 8]
    inertia, top = TIP_MASS * (REACH**2 + 0.4 * 0.04**2), (angle[10] - angle[9]) * 50
    stop = top**2 * inertia / (2 * TORQUE)  # braking distance from the frame in which the target turned
    assert angle.max() - angle[10] == pytest.approx(stop, abs=0.03)


def test_the_harness_carries_a_rig_off_the_floor(tmp_path):
    rollout = simulate(motion(root=lambda t: 0.5 * UP * np.ones((len(t), 1))), make_rig(tmp_path, mount="hung"))
    np.testing.assert_allclose(rollout.harness[:, 2], WEIGHT, rtol=1e-3)
    np.testing.assert_allclose(rollout.harness[:, :2], 0, atol=WEIGHT * 1e-2)
    assert rollout.weight == pytest.approx(WEIGHT)


def test_the_harness_does_not_trail_a_steady_walk(tmp_path):
    walk = motion(root=lambda t: 0.5 * UP + 1.2 * t[:, None] * FORWARD)
    rollout = simulate(walk, make_rig(tmp_path, mount="hung"))
    np.testing.assert_allclose(rollout.qpos[20:-5, 0], walk.root_pos[20:-5, 0], atol=3e-3)


def test_a_stand_holds_the_root_where_the_motion_starts(tmp_path):
    moving = motion(root=lambda t: 0.1 * UP + t[:, None] * FORWARD)
    rollout = simulate(moving, make_rig(tmp_path, mount="stand"))
    np.testing.assert_array_equal(rollout.qpos[:, :7], np.tile(moving.qpos[0, :7], (len(moving), 1)))


def test_rows_are_times_at_which_the_rig_is_there(tmp_path):
    rollout = simulate(motion(), make_rig(tmp_path))
    np.testing.assert_allclose(rollout.time, (np.arange(51) + 1) / 50 + 0.02)


@pytest.mark.parametrize("offset", [-0.03, 0.03])
def test_height_errors_read_as_what_they_are(tmp_path, offset):
    report, _ = judge(motion(root=lambda t: offset * UP * np.ones((len(t), 1))), make_rig(tmp_path, mount="hung"))
    assert found(report, "penetration").value == pytest.approx(max(-offset, 0), abs=1e-9)
    assert found(report, "floating").value == pytest.approx(max(offset, 0), abs=1e-9)


def test_a_flight_phase_is_not_floating(tmp_path):
    jump = motion(seconds=0.98, root=lambda t: 0.2 * (t >= 0.5)[:, None] * UP)
    rig, landed = make_rig(tmp_path, mount="hung"), jump.root_pos[:, 2] == HEIGHT
    assert found(judge(replace(jump, contacts={"foot": landed}), rig)[0], "floating").value == pytest.approx(0)
    for silent in ({"foot": np.zeros(50, bool)}, {}):
        assert found(judge(replace(jump, contacts=silent), rig)[0], "floating").value == pytest.approx(0.1)


def test_depth_and_height_are_means_over_time(tmp_path):
    sinking = motion(seconds=0.98, root=lambda t: -0.03 * (t >= 0.5)[:, None] * UP)  # 25 of 50 frames
    assert found(judge(sinking, make_rig(tmp_path, mount="hung"))[0], "penetration").value == pytest.approx(0.015)


def test_the_harness_never_pushes_down_and_pulls_no_harder_than_it_says(tmp_path):
    pressed = motion(root=lambda t: -0.1 * UP + 0.5 * (t > 0.5)[:, None] * FORWARD)
    force = simulate(pressed, make_rig(tmp_path, mount="hung")).harness / WEIGHT
    assert force[:, 2].min() >= 0
    assert np.abs(force[:, :2]).max() == pytest.approx(1.0)
    lifted = motion(root=lambda t: 0.5 * (t > 0.5)[:, None] * UP)
    assert simulate(lifted, make_rig(tmp_path, mount="hung")).harness[:, 2].max() == pytest.approx(3 * WEIGHT)


def test_feet_that_touch_one_another_do_not_touch_the_floor():
    rig = load_rig("puppet")
    crossed = {**rig.nominal.joints, "left_hip_roll": -0.3, "right_hip_roll": -0.3}
    row = np.array([0, 0, 0.6, 1, 0, 0, 0, *rig.pose_vector(replace(rig.nominal, joints=crossed))])
    geometry = measure(build_scene(rig, "free", row), row[None])
    assert geometry.self_depth[0] > 0.005
    assert {name[: name.index("_")] for name in geometry.self_pair[0]} == {"left", "right"}
    assert geometry.floor_depth[0] == 0
    assert not any(touching[0] for touching in geometry.touching.values())


def test_a_standing_foot_does_not_creep_under_a_sideways_load(tmp_path):
    scene = build_scene(make_rig(tmp_path), "free", motion().qpos[0])
    data, base = mujoco.MjData(scene.model), scene.model.body("base").id
    mujoco.mj_step(scene.model, data, 250)
    push = 0.3 * WEIGHT  # friction holds 0.8 of it
    data.xfrc_applied[base] = [push, 0, 0, 0, -push * HEIGHT, 0]  # as if pushed at the sole, so that it does not tip
    before = data.qpos[0]
    mujoco.mj_step(scene.model, data, 500)
    assert data.qpos[0] - before < 3e-4  # a third of a millimetre in a second


def test_a_dragged_foot_skates_at_the_speed_of_the_drag(tmp_path):
    # The harness sags by 4 mm under the whole weight: 3 mm up, the foot stands with a quarter of it and does not trip.
    drag = motion(root=lambda t: 0.3 * t[:, None] * FORWARD + 0.003 * UP)
    report, _ = judge(drag, make_rig(tmp_path, mount="hung"))
    assert found(report, "skate_speed").value == pytest.approx(0.3, rel=0.05)
    assert found(report, "skate_ratio").value > 0.9
    slow = motion(root=lambda t: 0.1 * t[:, None] * FORWARD + 0.003 * UP)
    report, _ = judge(slow, make_rig(tmp_path, mount="hung"))
    assert found(report, "skate_speed").value == pytest.approx(0.1, rel=0.05)
    assert found(report, "skate_ratio").value == 0


def wide(t: np.ndarray) -> np.ndarray:
    return 0.6 * np.sin(2 * np.pi * t)


def still(t: np.ndarray) -> np.ndarray:
    return np.zeros((len(t), 3))


# check → (mount, changes to the rig, the motion that breaks it, what its advice must name)
BROKEN = {
    "joint_limit": ("stand", {}, {"left": lambda t: 2.1 * np.sin(t * 1.6)}, "left"),
    "joint_speed": ("stand", {}, {"right": lambda t: -1.0 * (t > 0.5)}, "right"),
    "body_speed": ("hung", {}, {"root": lambda t: 0.4 * (t > 0.5)[:, None] * FORWARD}, "base"),
    "speed_saturation": ("stand", {}, {"left": lambda t: wide(2 * t)}, "left"),
    "torque_saturation": ("stand", {"torque": 1.3}, {"left": lambda t: 0.1 * np.sin(20 * t)}, "left"),
    "penetration": ("free", {}, {"root": lambda t: still(t) - 0.03 * UP}, "base"),
    "floating": ("free", {}, {"root": lambda t: still(t) + 0.03 * UP}, "sole"),
    "self_collision": ("stand", {}, {"right": lambda t: 0.7 * t}, "right_arm"),
    "self_contact": ("stand", {}, {"right": lambda t: 0.65 * np.minimum(2 * t, 1)}, "right_arm"),
    "skate_speed": ("hung", {}, {"root": lambda t: 0.3 * t[:, None] * FORWARD + 0.003 * UP}, "foot"),
    "skate_ratio": ("hung", {}, {"root": lambda t: 0.3 * t[:, None] * FORWARD + 0.003 * UP}, "foot"),
    "fall_tilt": ("free", {}, {"quat": LEANING}, "base"),
    "fall_drop": ("free", {}, {"root": lambda t: still(t) + 0.5 * UP}, "base"),
    "tracking_joint": ("stand", {"torque": 1.3}, {}, "left"),
    "tracking_body": ("stand", {"torque": 1.3}, {}, "left_hand"),
    "harness": ("hung", {}, {"root": lambda t: (0.5 + 0.2 * np.sin(20 * t))[:, None] * UP}, "harness"),
    "jerk": ("stand", {}, {"left": lambda t: 0.02 * (-1) ** np.rint(50 * t)}, "left"),
    "com_outside": ("free", {}, {"quat": LEANING}, "centre of mass"),
    "zmp_outside": ("free", {}, {"root": lambda t: 0.1 * np.sin(6 * t)[:, None] * FORWARD}, "zero-moment point"),
    "residual_wrench": ("free", {}, {"root": lambda t: 0.2 * np.sin(10 * t)[:, None] * UP}, "help"),
    "contact_timing": ("hung", {}, {"root": lambda t: 0.05 * (t > 0.5)[:, None] * UP}, "foot"),
    "servo_heat": ("stand", {}, {"left": lambda t: 0.1 * np.sin(20 * t)}, "left"),
    "supply": ("stand", {}, {"right": lambda t: -1.0 * (t > 0.5)}, "12 W"),
    "pinch": ("stand", {"torque": 100.0, "kp": 1000.0, "kv": 20.0}, {"right": lambda t: 0.65 * t}, "right_arm"),
    "stable": ("stand", {"torque": 1e13, "kp": 1e13, "kv": 0.0}, {"left": wide}, "left_arm"),
}


def test_every_check_has_its_broken_motion():
    assert set(BROKEN) == set(THRESHOLDS)


@pytest.mark.parametrize("name", BROKEN)
def test_a_check_fails_on_its_broken_motion_alone(tmp_path, name):
    mount, change, parts, named = BROKEN[name]
    report, rollout = judge(motion(**parts), make_rig(tmp_path, mount=mount, **change))
    broken = found(report, name)
    assert broken.applies
    assert not broken.ok, broken
    assert not report.ok
    assert broken in report.failures()
    assert named in broken.advice
    assert broken.advice.endswith(".")
    assert broken.at_s is not None
    assert f"{broken.at_s:.2f} s" in broken.advice or name == "skate_ratio"
    assert np.isfinite(rollout.qpos).all()
    good, _ = judge(motion(left=lambda t: 0.2 * np.sin(3 * t)), make_rig(tmp_path, mount=mount))
    assert found(good, name).ok, found(good, name)


@pytest.mark.parametrize("mount", ["free", "stand", "hung"])
def test_an_unbroken_motion_passes_everything(tmp_path, mount):
    report, _ = judge(motion(left=lambda t: 0.2 * np.sin(3 * t)), make_rig(tmp_path), mount=mount)
    assert report.ok, report.failures()
    assert report.mount == mount
    assert report.controller == "open_loop"
    assert {c.name for c in report.checks} == set(THRESHOLDS)
    idle = {c.name for c in report.checks if not c.applies}
    free = {"fall_tilt", "fall_drop", "com_outside", "zmp_outside", "residual_wrench"}
    floor = {"penetration", "floating", "skate_speed", "skate_ratio", "contact_timing"}
    assert idle == {"free": {"harness"}, "stand": free | floor | {"harness"}, "hung": free}[mount]


def test_a_faster_command_than_the_servo_turns_it_at_most_at_no_load_speed(tmp_path):
    fast = motion(seconds=0.3, right=lambda t: -2 * NO_LOAD_SPEED * t * (t < 0.2) - 2 * (t >= 0.2))
    report, rollout = judge(fast, make_rig(tmp_path, mount="stand"))
    assert found(report, "speed_saturation").value == pytest.approx(10 / 15)  # ten of fifteen intervals
    assert np.abs(np.diff(rollout.qpos[:, 8]) * 50).max() < NO_LOAD_SPEED


@pytest.mark.parametrize(("share", "ok"), [(1.0, True), (1.05, False)])
def test_the_speed_limit_is_the_joint_s_own(tmp_path, share, ok):
    rig = make_rig(tmp_path, mount="stand")
    steady = motion(seconds=0.4, right=lambda t: -share * rig.joints[1].velocity * t)
    assert found(judge(steady, rig)[0], "speed_saturation").ok == ok


def test_a_simulation_that_flies_apart_is_a_failed_check_that_says_where(tmp_path, capfd, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mount, change, parts, _ = BROKEN["stable"]
    report, rollout = judge(motion(**parts), make_rig(tmp_path, mount=mount, **change))
    assert rollout.breakdown is not None
    assert rollout.breakdown.body == "left_arm"
    assert not report.ok
    assert capfd.readouterr() == ("", "")
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


@pytest.mark.parametrize("frames", [1, 2])
def test_shortest_motions_are_judged(tmp_path, frames):
    report, rollout = judge(motion(seconds=(frames - 1) / 50), make_rig(tmp_path))
    assert report.ok
    assert len(rollout.qpos) == frames


def test_an_odd_frame_rate_neither_gains_nor_loses_steps(tmp_path):
    rollout = simulate(motion(fps=30, seconds=2, right=lambda t: -0.2 * t), make_rig(tmp_path, mount="stand"))
    lag = rollout.qpos[20:, 8] + 0.2 * np.arange(20, 61) / 30
    assert np.ptp(lag) < 1e-3  # one lag throughout: no drift between wire time and simulated time


def test_a_trajectory_for_another_rig_is_refused(tmp_path):
    with pytest.raises(ValueError, match="for rig 'puppet' with 2 joints, not for 'two_arm'"):
        judge(replace(motion(), rig="puppet"), make_rig(tmp_path))
    with pytest.raises(ValueError, match="unknown mount 'sky'; there are free, stand, hung"):
        judge(motion(), make_rig(tmp_path), mount="sky")


def test_the_report_id_is_of_everything_that_was_judged(tmp_path):
    rig, plain = make_rig(tmp_path), motion()
    ids = [
        report_id(plain, rig, "free"),
        report_id(plain, rig, "hung"),
        report_id(motion(fps=25, seconds=2), rig, "free"),
        report_id(motion(root=lambda t: still(t) + 1e-6 * UP), rig, "free"),
        report_id(plain, replace(rig, joints=(replace(rig.joints[0], upper=1.9), rig.joints[1])), "free"),
        report_id(plain, replace(rig, joints=(replace(rig.joints[0], torque=0.5), rig.joints[1])), "free"),
    ]
    assert len(set(ids)) == len(ids)
    assert all(re.fullmatch("[0-9a-f]{16}", i) for i in ids)
    assert judge(plain, rig)[0].report_id == ids[0]


def test_a_report_is_plain_data(tmp_path):
    report, _ = judge(motion(), make_rig(tmp_path))
    plain = report.to_dict()
    assert plain["report_id"] == report.report_id
    assert [c["name"] for c in plain["checks"]] == [c.name for c in report.checks]


def test_thresholds_shrink_with_the_rig(tmp_path):
    rig = make_rig(tmp_path)
    small = replace(rig, nominal=replace(rig.nominal, height=HEIGHT / 4))
    assert rig_size(small) == pytest.approx(0.25)
    assert limit_for("floating", small) == pytest.approx(limit_for("floating", rig) / 4)
    assert limit_for("tracking_joint", small) == limit_for("tracking_joint", rig)


def test_the_page_states_every_threshold():
    page = (Path(__file__).parent.parent / "docs" / "physics.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \|[^|]*\|[^|]*\| ([^|]*) \|[^|]*\|$", page, re.M))
    assert rows == {name: f"{t.limit:g} {t.unit}" + (" × size" if t.scaled else "") for name, t in THRESHOLDS.items()}


def test_a_report_needs_no_simulator():
    code = "import sim.report, sim.thresholds, sys; sys.exit('mujoco' in sys.modules or 'torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    code = "import sim.checks, sys; sys.exit('torch' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_joint_order_is_the_rig_s(tmp_path):
    assert make_rig(tmp_path).joint_names() == JOINTS
