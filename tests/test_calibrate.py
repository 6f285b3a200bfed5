"""Calibrating by hand: the hand turns the emulated shafts, and what is found is how the unit was built."""

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from families import FAMILIES, rig_of

from drivers.bus import BusError
from drivers.calibration import Calibration, Mark, calibration_path, load_calibration, save_marks
from drivers.emulation.emulator import Emulator
from drivers.emulation.in_process import InProcess
from drivers.servos.calibrate import calibrate, mark
from drivers.servos.port import Port
from rigcast.__main__ import main

PACKETS = [k for k in FAMILIES if k not in ("maestro", "ssc32")]


def built(rig):
    """How this unit was built: joint b backwards, zeros off the middle."""
    plain = load_calibration(rig)
    return replace(plain, direction=np.array([1, -1, 1]), zero=plain.zero + np.array([7, -11, 0]))


class Hand:
    """Moves the joint that it is told to: to zero, then 0.3 rad forwards."""

    def __init__(self, rig, wire, calibration: Calibration, reach=0.3):
        self.rig, self.wire, self.calibration, self.reach = rig, wire, calibration, reach
        self.asked = []

    def __call__(self, what):
        assert not any(self.wire.torque().values())
        self.asked.append(what)
        joint, _, words = what.partition(":")
        n = "abc".index(joint)
        angles = np.zeros(3)
        angles[n] = 0.0 if "zero" in words else self.reach
        ticks = self.calibration.ticks(angles)[n]
        servo = self.rig.servos[n]
        self.wire.servo(joint).motor.angle = ticks * 2 * math.pi / servo.model.ticks_per_turn


@pytest.mark.parametrize("kind", PACKETS)
def test_what_is_found_is_how_the_unit_was_built(kind, tmp_path):
    rig = rig_of(kind)
    wire, truth = InProcess(rig, [0.4, -0.2, 0.1], built(rig)), built(rig)
    hand = Hand(rig, wire, truth)
    path = save_marks(rig, calibrate(rig, wire, "abc", hand), tmp_path / "small.toml")
    found = load_calibration(rig, path)
    assert found.direction.tolist() == truth.direction.tolist()
    assert found.zero.tolist() == truth.zero.tolist()
    assert len(hand.asked) == 6
    assert wire.events("goal_position") == []


def test_joints_that_were_not_calibrated_keep_what_they_have(tmp_path):
    rig, path = rig_of("feetech"), tmp_path / "new" / "small.toml"
    save_marks(rig, {"a": Mark(-1, 2100)}, path)
    save_marks(rig, {"b": Mark(1, 2000)}, path)
    found = load_calibration(rig, path)
    assert found.direction.tolist() == [-1, 1, 1]
    assert found.zero.tolist() == [2100, 2000, 2048]
    with pytest.raises(BusError, match=r"\[b\] zero 9000"):
        save_marks(rig, {"b": Mark(1, 9000)}, path)
    assert load_calibration(rig, path).zero.tolist() == [2100, 2000, 2048]


@pytest.mark.parametrize(
    ("zero", "forwards", "says"),
    [
        (2048, 2100, "moved 52 ticks only, of 114"),
        (100, 4000, "went from 100 to 4000 ticks, past the servo's end"),
        (-20, 300, r"stands at -20 ticks, beyond 0…4095"),
    ],
)
def test_a_joint_that_was_not_moved_or_wraps(zero, forwards, says):
    with pytest.raises(BusError, match=says):
        mark(rig_of("feetech").servos[0], zero, forwards)


def test_what_cannot_be_calibrated():
    rig = rig_of("feetech")
    wire = InProcess(rig)
    near_the_end = replace(load_calibration(rig), zero=np.array([300, 2048, 2048]))
    with pytest.raises(BusError, match="joint 'a': its limits are ticks"):
        calibrate(rig, wire, "a", Hand(rig, wire, near_the_end))
    with pytest.raises(BusError, match="no joint 'z' with a servo in rig 'small'; it has a, b, c"):
        calibrate(rig, wire, ["z"], print)
    with pytest.raises(BusError, match="cannot be felt"):
        calibrate(rig_of("maestro"), InProcess(rig_of("maestro")), "a", print)


def test_the_verb(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    monkeypatch.setitem(Port.__init__.__kwdefaults__, "patience_s", 1.0)
    monkeypatch.setattr("rigcast.bus.load_rig", lambda name: rig_of(name))
    rig = rig_of("feetech")
    with Emulator(rig) as emulator:
        hand = Hand(rig, emulator, built(rig))

        class Keys(io.StringIO):
            def readline(self, size=-1):
                hand(capsys.readouterr().err.splitlines()[-1])
                return "\n"

        monkeypatch.setattr("sys.stdin", Keys())
        arguments = ["bus", "calibrate", "--port", emulator.port, "--rig", "feetech", "--joint", "b"]
        assert main(arguments) == 0
        out = capsys.readouterr().out
        assert "b: direction -1, zero 2037" in out
        assert str(calibration_path("small")) in out
        monkeypatch.setattr("sys.stdin", io.StringIO())
        assert main(arguments) == 2
        assert "its input has ended" in capsys.readouterr().err
