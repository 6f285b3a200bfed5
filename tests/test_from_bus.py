"""A puppet that nobody has a model of, from its servos and what somebody says of them to a rig that is driven."""

import json
import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from families import FAMILIES, rig_of

from drivers.bus import BusError
from drivers.emulation.emulator import Emulator
from drivers.emulation.in_process import InProcess
from drivers.servos.newcomers import show, stranger
from drivers.servos.setup import Found, scan
from motiongen.files import save_motion
from motiongen.gestures.catalogue import perform
from retarget.adopt import adopt_puppet
from retarget.capsules import answers, read_answers
from retarget.model import load_model
from retarget.rig import load_rig
from retarget.table import RigError
from rigcast.__main__ import main
from rigcast.from_bus import described

PACKETS = [k for k in FAMILIES if k not in ("maestro", "ssc32")]
PUPPET = load_rig("puppet")
# id: joint, what carries it, axis, from there, degrees, end; as in the built-in puppet's model.xml
ARMS = {
    19: ("head_pan", "base", "z", "0 0 0.165", "-85 85", None),
    20: ("head_tilt", "head_pan", "-y", "0 0 0.018", "-45 30", "0 0 0.08"),
    2: ("left_shoulder_pitch", "base", "-y", "0 0.078 0.13", "-90 190", None),
    4: ("left_shoulder_roll", "left_shoulder_pitch", "x", "0 0.01 0", "-14 160", None),
    6: ("left_elbow", "left_shoulder_roll", "-y", "0, 0.004, -0.09", "0 137", "0 0 -0.1"),
    1: ("right_shoulder_pitch", "base", "-y", "0 -0.078 0.13", "-90 190", None),
    3: ("right_shoulder_roll", "right_shoulder_pitch", "-x", "0 -0.01 0", "-14 160", None),
    5: ("right_elbow", "right_shoulder_roll", "-y", "0 -0.004 -0.09", "0 137", "0 0 -0.1"),
}
FOUND = [Found("dynamixel2", 1_000_000, i, "XL430-W250" if i > 18 else "XM430-W350") for i in ARMS]
UPPER = replace(PUPPET, servos=tuple(s for s in PUPPET.servos if s.id in ARMS))


@pytest.fixture(autouse=True)
def config(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


class Person:
    """Answers each question by what it asks of which joint; `slips` first, whenever there is one for the question."""

    def __init__(self, moved, slips=()):
        self.moved, self.slips, self.asked = moved, list(slips), []

    def __call__(self, question):
        self.asked.append(question)
        for k, (words, wrong) in enumerate(self.slips):
            if words in question:
                del self.slips[k]
                return wrong
        if "which joint was it" in question:
            return ARMS[self.moved[-1]][0]
        rows = {row[0]: row for row in ARMS.values()}
        _, parent, axis, at, limits, tip = rows[question.partition(":")[0]]
        for words, answer in (
            ("carries", parent), ("which axis", axis), ("where is it", at), ("how far", limits), ("end", tip)
        ):  # fmt: skip
            if words in question:
                return answer
        raise AssertionError(question)


def moving(way=1):
    moved = []

    def move(ident):
        moved.append(ident)
        return way

    return moved, move


@pytest.fixture(scope="module")
def puppet():
    moved, move = moving()
    return described(FOUND, move, Person(moved))


@pytest.fixture
def folder(puppet, tmp_path):
    adopt_puppet(puppet, tmp_path / "mine")
    return tmp_path / "mine"


def test_its_joints_are_where_the_built_in_puppet_has_them(folder):
    """The kinematics of a model that was drawn by hand: the same places for any angles."""
    ours, theirs = load_model(load_rig(folder)), load_model(PUPPET)
    a, b = mujoco.MjData(ours), mujoco.MjData(theirs)
    random = np.random.default_rng(0)
    names = [ours.joint(j).name for j in range(1, ours.njnt)]
    b.qpos[:7] = a.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    for _ in range(20):
        angles = random.uniform(-1, 1, len(names))
        for name, angle in zip(names, angles, strict=True):
            a.joint(name).qpos, b.joint(name).qpos = angle, angle
        mujoco.mj_kinematics(ours, a)
        mujoco.mj_kinematics(theirs, b)
        for name in names:
            np.testing.assert_allclose(
                a.xanchor[ours.joint(name).id], b.xanchor[theirs.joint(name).id], atol=1e-9, err_msg=name
            )


def test_the_rig_has_its_servos_and_its_masses(folder, puppet):
    rig, model = load_rig(folder), load_model(load_rig(folder))
    assert {(s.joint, s.id, s.model.name) for s in rig.servos} == {
        (r[0], f.id, f.model) for f in FOUND for r in [ARMS[f.id]]
    }
    assert (rig.mount, rig.sensors.imu, rig.buses[0].protocol) == ("stand", False, "dynamixel2")
    limits = {j.name: (j.lower, j.upper) for j in rig.joints}
    assert limits["left_shoulder_roll"] == pytest.approx((math.radians(-14), math.radians(160)), abs=1e-4)
    assert model.body("left_elbow").mass[0] == pytest.approx(1.5 * 0.082)
    assert read_answers(folder / "answers.toml") == puppet
    assert {f.human for f in rig.follow} >= {"head", "left_wrist", "right_wrist", "left_elbow"}


def test_slips_are_told_and_asked_again(puppet, capsys):
    moved, move = moving()
    person = Person(
        moved,
        [("servo 19", ""), ("servo 20", "head_pan"), ("servo 20", "Head Tilt!"), ("carries", "tail"), ("axis", "up"),
         ("where is it", "0 5"), ("where is it", "0 5 0"), ("how far", "10 20"), ("how far", "-10 x"),
         ("how far", "-300 300")],
    )  # fmt: skip
    assert described(FOUND, move, person) == puppet
    assert moved[:3] == [19, 19, 20]
    told = capsys.readouterr().err
    slips = ("'head_pan' is taken", "small letters", "'tail' is none of base, head_tilt", "'up' is none of x, -x")
    for words in (
        *slips,
        "'0 5' is not 3 numbers",
        "metres, at most 2",
        "from at most 0 to at least 0",
        "not 2 numbers",
    ):
        assert words in told, words


def test_an_axis_of_a_servo_that_went_backwards_first_is_turned(puppet):
    moved, move = moving(way=-1)
    axes = [p.axis for p in described(FOUND, move, Person(moved)).parts]
    assert axes == [p.axis.removeprefix("-") if p.axis.startswith("-") else f"-{p.axis}" for p in puppet.parts]


def test_joints_that_carry_each_other_are_one_line():
    moved, move = moving()
    loop = [("left_elbow: which joint carries", "left_shoulder_roll"), ("left_shoulder_pitch: which", "left_elbow")]
    with pytest.raises(ValueError, match=r"left_\w+: its parents lead back to itself, not to the 'base'; begin anew"):
        described(FOUND, move, Person(moved, [*loop, ("left_elbow: where does", "0 0 0")]))


@pytest.mark.parametrize("kind", PACKETS)
def test_one_servo_is_shown_and_then_all_are_limp(kind):
    rig = rig_of(kind)
    wire = InProcess(rig, [0.3, -0.2, 1.4])
    found = list(scan(wire, protocols=(rig.buses[0].protocol,), highest_id=9))
    before = {j: wire.get(j, "present_position") for j in "abc"}
    assert show(stranger(found), wire, 7, wire) == 1
    turn = rig.servos[1].model.ticks_per_turn / (2 * math.pi)
    goals = [e.value & 0xFFFF for e in wire.events("goal_position") if e.id == 7]
    assert max(goals) - before["b"] == pytest.approx(0.15 * turn, abs=2)
    assert all(
        abs((e.value & 0xFFFF) - before[j]) <= 1
        for j, i in (("a", 3), ("c", 1))
        for e in wire.events("goal_position")
        if e.id == i
    )
    assert not any(wire.torque().values())


def test_near_its_end_it_goes_the_other_way():
    rig = rig_of("dynamixel1")
    wire = InProcess(rig, [0.0, 0.0, 0.0])
    wire.servo("b").motor.angle = 1020 * 2 * math.pi / 1227.6
    assert show(stranger(list(scan(wire, protocols=("dynamixel1",), highest_id=9))), wire, 7, wire) == -1


@pytest.mark.parametrize(
    ("found", "says"),
    [
        ([], "no servo answered: check power, cable"),
        (
            [FOUND[0], replace(FOUND[1], baud=57_600)],
            "several kinds answered: dynamixel2 at 57600, dynamixel2 at 1000000",
        ),
        ([replace(FOUND[0], model="unknown (350)")], r"servo 19 is of model unknown \(350\); known are XM430-W350"),
    ],
)
def test_servos_that_make_no_rig(found, says):
    with pytest.raises(BusError, match=says):
        stranger(found)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("id = 6", "id = 4", "servo id 4 is given twice"),
        ('joint = "left_elbow"', 'joint = "right_elbow"', "joint 'right_elbow' is given twice"),
        ('parent = "left_shoulder_roll"', 'parent = "tail"', "left_elbow: parent 'tail' is unknown; known are base, "),
        ('parent = "left_shoulder_roll"', 'parent = "left_elbow"', "left_elbow: parent 'left_elbow' is unknown"),
        ("tip = [0, 0, 0.08]", "", "head_tilt: a joint that carries no other has a tip"),
        ('axis = "z"', 'axis = "up"', "axis = 'up' should be one of x, "),
        ("limits = [-45, 30]", "limits = [30, -45]", r"limits = \[30, -45\] should be"),
        ("limits = [-45, 30]", "limits = [-345, 30]", "head_tilt: limits are wider than the 360° of a XL430-W250"),
        ('protocol = "dynamixel2"', 'protocol = "feetech"', "model XL430-W250 speaks dynamixel2, the bus feetech"),
        ("baud =", "bauds =", "key 'baud' is missing"),
    ],
)
def test_answers_that_are_wrong_are_one_line(old, new, says, puppet, tmp_path):
    text = answers(puppet)
    assert old in text
    (tmp_path / "answers.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(RigError, match=says) as problem:
        read_answers(tmp_path / "answers.toml")
    assert str(problem.value).startswith(str(tmp_path / "answers.toml"))


def test_from_the_port_to_a_driven_rig(puppet, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("drivers.servos.setup.SCAN_PATIENCE_S", 0.5)
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 100)
    monkeypatch.setattr("rigcast.rigs.RANGE_OF_MOTION", ("wave",))
    (tmp_path / "said.toml").write_text(answers(puppet))
    mine, wave = str(tmp_path / "mine"), str(tmp_path / "wave.npz")
    with Emulator(UPPER) as emulator:
        new = ["rigs", "new", "--from-bus", emulator.port, "--protocol", "dynamixel2", "--baud", "1000000"]
        told = ["--answers", str(tmp_path / "said.toml"), "--out", mine, "--no-picture"]
        assert main([*new, "--highest-id", "19", *told]) == 2
        assert "said.toml: servo 20 (XL430-W250) has no answer on the bus" in capsys.readouterr().err
        assert not Path(mine).exists()
        assert main([*new, "--highest-id", "20", *told]) == 0
        assert f"next: rigcast rigs check {mine}; rigcast bus calibrate --port" in capsys.readouterr().out
        assert emulator.events("torque_enable") == []
        assert main([*new, "--highest-id", "20", *told]) == 2
        assert "rig.toml: is there already" in capsys.readouterr().err
    assert main(["rigs", "check", mine, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["gestures"][0]["ok"]
    save_motion(perform("wave"), Path(wave))
    assert main(["play", wave, "--rig", mine, "--drive", "emulated", "--json"]) == 0
    driven = json.loads(capsys.readouterr().out)["driven"]
    assert driven["mode"] == "safe"
    assert max(driven["rms_error"]) < 0.2


@pytest.mark.parametrize(
    ("args", "says"),
    [
        ([], "give a MODEL, or --from-bus PORT"),
        (["robot.xml", "--from-bus", "/dev/none"], "give a MODEL, or --from-bus PORT"),
        (["robot.xml", "--answers", "said.toml"], "go with --from-bus"),
        (["--from-bus", "/dev/none", "--limit", "1"], "--gmr and --limit are for a MODEL"),
        (["--from-bus", "/dev/none", "--protocol", "feetech"], "cannot open serial port '/dev/none'"),
        (["--from-bus", "/dev/none", "--protocol", "maestro"], "protocol 'maestro' cannot be scanned"),
    ],
)
def test_what_the_verb_refuses_is_one_line(args, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["rigs", "new", *args]) == 2
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert says in told
