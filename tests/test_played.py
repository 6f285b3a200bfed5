"""A trajectory that is driven without a wire: the same gate, and it waits until the rig is where it begins."""

import json
import math

import numpy as np
import pytest
from small_rig import REPORT, small_rig, swing
from test_cli import still

from drivers.calibration import load_calibration
from drivers.drive import Settings, drive
from drivers.emulation.emulator import Emulator
from drivers.emulation.in_process import InProcess
from drivers.frame import UNCHECKED
from drivers.played import BEGIN_S, Played
from drivers.servos.connect import connect
from drivers.servos.port import Port
from drivers.watchdog import Patience
from retarget.files import save_trajectory
from retarget.rig import load_rig
from rigcast.__main__ import main

RIG = small_rig()
SHORT = Patience(hold_s=0.3, safe_s=0.6)


def play(pose, report=REPORT, trajectory=None):
    """Drive the swing on an emulated bus that stands at `pose`; the result, and the goals (s, rad) of joint a."""
    wire = InProcess(RIG, pose)
    source = Played(trajectory or swing(RIG), RIG, report, SHORT)
    done = drive(RIG, source, connect(RIG, wire), Settings(settle_s=0.1), clock=wire)
    middle = load_calibration(RIG).zero[0]
    goals = [(e.time, (e.value - middle) * 2 * math.pi / 4096) for e in wire.events("goal_position") if e.id == 3]
    return done, goals, wire


def test_the_motion_is_commanded_as_it_was_made():
    done, goals, wire = play(RIG.pose_vector(RIG.nominal))
    assert (done.mode, done.reason, done.refused) == ("safe", "the stream ended", {})
    assert done.accepted >= 50
    top = max(goals, key=lambda goal: goal[1])
    began = top[0] - 0.5  # the swing is highest half a second after its start
    for t, angle in goals:
        if began < t < began + 0.9:
            asked = 0.2 + 0.2 * (1 - math.cos(2 * math.pi * (t - began)))
            assert angle == pytest.approx(asked, abs=0.04)
    assert not any(wire.torque().values())


def test_it_begins_once_the_rig_has_come_to_its_first_pose():
    _, near, _ = play(RIG.pose_vector(RIG.nominal))
    _, far, _ = play([-1.3, 0.0, 0.5])
    highest = [max(goals, key=lambda goal: goal[1]) for goals in (near, far)]
    assert highest[0][1] == pytest.approx(0.6, abs=0.02)
    assert highest[1][1] == pytest.approx(0.6, abs=0.02)
    # 1.5 rad at 1 rad/s, 0.1 of it to spare, once the torque is up after 0.3 s, in which the other rests already.
    assert highest[1][0] - highest[0][0] == pytest.approx(1.7, abs=0.2)


def test_it_does_not_wait_for_ever():
    source = Played(swing(RIG), RIG, REPORT)
    at = [source.poll(round(t * 1e9)) for t in (0.0, 1.0, BEGIN_S, BEGIN_S + 0.1, BEGIN_S + 0.6)]
    assert [frame.pos[0, 0] for frame in at] == pytest.approx([0.2, 0.2, 0.2, 0.2, 0.6], abs=1e-3)


def test_what_no_report_passed_moves_nothing():
    source = Played(swing(RIG), RIG, UNCHECKED)
    assert [source.poll(k * 20_000_000) for k in range(3)] == [None] * 3
    assert source.gate.refused == {"unchecked": 3}
    assert source.watchdog.mode == "waiting"


def test_unchecked_and_a_drive_exclude_each_other(tmp_path, capsys):
    save_trajectory(still(), tmp_path / "still.npz")
    assert main(["play", str(tmp_path / "still.npz"), "--unchecked", "--drive", "emulated"]) == 2
    assert "never reaches a servo" in capsys.readouterr().err
    assert main(["play", str(tmp_path / "still.npz"), "--drive", "/dev/none"]) == 2
    assert "cannot open serial port '/dev/none': No such file" in capsys.readouterr().err


def test_from_a_file_to_the_body_on_the_emulated_bus(tmp_path, capsys):
    save_trajectory(still(), tmp_path / "still.npz")
    assert main(["play", str(tmp_path / "still.npz"), "--drive", "emulated", "--json"]) == 0
    driven = json.loads(capsys.readouterr().out)["driven"]
    assert driven["mode"] == "safe"
    assert driven["followed"] > 10
    assert 0 < max(driven["rms_error"]) < 0.05


def test_over_a_serial_path_the_body_moves(monkeypatch):
    from drivers.emulation.body import Body

    monkeypatch.setitem(Port.__init__.__kwdefaults__, "patience_s", 1.0)
    rig = load_rig("puppet")
    with Emulator(rig, body=Body(rig)) as emulator:
        before = emulator.qpos()
        n = rig.joint_names().index("head_pan")
        with connect(rig, emulator.port) as bus:
            bus.torque(True)
            goal = bus.read().position
            goal[n] += 0.3
            hold_real(bus, goal)
        np.testing.assert_allclose(emulator.qpos()[7 + n] - before[7 + n], 0.3, atol=0.05)


def hold_real(bus, goal):
    import time

    for _ in range(40):
        bus.write(goal)
        bus.read()
        time.sleep(0.02)
