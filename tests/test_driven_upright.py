"""Standing free while driven: the law beside the one of the check, and the puppet's body on an emulated bus."""

from dataclasses import replace

import numpy as np
import pytest

from drivers.drive import drive
from drivers.emulation.body import Body
from drivers.emulation.in_process import InProcess
from drivers.frame import UNCHECKED
from drivers.played import Played
from drivers.samples import frames_of
from drivers.servos.connect import connect
from drivers.upright import Felt, Standing, missing
from motiongen.rotation import axis_angle_to_quat
from retarget.rig import load_rig
from retarget.trajectory import Trajectory
from sim.feedback import feedback_of
from sim.scene import build_scene

PUPPET = load_rig("puppet")
REPORT = "1234567890abcdef"


def sway(seconds: float = 2.0, angle: float = 0.0) -> Trajectory:
    """The puppet stands; its root is asked to roll to and fro by `angle` rad."""
    row = [0, 0, PUPPET.nominal.height, 1, 0, 0, 0, *PUPPET.pose_vector(PUPPET.nominal)]
    count = round(seconds * 50)
    qpos = np.tile(np.array(row, float), (count, 1))
    qpos[:, 3:7] = axis_angle_to_quat([1.0, 0, 0], angle * np.sin(2 * np.pi * np.arange(count) / 50))
    contacts = {"left_foot": np.arange(count) % 7 < 5, "right_foot": np.arange(count) % 5 < 3}
    return Trajectory(qpos, 50.0, "puppet", PUPPET.joint_names(), contacts)


class Told:
    """An IMU that says what it is told to."""

    def __init__(self) -> None:
        self.says = Felt(np.array([1.0, 0, 0, 0]), np.zeros(3))

    def felt(self) -> Felt:
        return self.says


def test_it_adds_what_the_check_adds():
    """The same states, once as MuJoCo's in a run that is checked, once through frames and an IMU that is 20 ms late."""
    asked, rng = sway(angle=0.1), np.random.default_rng(0)
    scene = build_scene(PUPPET, "free", asked.qpos[0])
    checked = feedback_of("imu", scene, asked)
    assert checked is not None
    imu = Told()
    driven = Standing(PUPPET, imu, 50.0)
    states = np.zeros((len(asked), 1 + scene.model.nq + scene.model.nv))
    states[:, 4:8] = axis_angle_to_quat(rng.normal(size=(len(asked), 3)), 0.1)
    states[:, 1 + scene.model.nq + 3 : 1 + scene.model.nq + 6] = rng.normal(size=(len(asked), 3))
    for k, frame in zip(range(len(asked)), frames_of(asked, PUPPET, UNCHECKED, 1, 0), strict=False):
        late = states[max(k - 1, 0)]
        imu.says = Felt(late[4:8], late[1 + scene.model.nq + 3 : 1 + scene.model.nq + 6])
        expected = checked.added(k, states[k][None])[0]
        found = driven.added(frame)
        if k > 3:  # before, there is nothing as old as that
            np.testing.assert_allclose(found, expected, atol=1e-5)
    assert np.abs(expected).max() > 0.01


def test_what_cannot_run_here_is_named():
    assert missing("open_loop", None) == ""
    assert missing("imu", Told()) == ""
    assert "'imu'; here runs 'open_loop' alone" in missing("imu", None)
    assert "'full_state'; here runs 'open_loop' and 'imu'" in missing("full_state", Told())


def on_its_feet(trajectory: Trajectory, controller: str, *, feels: bool):
    """Drive the puppet's body, which nothing holds: what came of it, and the poses."""
    body = Body(PUPPET, mount="free")
    wire, poses = InProcess(PUPPET, body=body), []

    def watch(state):
        if state.mode == "following":
            poses.append(wire.qpos())

    done = drive(
        PUPPET,
        Played(trajectory, PUPPET, REPORT, controller=controller),
        connect(PUPPET, wire),
        clock=wire,
        watch=watch,
        imu=wire if feels else None,
    )
    return done, np.array(poses)


def test_a_stream_that_needs_an_imu_is_refused_without_one():
    done, poses = on_its_feet(sway(0.5), "imu", feels=False)
    assert (done.mode, done.followed, len(poses)) == ("stopped", 0, 0)
    assert "needs the controller 'imu'; here runs 'open_loop' alone" in done.reason


@pytest.mark.parametrize("controller", ["open_loop", "imu"])
def test_a_body_that_nothing_holds_stands_on_its_servos(controller):
    asked = replace(sway(1.0), contacts={foot.name: np.ones(50, bool) for foot in PUPPET.feet})
    done, poses = on_its_feet(asked, controller, feels=True)
    assert (done.mode, done.followed > 45) == ("safe", True)
    lean = 1 - 2 * (poses[:, 4] ** 2 + poses[:, 5] ** 2)
    assert lean.min() > 0.995
    assert np.abs(poses[:, 2] - PUPPET.nominal.height).max() < 0.01


def test_what_an_imu_says_is_as_old_as_the_rig_says():
    body = Body(replace(PUPPET, sensors=replace(PUPPET.sensors, delay=0.1)), mount="free")
    wire = InProcess(PUPPET, body=body)
    with connect(PUPPET, wire) as bus:
        bus.torque(True)
        bus.write(bus.read().position + 0.2)
        turns, felt = [], []
        for _ in range(20):
            wire.wait(0.01)
            turns.append(wire.qpos()[3:7])
            felt.append(wire.felt().turn)
    np.testing.assert_allclose(felt[10:], turns[:10], atol=5e-3)
    assert np.abs(np.diff(np.array(turns), axis=0)).sum() > 0.05
