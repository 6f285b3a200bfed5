"""The first runs of a unit: nothing before somebody saw its joints turn the right way, then slowly and weakly."""

import io
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from families import FAMILIES, rig_of
from small_rig import REPORT, swing

from drivers.bus import BusError
from drivers.calibration import load_calibration, unit_path
from drivers.drive import Settings, drive
from drivers.emulation.body import Body
from drivers.emulation.in_process import InProcess
from drivers.follow import slowed
from drivers.played import Played
from drivers.servos.connect import connect
from drivers.servos.wiggle import wiggle
from drivers.trust import Trust, fingerprint, remember, trust_in
from drivers.watchdog import Patience
from retarget.model import load_model
from retarget.reach import lever_arms
from retarget.rig import load_rig
from retarget.trajectory import Trajectory
from retarget.way import way_of
from rigcast import driving
from rigcast.__main__ import main

PACKETS = [k for k in FAMILIES if k not in ("maestro", "ssc32")]
PUPPET = load_rig("puppet")
SHORT = Patience(hold_s=0.3, safe_s=0.6)


@pytest.fixture(autouse=True)
def config(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path


# --- no hand faster than that


@pytest.mark.parametrize("name", ["puppet", "humanoid"])
def test_no_body_is_faster_than_the_sum_of_its_lever_arms(name):
    rig, random = load_rig(name), np.random.default_rng(0)
    arms, model = lever_arms(rig), load_model(rig)
    data, velocity, shares = mujoco.MjData(model), np.zeros(6), []
    for _ in range(100):
        data.qpos[:7] = [0, 0, 1, 1, 0, 0, 0]
        data.qpos[7:] = [random.uniform(j.lower, j.upper) for j in rig.joints]
        data.qvel[6:] = random.normal(size=len(rig.joints))
        mujoco.mj_forward(model, data)
        fastest = 0.0
        for body in range(1, model.nbody):
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, body, velocity, 0)
            fastest = max(fastest, float(np.linalg.norm(velocity[3:])))
        shares.append(fastest / float((arms @ np.abs(data.qvel[6:])).max()))
    assert 0.3 < max(shares) <= 1.0


def test_a_model_that_is_no_plain_tree_is_taken_for_long(tmp_path):
    (tmp_path / "model.xml").write_text("<mujoco><include file='other.xml'/></mujoco>")
    arms = lever_arms(replace(PUPPET, model=tmp_path / "model.xml"))
    np.testing.assert_array_equal(arms, np.full((1, 20), PUPPET.nominal.height))


def test_a_step_is_slowed_as_a_whole():
    arms = np.array([[0.2, 0.1, 0.0], [0.0, 0.0, 0.3]])
    start = np.zeros(3)
    moved, held = slowed(start, np.array([0.1, -0.2, 0.1]), arms, 0.02)
    np.testing.assert_allclose(moved, np.array([0.1, -0.2, 0.1]) / 2)
    assert held
    moved, held = slowed(start, np.array([0.01, 0.02, 0.03]), arms, 0.02)
    np.testing.assert_array_equal(moved, [0.01, 0.02, 0.03])
    assert not held


def test_a_gentle_run_is_slow_at_the_hand_and_weak():
    n = PUPPET.joint_names().index("right_shoulder_pitch")
    qpos = np.zeros((60, 27))
    qpos[:, 3] = 1.0
    qpos[:, 7:] = PUPPET.pose_vector(PUPPET.nominal)
    qpos[:, 7 + n] += 0.8 * (1 - np.cos(np.arange(60) / 60 * np.pi)) / 2
    wire, told = InProcess(PUPPET, body=Body(PUPPET)), []
    source = Played(Trajectory(qpos, 50.0, "puppet", PUPPET.joint_names()), PUPPET, REPORT, SHORT)
    bus = connect(PUPPET, wire, torque_share=0.3)
    drive(PUPPET, source, bus, Settings(hand_speed=0.25), clock=wire, watch=told.append)
    commands = np.array([s.command for s in told if s.command])
    model = load_model(PUPPET)
    data, hands = mujoco.MjData(model), []
    for row in commands:
        data.qpos[:] = [0, 0, 0.3, 1, 0, 0, 0, *row]
        mujoco.mj_kinematics(model, data)
        hands.append(data.site("right_hand").xpos.copy())
    speed = np.linalg.norm(np.diff(hands, axis=0), axis=1) * 50
    assert 0.1 < speed.max() <= 0.25
    limits = {e.value for e in wire.events("goal_pwm")}
    assert max(limits) == round(0.3 * 885)


@pytest.mark.parametrize("kind", PACKETS)
def test_a_share_of_the_torque_is_all_that_is_ever_given(kind):
    rig = rig_of(kind)
    wire = InProcess(rig)
    with connect(rig, wire, torque_share=0.3) as bus:
        bus.torque(True)
        model = wire.servo("a").model
        if model.torque is None:
            assert kind in ("lx16a", "feetech scs")
            return
        limit = model.torque[0]
        assert max(e.value for e in wire.events(limit)) == round(0.3 * model.by_name[limit].high)
    with pytest.raises(BusError, match=r"torque_share 1\.5; it is above 0"):
        connect(rig, wire, torque_share=1.5)


# --- the sign test


@pytest.mark.parametrize("kind", FAMILIES)
def test_each_joint_moves_alone_and_comes_back(kind):
    rig = rig_of(kind)
    wire, seen = InProcess(rig), []

    def ask(joint, way):
        seen.append((joint, way, [wire.get(j, "present_position") for j in "abc"]))
        return joint != "b"

    start = [wire.get(j, "present_position") for j in "abc"]
    with connect(rig, wire) as bus:
        rest = [wire.get(j, "present_position") for j in "abc"] if kind in PACKETS else None
        assert wiggle(rig, bus, "abc", ask, wire) == ("b",)
    assert [(joint, way) for joint, way, _ in seen] == [("a", 1), ("b", 1), ("c", 1)]
    turn = rig.servos[0].model.ticks_per_turn / (2 * np.pi)
    if rest is not None:
        for k, (_, _, ticks) in enumerate(seen):
            moved = (np.array(ticks) - start) / turn
            assert moved[k] == pytest.approx(0.15, abs=0.02)
            assert np.abs(np.delete(moved, k)).max() < 0.02
    assert not any(wire.torque().values())


@pytest.mark.parametrize("kind", PACKETS)
def test_a_joint_that_does_not_move_is_told(kind):
    rig = rig_of(kind)
    wire = InProcess(rig)
    wire.jam("b")
    with connect(rig, wire) as bus, pytest.raises(BusError, match=r"b was told to turn by \+0.15 rad and turned by"):
        wiggle(rig, bus, "abc", lambda joint, way: True, wire)
    assert not any(wire.torque().values())


def test_near_its_limit_a_joint_goes_backwards():
    rig = rig_of("feetech")
    wire, ways = InProcess(rig, [1.45, 0.0, 0.0]), []
    with connect(rig, wire) as bus:
        wiggle(rig, bus, "ab", lambda joint, way: not ways.append((joint, way)), wire)
        with pytest.raises(ValueError, match="no joint 'z' with a servo in rig 'small'; it has a, b, c"):
            wiggle(rig, bus, "z", lambda joint, way: True, wire)
    assert ways == [("a", -1), ("b", 1)]


@pytest.mark.parametrize(
    ("joint", "way", "seen"),
    [
        ("left_shoulder_roll", 1, "left_hand goes left"),
        ("right_shoulder_pitch", 1, "right_hand goes forward"),
        ("right_ankle_pitch", -1, "right_toe goes down"),
        ("head_pan", 1, "neck turns to the left"),
    ],
)
def test_what_somebody_should_see(joint, way, seen):
    assert way_of(PUPPET, joint, way) == seen


# --- what a unit has shown


def test_it_is_remembered_for_this_unit_alone():
    rig = rig_of("feetech")
    unit = fingerprint(rig, "/dev/ttyUSB0")
    assert trust_in(rig, unit) is None
    remember(rig, unit, Trust(2))
    assert trust_in(rig, unit) == Trust(2)
    turned = replace(load_calibration(rig), direction=np.array([1, -1, 1]))
    others = [fingerprint(rig, "/dev/ttyUSB1"), fingerprint(rig, "/dev/ttyUSB0", turned)]
    others.append(fingerprint(rig_of("dynamixel2"), "/dev/ttyUSB0"))
    assert [trust_in(rig, other) for other in others] == [None] * 3
    assert (Trust(2).gentle, Trust(3).gentle) == (True, False)


@pytest.mark.parametrize("text", ["x", "[a]\nruns = -1", "[a]\nruns = 'many'", "a = 1"])
def test_a_damaged_file_is_one_line(text):
    path = unit_path("trust", "small")
    path.parent.mkdir(parents=True)
    path.write_text(text)
    with pytest.raises(BusError, match=r"trust/small\.toml: ") as problem:
        trust_in(rig_of("feetech"), "a")
    assert "\n" not in str(problem.value)


class OnWire:
    """Stands in for serial ports: every bus is this one in process."""

    def __init__(self, rig, monkeypatch):
        self.wire = InProcess(rig)
        self.shares = []

        def bus_on(port, body, *, gentle=False, mount=None):
            self.shares.append(0.3 if gentle else 1.0)
            return connect(body, self.wire, torque_share=self.shares[-1]), self.wire

        monkeypatch.setattr("rigcast.driving.bus_on", bus_on)


def test_three_gentle_runs_after_the_sign_test(monkeypatch):
    rig = rig_of("feetech")
    bench = OnWire(rig, monkeypatch)

    def once():
        source = Played(swing(rig), rig, REPORT, SHORT)
        return driving.run(rig, "/dev/ttyUSB0", source, driving.Driving(), lambda: "")

    with pytest.raises(BusError, match=r"nobody has seen .* rigcast bus wiggle --port /dev/ttyUSB0 --rig small"):
        once()
    assert bench.shares == []
    remember(rig, fingerprint(rig, "/dev/ttyUSB0"), Trust(0))
    assert [once().mode for _ in range(4)] == ["safe"] * 4
    assert bench.shares == [0.3, 0.3, 0.3, 1.0]


def test_a_run_that_trips_does_not_count(monkeypatch):
    rig = rig_of("feetech")
    bench = OnWire(rig, monkeypatch)
    remember(rig, fingerprint(rig, "/dev/ttyUSB0"), Trust(0))
    bench.wire.jam("a")
    source = Played(swing(rig, amplitude=1.0), rig, REPORT, SHORT)
    assert driving.run(rig, "/dev/ttyUSB0", source, driving.Driving(), lambda: "").mode == "tripped"
    assert trust_in(rig, fingerprint(rig, "/dev/ttyUSB0")) == Trust(0)


@pytest.mark.parametrize(("answers", "code"), [("y\ny\ny\n", 0), ("y\nwhat\nn\ny\n", 1), ("y\n", 2)])
def test_the_verb(answers, code, monkeypatch, capsys):
    rig = rig_of("feetech")
    OnWire(rig, monkeypatch)
    monkeypatch.setattr("rigcast.setting_up.load_rig", lambda name: rig)
    monkeypatch.setattr("retarget.way.way_of", lambda rig, joint, way: f"{joint} goes up")
    monkeypatch.setattr("sys.stdin", io.StringIO(answers))
    assert main(["bus", "wiggle", "--port", "/dev/ttyUSB0", "--rig", "small"]) == code
    told = capsys.readouterr()
    assert "a: a goes up – did it? [y/n]" in told.err
    if code == 1:
        assert "b turns the wrong way: rigcast bus calibrate --port /dev/ttyUSB0 --rig small --joint b" in told.err
    trust = trust_in(rig, fingerprint(rig, "/dev/ttyUSB0"))
    assert trust == (Trust(0) if code == 0 else None)
