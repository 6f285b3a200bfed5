"""Keeping upright by an IMU: geometry by hand, signs by the model; streams that need it are not followed blindly."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from small_rig import REPORT, free_address, small_rig, swing

from drivers.drive import drive
from drivers.frame import UNCHECKED
from drivers.messages import Hello, pack, unpack
from drivers.publisher import Publisher, frames_of, hello_for
from drivers.receiver import Receiver
from drivers.simulated import SimulatedBus
from motiongen.rotation import axis_angle_to_quat, quat_mul, yaw_quat
from retarget.files import load_trajectory, save_trajectory
from retarget.model import load_model
from retarget.resample import resampled
from retarget.rig import load_rig
from sim.upright import Upright, corrections, lean, turning, upright_of

X, Y = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
NO_SPIN = np.zeros(3)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
@pytest.mark.parametrize(("axis", "leans"), [(X, [0.1, 0.0]), (Y, [0.0, 0.1])])
def test_lean_is_about_the_heading_whatever_the_yaw(yaw, axis, leans):
    asked = yaw_quat(yaw)
    felt = quat_mul(asked, axis_angle_to_quat(axis, 0.1))
    np.testing.assert_allclose(lean(felt, NO_SPIN, asked, NO_SPIN, 0.0), leans, atol=2e-4)


def test_a_drifted_yaw_is_no_lean():
    asked = quat_mul(yaw_quat(0.3), axis_angle_to_quat(Y, 0.4))
    felt = quat_mul(yaw_quat(1.7), axis_angle_to_quat(Y, 0.4))
    np.testing.assert_allclose(lean(felt, NO_SPIN, asked, NO_SPIN, 0.0), 0.0, atol=1e-12)


def test_rates_count_ahead():
    asked = yaw_quat(0.0)
    spin, should = np.array([0.2, -0.5, 9.0]), np.array([0.1, 0.5, 0.0])
    np.testing.assert_allclose(lean(asked, spin, asked, should, 0.1), [0.01, -0.1])


def test_turning_is_the_gyroscope_of_the_motion():
    """A steady turn about the root's own y axis."""
    trajectory = swing(small_rig(), 1.0)
    qpos = trajectory.qpos.copy()
    qpos[:, 3:7] = axis_angle_to_quat(Y, 0.8 * np.arange(len(qpos)) / trajectory.fps)
    np.testing.assert_allclose(turning(replace(trajectory, qpos=qpos))[:-1], np.tile([0, 0.8, 0], (len(qpos) - 1, 1)))


def test_standing_feet_share_the_work():
    upright = Upright(np.array([[[2.0, 0], [0, 0]], [[0, 0], [0, 4.0]]]), 0.0, 0.0)
    leans = np.array([[0.1, 0.2]])
    np.testing.assert_allclose(corrections(upright, leans, np.array([True, False])), [[0.2, 0.0]])
    np.testing.assert_allclose(corrections(upright, leans, np.array([True, True])), [[0.1, 0.4]])
    np.testing.assert_allclose(corrections(upright, leans, np.array([False, False])), [[0.0, 0.0]])


@pytest.mark.parametrize("name", ["puppet", "humanoid"])
def test_an_ankle_turns_with_the_lean(name):
    """A foot pressed down on the side to which the rig leans pushes it back: it turns the way the root has leaned."""
    rig = load_rig(name)
    model = load_model(rig)
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)]
    mujoco.mj_kinematics(model, data)
    gains = upright_of(rig).gain
    for foot, gain in zip(rig.feet, gains, strict=True):
        used = np.flatnonzero(np.abs(gain).any(1))
        assert {rig.joints[i].name for i in used} == {f"{foot.name[:-5]}_ankle_pitch", f"{foot.name[:-5]}_ankle_roll"}
        for i in used:
            axis = data.xaxis[1 + i]
            np.testing.assert_allclose(gain[i] / np.linalg.norm(gain[i]), axis[:2], atol=0.01)


def test_a_rig_without_imu_or_gains_says_so():
    with pytest.raises(ValueError, match=r"no foot has gains|no IMU"):
        upright_of(small_rig())


def test_frames_of_a_stream_that_needs_an_imu_move_nothing():
    rig = small_rig()
    trajectory, address = swing(rig, 2.0), free_address()
    hello = hello_for(trajectory, rig, REPORT, 5, "imu")
    assert unpack(pack(hello), Hello).controller == "imu"
    with Publisher(hello, address) as publisher, Receiver(address, rig_hash=rig.hash) as receiver:
        assert publisher.wait_for_subscriber(5)
        done = drive(rig, receiver, SimulatedBus(rig), watch=lambda _: publisher.tick())
    assert (done.mode, done.followed) == ("stopped", 0)
    assert "needs the controller 'imu'" in done.reason


def test_what_servos_are_told_goes_the_whole_way(tmp_path):
    """The aim of a trajectory: into files, through resampling and onto the wire; what is not there is the pose."""
    rig = small_rig()
    plain = swing(rig, 1.0)
    assert plain.targets is not None
    np.testing.assert_array_equal(plain.targets, plain.joint_pos)
    aimed = replace(plain, aim=plain.joint_pos + 0.01)
    save_trajectory(aimed, tmp_path / "a.npz")
    np.testing.assert_array_equal(load_trajectory(tmp_path / "a.npz").targets, aimed.aim)
    twice = resampled(aimed, 2 * plain.fps)
    np.testing.assert_allclose(twice.targets, twice.joint_pos + 0.01, atol=1e-12)
    frame = next(iter(frames_of(aimed, rig, UNCHECKED, 1, 0)))
    np.testing.assert_allclose(frame.pos[0], aimed.aim[0], atol=1e-6)
    with pytest.raises(ValueError, match="aim"):
        replace(plain, aim=np.zeros((3, 2)))
