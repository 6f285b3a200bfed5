"""Robots whose models are not ours: found, described, proposed; what goes wrong is one line."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import mujoco
import numpy as np
import pytest

from motiongen.gestures.catalogue import perform
from retarget.adopt import adopt
from retarget.menagerie import MENAGERIE_ROOT, PACKAGE, menagerie_file
from retarget.model import load_model
from retarget.rig import load_rig
from retarget.shown import cannot_show, missing_parts
from retarget.table import RigError

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
    with pytest.raises(RigError, match=r"MENAGERIE_ROOT.*rigcast\[robots\]"):
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
