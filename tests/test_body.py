"""The puppet's body on its emulated bus, against statics, the motor's line, and the heat of a wire."""

import math

import mujoco
import numpy as np
import pytest
from bus_hold import hold

from drivers.bus import BusError
from drivers.emulation.body import COOLING, HEAT_CAPACITY, ROOM, SAG, Body
from drivers.emulation.in_process import InProcess
from drivers.servos.connect import connect
from drivers.servos.x_series import STIFF, full_error
from retarget.model import load_model
from retarget.rig import load_rig

RIG = load_rig("puppet")
JOINTS = RIG.joint_names()
FRICTION = 0.08  # N·m, of the model
TICK = 2 * math.pi / 4096


def gravity_torque(angles: np.ndarray, joint: str) -> float:
    """N·m that hold `joint` still: each part's weight times how far it is from the axis, summed by hand."""
    model = load_model(RIG)
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, 1, 1, 0, 0, 0, *angles]
    mujoco.mj_forward(model, data)
    hinge = model.joint(joint)
    below, torque = {int(hinge.bodyid[0])}, np.zeros(3)
    for b in range(model.nbody):
        if int(model.body_parentid[b]) in below or b in below:
            below.add(b)
            torque += np.cross(data.xipos[b] - data.xanchor[hinge.id], [0, 0, -9.81 * model.body_mass[b]])
    return float(-torque @ data.xaxis[hinge.id])


def test_what_the_bus_says_is_where_the_body_is():
    wire = InProcess(RIG, body=Body(RIG))
    with connect(RIG, wire) as bus:
        reading = bus.read()
        np.testing.assert_allclose(reading.position, wire.qpos()[7:], atol=TICK)
        assert reading.voltage == pytest.approx(np.full(20, 12.0))
        bus.torque(True)
        goal = bus.read().position + 0.2 * (np.array(JOINTS) == "left_elbow")
        reading = hold(wire, bus, goal, 1.0)
        np.testing.assert_allclose(reading.position, wire.qpos()[7:], atol=TICK)
        assert reading.position[JOINTS.index("left_elbow")] == pytest.approx(0.5, abs=0.02)


def test_an_arm_that_is_held_out_sags_by_what_its_weight_takes():
    wire = InProcess(RIG, body=Body(RIG))
    n = JOINTS.index("right_shoulder_pitch")
    with connect(RIG, wire) as bus:
        bus.torque(True)
        start = bus.read().position
        goal = start.copy()
        goal[n] = math.pi / 2
        for k in range(100):
            hold(wire, bus, start + (k + 1) / 100 * (goal - start), 0.02)
        reading = hold(wire, bus, goal, 1.0)
    needed = gravity_torque(reading.position, JOINTS[n])
    assert needed > 0.1
    given = (goal[n] - reading.position[n]) / full_error(STIFF) * 4.1
    assert given == pytest.approx(needed, abs=FRICTION + 4.1 * TICK / full_error(STIFF))


def test_torque_off_lets_an_arm_fall():
    angles = np.array(RIG.pose_vector(RIG.nominal))
    n = JOINTS.index("left_shoulder_pitch")
    angles[n] = 1.6
    wire = InProcess(RIG, angles.tolist(), body=Body(RIG, angles.tolist()))
    wire.wait(3.0)
    assert abs(wire.qpos()[7 + n]) < math.asin(FRICTION / gravity_torque(angles, JOINTS[n])) + 0.05


def test_top_speed_is_the_motors_at_its_voltage():
    wire = InProcess(RIG, body=Body(RIG))
    servo = wire.servo("head_pan")  # its axis is upright: nothing to lift
    servo.put("torque_enable", 1)
    servo.put("goal_position", servo.get("present_position") + 2000)
    speeds = []
    for _ in range(40):
        wire.wait(0.02)
        wire.tick()
        speeds.append(servo.motor.speed)
    lost = (FRICTION + 0.1 * max(speeds)) / 1.4  # of the stall torque: friction and damping of the model
    no_load = 57 * 2 * math.pi / 60
    assert max(speeds) == pytest.approx(no_load * (12.0 / 11.1 - lost), rel=0.05)


def test_a_jammed_servo_heats_and_draws_the_supply_down():
    wire = InProcess(RIG, body=Body(RIG))
    wire.jam("left_knee")
    servo = wire.servo("left_knee")
    servo.put("torque_enable", 1)
    servo.put("goal_position", servo.get("present_position") + 1000)
    wire.wait(20.0)
    amperes = wire.get("left_knee", "present_current") * 2.69e-3
    voltage = wire.get("left_knee", "present_input_voltage") / 10
    assert amperes == pytest.approx(2.3 * voltage / 12, rel=0.02)
    assert voltage == pytest.approx(12.0 - SAG * 12.0 / 10.0 * amperes, abs=0.06)
    lost = amperes**2 * 12.0 / 2.3
    warmer = lost / COOLING * (1 - math.exp(-20.0 * COOLING / HEAT_CAPACITY))
    assert wire.get("left_knee", "present_temperature") == pytest.approx(ROOM + warmer, abs=1.0)
    assert wire.get("right_knee", "present_temperature") == ROOM


def test_a_servo_that_is_too_hot_lets_go_and_is_named():
    wire = InProcess(RIG, body=Body(RIG))
    with connect(RIG, wire) as bus:
        bus.torque(True)
        goal = bus.read().position
        wire.servo("left_knee").put("temperature_limit", 24)
        with pytest.raises(BusError, match=r"servo 14 \(left_knee\): hardware error: overheating"):
            hold(wire, bus, goal, 0.2)
    assert not any(wire.torque().values())


def test_a_share_of_the_torque_is_that_share_of_the_current():
    wire = InProcess(RIG, body=Body(RIG))
    wire.jam("left_knee")
    servo = wire.servo("left_knee")
    servo.put("goal_pwm", round(0.3 * 885))
    servo.put("torque_enable", 1)
    servo.put("goal_position", servo.get("present_position") + 1000)
    wire.wait(0.5)
    assert wire.get("left_knee", "present_current") * 2.69e-3 == pytest.approx(0.3 * 2.3, rel=0.03)


def test_a_rig_without_servos_has_no_body():
    with pytest.raises(BusError, match="'humanoid': a body on the bus needs a servo on every joint"):
        Body(load_rig("humanoid"))
