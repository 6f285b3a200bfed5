"""Mending for the rig's own feet: what it does is checked against physics written a second time, and by hand."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from motiongen.gestures.catalogue import perform
from motiongen.rotation import quat_rotate
from retarget.kinematics import on_body, poses
from retarget.retarget import retarget
from retarget.rig import load_rig
from retarget.trajectory import Trajectory
from sim.checks import judge
from sim.dynamics import dynamics, rates
from sim.fix import judge_mended, slowed
from sim.mending.body import body_of
from sim.mending.feet import Feet
from sim.mending.lead import torques
from sim.mending.mend import LONGEST, mend
from sim.mending.pace import find_pace
from sim.mending.steps import Stance, Steps, Swing
from sim.mending.tidy import Mended
from sim.mending.weight import least_shift, nearest, second_difference
from sim.scene import TIMESTEP, build_scene
from sim.support import margin, support

PUPPET = load_rig("puppet")
BODY = body_of(PUPPET)
FPS = 50.0


@pytest.fixture(scope="module")
def step() -> tuple[Trajectory, Trajectory]:
    """A step forward, as it was retargeted and mended."""
    asked = retarget(perform("step-forward", count=1, seed=0), PUPPET, mount="free")
    return asked, mend(asked, PUPPET).trajectory


def still(seconds: float) -> Trajectory:
    """The puppet in its nominal pose."""
    row = [0, 0, PUPPET.nominal.height, 1, 0, 0, 0, *PUPPET.pose_vector(PUPPET.nominal)]
    count = round(seconds * FPS)
    contacts = {foot.name: np.ones(count, bool) for foot in PUPPET.feet}
    return Trajectory(np.tile(np.array(row, float), (count, 1)), FPS, "puppet", PUPPET.joint_names(), contacts)


def test_what_fell_steps_free(step):
    """A second integration of the same frames: a floor, the servos' targets, and no other force on anything."""
    asked, mended = step
    assert not judge(asked, PUPPET, mount="free")[0].ok
    report, rollout = judge(mended, PUPPET, mount="free")
    assert [c.name for c in report.failures()] == []

    scene = build_scene(PUPPET, "free", mended.qpos[0])
    model, data = scene.model, mujoco.MjData(scene.model)
    assert (model.neq, model.nmocap, model.ntendon) == (0, 0, 0)
    assert model.nu == len(PUPPET.joints)
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    assert model.opt.gravity.tolist() == [0, 0, -9.81]
    scene.place(data, mended.qpos[0])
    done = []
    for target in [mended.targets[0]] * 25 + list(mended.targets):
        data.ctrl[:] = target
        mujoco.mj_step(model, data, round(1 / FPS / TIMESTEP))
        done.append(data.qpos.copy())
        assert not data.xfrc_applied.any()
        assert not data.qfrc_applied.any()
    np.testing.assert_allclose(done[25:], rollout.qpos, atol=1e-6)
    assert np.abs(done[-1][:3] - mended.qpos[-1, :3]).max() < 0.02


def test_the_zero_moment_point_keeps_within_the_soles(step):
    asked, mended = step
    scene = build_scene(PUPPET, "free", mended.qpos[0])

    def worst(trajectory: Trajectory) -> float:
        moves = dynamics(scene, trajectory.qpos, FPS)
        return float(np.nanmin(margin(moves.zmp, support(scene, moves, trajectory.contacts))))

    assert worst(asked) < 0
    assert worst(mended) > 0.012  # of 0.0174 asked for


def test_feet_stand_still_and_flat_or_are_clear_of_the_floor(step):
    _, mended = step
    at = poses(BODY.tree, mended.qpos)
    airborne = 0
    for leg in BODY.legs:
        sole = on_body(at, np.full(len(leg.sole), leg.body), leg.sole)
        stands = mended.contacts[leg.name]
        both = stands[1:] & stands[:-1]
        assert np.abs(np.diff(sole, axis=0)[both]).max() < 5e-4
        assert np.abs(sole[stands][..., 2]).max() < 1e-3
        airborne += (~stands).sum()
        middle = np.flatnonzero(~stands)
        if len(middle):
            assert sole[middle[len(middle) // 2], :, 2].min() > 0.015
    assert airborne > 10
    assert np.all(np.sum(list(mended.contacts.values()), axis=0) >= 1)


def test_limits_of_time_and_speed_hold_and_it_gets_there(step):
    asked, mended = step
    assert mended.duration <= LONGEST * asked.duration + 2 / FPS
    allowed = np.array([j.velocity for j in PUPPET.joints])
    assert (np.abs(np.diff(mended.joint_pos, axis=0)) * FPS <= allowed * 1.001).all()
    gone = [t.root_pos[-1, 0] - t.root_pos[0, 0] for t in (asked, mended)]
    assert gone[1] > 0.7 * gone[0] > 0.02


def test_arms_and_head_keep_their_angles(step):
    asked, mended = step
    arms = [
        i for i, j in enumerate(PUPPET.joints) if "hip" not in j.name and "knee" not in j.name and "ankle" not in j.name
    ]
    for i in arms:
        assert mended.joint_pos[:, i].max() == pytest.approx(asked.joint_pos[:, i].max(), abs=0.03)
        assert mended.joint_pos[:, i].min() == pytest.approx(asked.joint_pos[:, i].min(), abs=0.03)


def test_a_good_motion_is_left_alone():
    good = still(2.0)
    mended, report, _ = judge_mended(good, PUPPET, mount="free")
    assert mended is good
    assert report.ok
    assert report.changes == ()
    assert report.controller == "open_loop"


def test_without_fix_nothing_is_changed(step):
    asked, _ = step
    given, report, _ = judge_mended(asked, PUPPET, mount="free", fix=False)
    assert given is asked
    assert not report.ok


def test_slowing_a_sine_divides_its_peak_speed():
    """The peak speed of a sin(ω t) is a ω, and a ω / factor when it is slowed."""
    rest, a, w = still(4.0), 0.5, 2 * np.pi
    qpos = rest.qpos.copy()
    qpos[:, 7 + 2] = a * np.sin(w * np.arange(len(rest)) / FPS)
    change = slowed(Mended(replace(rest, qpos=qpos), ()), 1.6)
    speed = np.abs(np.diff(change.trajectory.joint_pos[:, 2])).max() * FPS
    assert speed == pytest.approx(a * w / 1.6, rel=0.01)
    assert change.trajectory.duration == pytest.approx(1.6 * rest.duration, abs=1 / FPS)
    assert change.changes[0].amount == 1.6
    with pytest.raises(ValueError, match="1 to 2 times, not 3"):
        slowed(Mended(rest, ()), 3)


def test_the_second_difference_is_that_of_the_dynamics():
    x = np.random.default_rng(0).normal(size=40)
    qpos = np.zeros((40, 8))
    qpos[:, 3], qpos[:, 0] = 1, x
    np.testing.assert_allclose(second_difference(40) @ x * FPS**2, rates(qpos, FPS)[1][:, 0], atol=1e-9)


def test_a_constant_overshoot_is_shifted_back_whole():
    """At rest the zero-moment point is under the centre of mass: 60 mm outside is a shift of 60 mm."""
    square = 0.02 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    zmp = np.tile([0.0, 0.08], (200, 1))
    shift = least_shift(zmp, np.tile(square, (200, 1, 1)), 0.25, 0.16, FPS)
    np.testing.assert_allclose(shift, np.tile([0.0, -0.06], (200, 1)), atol=1e-3)


def test_a_passing_overshoot_is_met_in_advance():
    """The cart on a table, integrated: what the shift adds, c − z/g c̈, brings the point in; and c leads it."""
    square = 0.02 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    zmp = np.zeros((300, 2))
    zmp[100:200, 1] = 0.06
    shift = least_shift(zmp, np.tile(square, (300, 1, 1)), 0.25, 0.16, FPS)
    added = shift - 0.25 / 9.81 * FPS**2 * (second_difference(300) @ shift)
    assert np.abs(zmp + added).max() < 0.0225
    assert shift[95, 1] < -0.005
    assert np.abs(shift[[0, -1]]).max() < 1e-3


def test_nearest_points_of_a_square():
    square = np.tile([[0.0, 0], [1, 0], [1, 1], [0, 1]], (3, 1, 1))
    spot, away = nearest(np.array([[0.5, 0.5], [0.3, -2], [2, 3]]), square)
    np.testing.assert_allclose(spot, [[0.5, 0.5], [0.3, 0], [1, 1]])
    np.testing.assert_allclose(away, [np.zeros((2, 2)), [[0, 0], [0, 1]], np.eye(2)])


def test_torques_of_standing_are_those_that_the_simulation_settles_to():
    rest = still(3.0)
    feet = Feet(np.zeros((len(rest), 2, 3)), np.zeros((len(rest), 2, 4)), np.ones((len(rest), 2), bool))
    needed = torques(BODY, rest.qpos, feet, FPS)[50]
    carried = judge(rest, PUPPET, mount="free")[1].torque[-1]
    knees = [i for i, j in enumerate(PUPPET.joints) if "knee" in j.name or "shoulder_roll" in j.name]
    friction = PUPPET.servos[2].model.friction  # holds as much of a load as it likes
    np.testing.assert_allclose(carried[knees], needed[knees], atol=friction + 0.03)
    assert needed[knees].min() < -0.1 or needed[knees].max() > 0.1


def test_two_feet_are_never_in_the_air():
    """A run: the flight between two swings is shared out, and both feet stand a while."""
    ground = [Stance(0, 10, np.zeros(2), 0.0), Stance(40, 90, np.ones(2), 0.0)]
    swings = (Swing(0, ground[0], ground[1], 10, 40), Swing(1, ground[0], ground[1], 30, 60))
    pace = find_pace(Steps((ground[0], ground[0]), swings, 100, False, 0, 0.0), np.ones(5), 0.16, FPS)
    (lift, land), (lift_2, land_2) = pace.swings
    assert lift < land < lift_2 < land_2
    assert (np.diff(pace.at) >= 0).all()
    assert (pace.at[0], pace.at[-1]) == pytest.approx((0, 99), abs=0.5)


def test_soles_are_flat_in_the_nominal_pose():
    for leg in BODY.legs:
        corners = quat_rotate(leg.flat, leg.sole)
        np.testing.assert_allclose(corners[:, 2], -leg.rise, atol=1e-3)
