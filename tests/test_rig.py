"""Rigs as data: the strict loader, the two built-in rigs, and the MuJoCo models against their `rig.toml`."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import pytest

from retarget.model import load_model, load_spec
from retarget.rig import BUILT_IN, RIG_PATH, RigError, list_rigs, load_rig
from retarget.servos import servo_models

RIGS = ("humanoid", "puppet")
THEIRS = ("apptronik_apollo", "berkeley_humanoid", "booster_t1", "robotis_op3", "unitree_g1", "unitree_h1")


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of the puppet that a test may spoil."""
    return Path(shutil.copytree(BUILT_IN / "puppet", tmp_path / "copied"))


def spoil(folder: Path, old: str, new: str, file: str = "rig.toml") -> None:
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))


def test_built_in_rigs_are_listed_and_found_by_name_folder_and_file(tmp_path: Path) -> None:
    assert list_rigs() == tuple(sorted((*RIGS, *THEIRS)))
    by_name = load_rig("puppet")
    assert load_rig(BUILT_IN / "puppet") == by_name == load_rig(str(BUILT_IN / "puppet" / "rig.toml"))


def test_folders_in_the_environment_add_rigs(copied: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(RIG_PATH, str(copied.parent))
    assert list_rigs() == tuple(sorted(("copied", *RIGS, *THEIRS)))
    assert load_rig("copied").folder == copied.resolve()


def test_puppet_has_the_servos_of_an_op3() -> None:
    rig = load_rig("puppet")
    assert sorted(servo.id for servo in rig.servos) == list(range(1, 21))
    assert [s.joint for s in rig.servos] == list(rig.joint_names())
    light = {s.joint for s in rig.servos if s.model.name == "XL430-W250"}
    assert light == {"head_pan", "head_tilt"}
    assert {s.model.name for s in rig.servos} == {"XL430-W250", "XM430-W350"}
    assert (rig.buses[0].protocol, rig.buses[0].baud, rig.mount) == ("dynamixel2", 1_000_000, "stand")


def test_speed_and_torque_are_the_data_sheet_s() -> None:
    elbow = next(j for j in load_rig("puppet").joints if j.name == "left_elbow")
    assert elbow.torque == 4.1  # N·m at 12 V, XM430-W350
    assert elbow.no_load_speed == pytest.approx(46 / 60 * math.tau)  # 46 rpm
    assert elbow.velocity == pytest.approx(0.7 * elbow.no_load_speed)
    assert elbow.kp * 0.1 == pytest.approx(elbow.torque)
    assert servo_models()["XL430-W250"].model_number == 1060


def test_mass_and_height() -> None:
    for name, mass, height, slack in (("puppet", 3.5, 0.5, 0.1), ("humanoid", 75.0, 1.75, 0.05)):
        model = load_model(load_rig(name))
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        crown = data.geom("head").xpos[2] + model.geom("head").size[2]
        assert model.body_subtreemass[1] == pytest.approx(mass, rel=0.03)
        assert crown == pytest.approx(height, rel=slack)


def test_humanoid_segments_have_de_leva_s_masses() -> None:
    model = load_model(load_rig("humanoid"))
    percent = {"head": 6.94, "left_thigh": 14.16, "right_shin": 4.33, "left_foot": 1.37, "left_upper_arm": 2.71}
    for body, share in percent.items():
        assert model.body(body).mass[0] == pytest.approx(share / 100 * 75, rel=0.03)
    assert model.body("left_forearm").mass[0] == pytest.approx((1.62 + 0.61) / 100 * 75, rel=0.03)
    trunk = sum(model.body(b).mass[0] for b in ("pelvis", "abdomen", "chest"))
    assert trunk == pytest.approx(43.46 / 100 * 75, rel=0.03)


@pytest.mark.parametrize("name", RIGS)
def test_nominal_and_safe_pose_stand_flat_and_touch_nothing(name: str) -> None:
    rig = load_rig(name)
    model = load_model(rig)
    for pose in (rig.nominal, rig.safe):
        data = mujoco.MjData(model)
        data.qpos[:] = [0, 0, pose.height, 1, 0, 0, 0, *rig.pose_vector(pose)]
        mujoco.mj_forward(model, data)
        for foot in rig.feet:
            for site in foot.sites:
                assert abs(data.site(site).xpos[2]) < 1e-3
        assert data.ncon == 0


@pytest.mark.parametrize("name", RIGS)
def test_model_ranges_are_the_rig_s_and_its_sides_mirror(name: str) -> None:
    rig = load_rig(name)
    model = load_model(rig)
    assert model.jnt_range[1:].tolist() == [[j.lower, j.upper] for j in rig.joints]
    data = mujoco.MjData(model)
    for joint in rig.joints:
        if joint.name.startswith("left"):
            data.joint(joint.name).qpos[0] = data.joint(joint.name.replace("left", "right")).qpos[0] = 0.3
    mujoco.mj_kinematics(model, data)
    for site in ("left_hand", "left_toe", "left_heel"):
        x, y, z = data.site(site).xpos
        assert data.site(site.replace("left", "right")).xpos == pytest.approx([x, -y, z])


@pytest.mark.parametrize("name", RIGS)
def test_positive_angles_raise_bend_and_turn_out(name: str) -> None:
    model = load_model(load_rig(name))

    def moved(joint: str, site: str) -> list[float]:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        before = data.site(site).xpos.copy()
        data.joint(joint).qpos[0] = 0.5
        mujoco.mj_kinematics(model, data)
        return (data.site(site).xpos - before).tolist()

    assert moved("left_shoulder_pitch", "left_hand")[0] > 0  # forward
    assert moved("left_shoulder_roll", "left_hand")[1] > 0  # outward
    assert moved("right_shoulder_roll", "right_hand")[1] < 0
    assert moved("right_elbow", "right_hand")[0] > 0
    assert moved("right_hip_pitch", "right_toe")[0] > 0
    assert moved("left_knee", "left_toe")[0] < 0  # the foot goes back
    assert moved("left_ankle_pitch", "left_toe")[2] > 0  # toes up


def test_hash_covers_limits_and_order_but_not_colours(copied: Path) -> None:
    puppet = load_rig("puppet")
    assert load_rig(copied).hash == puppet.hash
    spoil(copied, 'name="white" rgba="0.95', 'name="white" rgba="0.15', "model.xml")
    assert load_rig(copied).hash == puppet.hash
    spoil(copied, "limits = [0.0, 2.4]", "limits = [0.0, 2.3]")
    assert load_rig(copied).hash != puppet.hash
    assert replace(puppet, joints=puppet.joints[::-1]).hash != puppet.hash


def test_limits_of_current_and_temperature_are_the_rigs_or_the_servos(copied: Path) -> None:
    spoil(copied, "limits = [0.0, 2.4]", "limits = [0.0, 2.4]\ncurrent_limit = 1.1\ntemperature_limit = 50")
    servos = {s.joint: s for s in load_rig(copied).servos}
    assert (servos["left_elbow"].max_current, servos["left_elbow"].max_temperature) == (1.1, 50)
    assert servos["head_pan"].max_current == pytest.approx(0.8 * servos["head_pan"].model.stall_current)
    assert servos["head_pan"].max_temperature == 65


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("limits = [0.0, 2.4]", "limits = [0.0, 2.4]\ncurrent_limit = 0", ["current_limit = 0", "above 0"]),
        ("limits = [0.0, 2.4]", "limits = [0.0, 2.4]\nacceleration = 0", ["acceleration = 0", "above 0"]),
        ('mount = "stand"', 'mount = "shelf"', ["mount = 'shelf'", "free, stand, hung"]),
        ('mount = "stand"', 'mounts = "stand"', ["'mount' is missing"]),
        ("stand_clearance", "stand_clearence", ["unknown key 'stand_clearence'", "stand_clearance"]),
        ('bus = "main"', 'bus = "mian"', ["bus = 'mian'", "main"]),
        ('model = "XL430-W250"', 'model = "XL999"', ["'XL999'", "XM430-W350"]),
        ("id = 20", "id = 19", ["id", "19", "twice"]),
        ("id = 20", "id = 2.5", ["id = 2.5", "an integer 0 to 252"]),
        ('joint = "head_tilt"', 'joint = "head_pan"', ["joint 'head_pan' is given twice"]),
        ("limits = [-1.5, 1.5]", "limits = [1.5, -1.5]", ["[1.5, -1.5]", "lower below upper"]),
        ("limits = [0.0, 2.4]", "limits = [0.0, 0.2]", ["left_elbow = 0.3", "0.0 to 0.2"]),
        ("left_elbow = 0.3", "left_elbo = 0.3", ["'left_elbo'", "left_elbow"]),
        ("left_elbow = 0.3", "left_elbow = nan", ["a table of numbers"]),
        ('human = "pelvis"', 'human = "tail"', ["'tail'", "pelvis"]),
        ('human = "pelvis"', 'human = "spine1"', ["the root 'torso' should follow the pelvis"]),
        ('human = "left_elbow"', 'human = "head"', ["human joint 'head' is given twice"]),
        ("delay = 0.02", "delay = -0.02", ["delay = -0.02", "at least 0"]),
        ('mount = "stand"', "mount = stand", ["copied"]),
    ],
)
def test_a_wrong_file_is_one_line_with_the_bad_value_and_the_good_ones(
    copied: Path, old: str, new: str, says: list[str]
) -> None:
    spoil(copied, old, new)
    with pytest.raises(RigError) as caught:
        load_rig(copied)
    message = str(caught.value)
    assert "\n" not in message
    assert str(copied.resolve() / "rig.toml") in message
    for part in says:
        assert part in message


def test_a_rig_that_is_not_there_names_those_that_are() -> None:
    with pytest.raises(RigError, match=r"no rig 'pupet'; known are .*humanoid, puppet"):
        load_rig("pupet")
    with pytest.raises(RigError, match="no rig"):
        load_rig("/nowhere/at/all")


@pytest.mark.parametrize(
    ("file", "old", "new", "says"),
    [
        ("model.xml", 'name="head_pan"', 'name="head_turn"', "head_turn.*are not those of rig.toml: head_pan"),
        ("model.xml", 'name="left_heel"', 'name="left_hell"', "site 'left_heel' is not in the model"),
        ("model.xml", '<freejoint name="root"/>', '<joint name="slide" type="slide"/>', "root.*free joint"),
        ("model.xml", "<worldbody>", "<worldbdy>", "model.xml"),
        ("rig.toml", 'body = "head"', 'body = "heed"', "'heed' is not in the model"),
        ("rig.toml", 'model = "model.xml"', 'model = "modle.xml"', "modle.xml"),
    ],
)
def test_a_model_that_does_not_fit_its_rig_is_an_error(copied: Path, file: str, old: str, new: str, says: str) -> None:
    spoil(copied, old, new, file)
    with pytest.raises(RigError, match=says) as caught:
        load_spec(load_rig(copied))
    assert "\n" not in str(caught.value)
