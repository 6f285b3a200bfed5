"""Where mended feet stand: as far round as asked for, one at a time; and what is too short, or in free fall."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from motiongen.gestures.catalogue import perform
from motiongen.rotation import yaw_of_quat
from retarget.kinematics import poses
from retarget.menagerie import menagerie_file
from retarget.retarget import retarget
from retarget.rig import Rig, load_rig
from retarget.trajectory import Trajectory
from rigcast.__main__ import main
from sim.fix import judge_mended
from sim.mending.body import body_of
from sim.mending.feet import APART, Feet, find_feet
from sim.mending.lead import led, loose
from sim.mending.mend import LONGEST, mend
from sim.mending.pace import HURRIED, find_pace, hurried
from sim.mending.steps import INWARD, OUTWARD, Stance, Steps, Swing, find_steps
from sim.mending.weight import shift
from sim.scene import build_scene

PUPPET = load_rig("puppet")
BODY = body_of(PUPPET)
FPS = 50.0
OTHERS = ("unitree_g1", "booster_t1", "apptronik_apollo")
has_models = pytest.mark.skipif(
    not menagerie_file("unitree_g1/g1.xml").is_absolute(), reason="no robot models: the extra rigcast[robots]"
)


def still(seconds: float, rig: Rig = PUPPET) -> Trajectory:
    row = [0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)]
    count = round(seconds * FPS) + 1
    contacts = {foot.name: np.ones(count, bool) for foot in rig.feet}
    return Trajectory(np.tile(np.array(row, float), (count, 1)), FPS, rig.name, rig.joint_names(), contacts)


def facing(trajectory: Trajectory) -> float:
    return float(np.unwrap(yaw_of_quat(trajectory.root_quat))[-1])


@pytest.mark.parametrize("degrees", [90, 180])
def test_a_turn_goes_as_far_as_asked_for_in_steps_that_legs_take(degrees: int) -> None:
    asked = retarget(perform("turn", side="left", amplitude=degrees / 90, seed=0), PUPPET, mount="free")
    assert np.degrees(facing(asked)) == pytest.approx(degrees, abs=5)
    mended = mend(asked, PUPPET)
    assert facing(mended.trajectory) == pytest.approx(facing(asked), abs=0.25)
    assert mended.trajectory.duration <= LONGEST * asked.duration + 2 / FPS
    steps = find_steps(BODY, asked, poses(BODY.tree, asked.qpos), LONGEST)
    yaws = [stance.yaw for stance in steps.first]
    for swing in steps.swings:
        yaws[swing.leg] = swing.after.yaw
        assert -INWARD - OUTWARD < yaws[0] - yaws[1] <= OUTWARD + 1e-9  # the left foot is never far turned in
        assert np.linalg.norm(swing.after.spot - swing.before.spot) < 0.6 * BODY.height
    assert np.ptp(yaws) < 0.25


def test_a_turn_for_which_there_is_no_time_stays_short() -> None:
    asked = retarget(perform("turn", side="left", amplitude=2.0, seed=0), PUPPET, mount="free")
    at = poses(BODY.tree, asked.qpos)
    counts = [len(find_steps(BODY, asked, at, longest).swings) for longest in (1.0, 1.5, 2.0)]
    assert counts == sorted(counts)
    assert find_steps(BODY, asked, at, 1.0).turning == 0


def test_a_gear_is_led_across_its_play() -> None:
    """A loaded knee with a loose gear, simulated: told half the play more, it is where it should be."""
    rig = load_rig("puppet")
    asked = still(2.0)
    feet = Feet(np.zeros((len(asked), 2, 3)), np.zeros((len(asked), 2, 4)), np.ones((len(asked), 2), bool))
    tight = replace(rig, servos=tuple(replace(s, model=replace(s.model, play=0.0)) for s in rig.servos))
    knee = rig.joint_names().index("left_knee")
    scene = build_scene(rig, "free", asked.qpos[0], play=True)
    off = []
    for body in (BODY, body_of(tight)):
        aim = led(body, asked.qpos, feet, FPS)[50]
        data = mujoco.MjData(scene.model)
        scene.place(data, asked.qpos[0])
        data.ctrl[: len(aim)] = aim
        mujoco.mj_step(scene.model, data, 500)
        off.append(abs(scene.rows(data.qpos[None])[0, 7 + knee] - asked.qpos[0, 7 + knee]))
    half = rig.servos[0].model.play / 2
    assert half == pytest.approx(np.radians(0.25))
    assert off[0] < off[1] - 0.5 * half
    torque = np.zeros((1, len(rig.joints)))
    torque[0, knee] = -1.0
    assert loose(BODY, torque)[0, knee] == pytest.approx(-half)
    assert np.count_nonzero(loose(BODY, torque)) == 1


def test_balance_of_a_body_in_free_fall_has_no_nan() -> None:
    asked = still(1.0)
    qpos, t = asked.qpos.copy(), np.arange(len(asked)) / FPS - 0.5
    qpos[:, 2] += np.where(np.abs(t) < 0.2, 4.905 * (0.04 - t**2), 0.0)
    feet = Feet(np.zeros((len(qpos), 2, 3)), np.zeros((len(qpos), 2, 4)), np.ones((len(qpos), 2), bool))
    feet.turn[..., 0] = 1
    moved, amiss = shift(BODY, qpos, feet, FPS, 0.01)
    assert np.isfinite(moved).all()
    assert np.isfinite(amiss)


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_a_tenth_of_a_second_is_judged_and_left_as_it_is(frames: int) -> None:
    short = still((frames - 1) / FPS)
    lying = replace(short, qpos=short.qpos + np.eye(len(short.qpos[0]))[2] * 0.1)
    for asked in (short, lying):
        mended, report, rollout = judge_mended(asked, PUPPET, mount="free")
        assert len(mended) == len(rollout.qpos) == frames
        assert report.duration_s == pytest.approx((frames - 1) / FPS)


@has_models
@pytest.mark.parametrize("name", OTHERS)
def test_robots_of_others_have_soles_to_stand_on(name: str) -> None:
    body = body_of(load_rig(name))
    assert len(body.legs) == 2
    for leg in body.legs:
        assert 0.05 < np.ptp(leg.sole[:, 0]) < 0.35
        assert abs(leg.rise) < 0.15
        assert 0.4 < leg.length / body.height < 1.2


def test_a_trajectory_of_another_rig_is_one_line(tmp_path, capsys) -> None:
    from retarget.files import save_trajectory

    save_trajectory(still(0.5), tmp_path / "still.npz")
    assert main(["check", str(tmp_path / "still.npz"), "--rig", "humanoid", "--fix", "--mount", "free"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "trajectory is for rig 'puppet' with 20 joints, not for 'humanoid'" in said.err


def test_a_foot_goes_around_the_one_that_it_passes() -> None:
    """The right foot has turned across the way of the left one, which must not go straight."""
    at = poses(BODY.tree, still(3.0).qpos)
    left, right = (at.place[0, leg.body, :2] for leg in BODY.legs)
    first = (Stance(0, 40, left, 0.0), Stance(0, 10, right, 0.0))
    other = Stance(30, 150, right + np.array([0.15, 0.0]), -0.5)
    swings = (
        Swing(1, first[1], other, 10, 30),
        Swing(0, first[0], Stance(60, 150, left + np.array([0.22, -0.02]), -0.5), 40, 60),
    )
    steps = Steps(first, swings, 150, False, 0, 0.0)
    pace = find_pace(steps, np.ones(5), BODY.beat, FPS)
    lift, land = pace.swings[1]
    path = find_feet(BODY, steps, pace, at).place[lift : land + 1, 0, :2]
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    ahead, aside = turn @ (path - other.spot).T
    across, sole = np.linalg.norm(left - right), np.ptp(BODY.legs[0].sole[:, 0])
    straight = turn @ (np.linspace(path[0], path[-1], 50) - other.spot).T
    assert straight[1][np.abs(straight[0]) < sole].min() < 0.7 * across
    assert aside[np.abs(ahead) < sole].min() > (APART - 0.02) * across
    np.testing.assert_allclose(path[[0, -1]], [left, left + np.array([0.22, -0.02])], atol=1e-9)


@pytest.mark.parametrize("longest", [1000, 270, 100])
def test_many_steps_hurry_to_be_done_in_time(longest: float) -> None:
    """Ten swings of 2.4 beats of 0.16 s, 0.9 beats between two of them and 2.5 at both ends: 297 frames."""
    spots = [Stance(0, 1, np.zeros(2), 0.0), Stance(1, 2, np.ones(2), 0.0)]
    steps = Steps((spots[0], spots[0]), (Swing(0, spots[0], spots[1], 1, 2),) * 10, 20, False, 0, 0.0)
    lasts = (10 * 2.4 + 9 * 0.9 + 2 * 2.5) * 0.16 * FPS
    assert hurried(steps, 0.16, FPS, longest) == pytest.approx(max(HURRIED, min(1.0, longest / lasts)), abs=0.01)
