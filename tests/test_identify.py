"""What is measured of a joint is how the emulated one was made; and a simulation that was told so goes by it."""

import math
from dataclasses import replace

import pytest
from families import rig_of
from small_rig import small_rig

from drivers.bus import BusError
from drivers.calibration import unit_path
from drivers.emulation.body import Body
from drivers.emulation.in_process import InProcess
from drivers.measured import Measured, as_measured, load_measured, save_measured
from drivers.motor import Motor
from drivers.servos.connect import connect
from drivers.servos.identify import identify, unlimited
from retarget.rig import load_rig
from sim.scene import build_scene

PUPPET = load_rig("puppet")
JOINTS = ("right_shoulder_pitch",)


@pytest.fixture(autouse=True)
def config(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


def test_a_body_is_measured_as_it_was_made():
    made = {"right_shoulder_pitch": (3.6, 0.3)}
    joints = tuple(
        replace(j, no_load_speed=made[j.name][0], friction=made[j.name][1]) if j.name in made else j
        for j in PUPPET.joints
    )
    wire = InProcess(PUPPET, body=Body(replace(PUPPET, joints=joints)))
    rig = unlimited(PUPPET)
    with connect(rig, wire) as bus:
        found = identify(PUPPET, bus, JOINTS, wire)
    assert not any(wire.torque().values())
    for joint, (speed, friction) in made.items():
        assert found[joint].no_load_speed == pytest.approx(speed, rel=0.12)
        assert found[joint].friction == pytest.approx(friction, abs=0.05)
        assert 0 <= found[joint].delay < 0.06
        assert found[joint].backlash < math.radians(0.3)


def test_servos_without_a_load_have_no_friction():
    rig = small_rig()
    wire = InProcess(rig)
    with connect(unlimited(rig), wire) as bus:
        found = identify(rig, bus, "b", wire)
    assert found["b"].no_load_speed == pytest.approx(57 * 0.10472, rel=0.25)
    assert found["b"].friction < 0.02
    assert found["b"].delay < 0.005
    assert found["b"].backlash < math.radians(0.25)


@pytest.mark.parametrize("kind", ["dynamixel2", "dynamixel1", "feetech", "lx16a"])
@pytest.mark.parametrize("degrees", [0.0, 1.0, 2.0])
def test_the_play_of_the_gears_is_measured_as_it_was_made(degrees, kind):
    rig = rig_of(kind)
    wire = InProcess(rig)
    wire.servo("b").motor.play = math.radians(degrees)
    with connect(unlimited(rig), wire) as bus:
        found = identify(rig, bus, "b", wire)
    assert math.degrees(found["b"].backlash) == pytest.approx(degrees, abs=0.1 + 0.2 * degrees)


def test_a_motor_crosses_its_play_before_its_shaft_moves():
    motor = Motor(no_load_speed=5.0, full_error=0.1, play=0.02)
    for _ in range(100):
        motor.advance(0.01, 0.5, math.inf)
    assert (motor.angle, motor.slack) == (pytest.approx(0.5), pytest.approx(0.01))
    motor.advance(0.003, 0.4, math.inf)  # 5 rad/s: 0.015 rad, of 0.02
    assert (motor.angle, motor.slack) == (pytest.approx(0.5), pytest.approx(-0.005))
    motor.advance(0.002, 0.4, math.inf)  # 1 ms to the stop, the rest exponential
    assert motor.angle == pytest.approx(0.4 + 0.1 * math.exp(-0.001 / 0.02))


def test_a_stuck_joint_is_no_measurement():
    rig = small_rig()
    wire = InProcess(rig)
    wire.jam("b")
    with connect(unlimited(rig), wire) as bus, pytest.raises(BusError, match=r"b: did not move by 0\.01 rad"):
        identify(rig, bus, "ab", wire)
    assert not any(wire.torque().values())


def test_the_simulation_goes_by_what_was_measured():
    assert as_measured(PUPPET) is PUPPET
    save_measured(PUPPET, {"head_pan": Measured(4.2, 0.03, 0.11, 0.021)})
    save_measured(PUPPET, {"left_knee": Measured(4.4, 0.025, 0.15, 0.005)})
    rig = as_measured(PUPPET)
    pan = rig.joints[0]
    assert (pan.name, pan.no_load_speed, pan.friction, pan.velocity) == (
        "head_pan",
        4.2,
        0.11,
        PUPPET.joints[0].velocity,
    )
    assert rig.sensors.delay == 0.03
    assert {s.joint: s.model.play for s in rig.servos if s.joint in ("head_pan", "left_knee")} == {
        "head_pan": 0.021,
        "left_knee": 0.005,
    }
    assert rig.hash == PUPPET.hash
    model = build_scene(rig, "stand", [0, 0, 1, 1, 0, 0, 0]).model
    assert model.dof_frictionloss[model.joint("left_knee").dofadr[0]] == 0.15
    others = {servo.joint: servo.model.friction for servo in rig.servos}
    assert model.dof_frictionloss[model.joint("right_knee").dofadr[0]] == others["right_knee"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x", "measured/puppet.toml: "),
        ("[tail]\n", "no joint 'tail' in rig 'puppet'; it has head_pan"),
        ("[head_pan]\ndelay = 1.0\n", r"\[head_pan\] should have no_load_speed, delay, friction and backlash"),
        (
            "[head_pan]\nno_load_speed = 4.0\ndelay = -1.0\nfriction = 0.1\nbacklash = 0.0\n",
            r"\[head_pan\] delay = -1.0 should be a number",
        ),
    ],
)
def test_a_wrong_file_is_one_line(text, says):
    path = unit_path("measured", "puppet")
    path.parent.mkdir(parents=True)
    path.write_text(text)
    with pytest.raises(BusError, match=says) as problem:
        load_measured(PUPPET)
    assert "\n" not in str(problem.value)
