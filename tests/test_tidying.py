"""Mending on every mount: parts that overlap, seen by MuJoCo's own contacts; joints that jerk, by a filter's theory."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from retarget.model import load_model
from retarget.rig import Rig, load_rig
from retarget.trajectory import Trajectory
from sim.checks import judge
from sim.fix import judge_mended
from sim.mending.apart import pushed_apart
from sim.mending.smooth import HIGHEST, smoothed
from sim.mending.tidy import leg_joints, tidy

FPS = 50.0
# A hand on its way through the thigh, and one through the belly.
INTO = {
    "puppet": {"right_shoulder_pitch": -0.17, "right_shoulder_roll": -0.2, "right_elbow": 0.49},
    "humanoid": {
        "right_elbow": 2.12,
        "right_shoulder_yaw": -0.81,
        "right_shoulder_pitch": -0.44,
        "right_shoulder_roll": 0.41,
    },
}


def still(rig: Rig, seconds: float = 2.0) -> Trajectory:
    row = [0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)]
    count = round(seconds * FPS)
    contacts = {foot.name: np.ones(count, bool) for foot in rig.feet}
    return Trajectory(np.tile(np.array(row, float), (count, 1)), FPS, rig.name, rig.joint_names(), contacts)


def broken(rig: Rig) -> Trajectory:
    """There and back by half a sine squared in two seconds."""
    plain = still(rig)
    qpos, share = plain.qpos.copy(), np.sin(np.pi * np.arange(len(plain)) / len(plain)) ** 2
    for name, angle in INTO[rig.name].items():
        column = 7 + rig.joint_names().index(name)
        qpos[:, column] += share * (angle - qpos[0, column])
    return replace(plain, qpos=qpos)


def deepest(rig: Rig, qpos: np.ndarray) -> float:
    """Metres that any two parts are inside one another, as `mj_forward` has it."""
    model = load_model(rig)
    data, most = mujoco.MjData(model), 0.0
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_forward(model, data)
        most = max(most, float(-data.contact.dist.min(initial=0.0)))
    return most


@pytest.mark.parametrize("name", INTO)
def test_an_arm_that_goes_through_the_body_goes_round_it(name: str) -> None:
    rig = load_rig(name)
    asked = broken(rig)
    found = pushed_apart(rig, asked.qpos, FPS, ~leg_joints(rig))
    assert found.before == pytest.approx(deepest(rig, asked.qpos), abs=1e-4)
    assert found.before > 0.015
    assert found.after == deepest(rig, found.qpos) == 0
    np.testing.assert_array_equal(found.qpos[:, :7], asked.qpos[:, :7])
    legs = 7 + np.flatnonzero(leg_joints(rig))
    np.testing.assert_array_equal(found.qpos[:, legs], asked.qpos[:, legs])
    low, high = (np.array([getattr(j, end) for j in rig.joints]) for end in ("lower", "upper"))
    assert (found.qpos[:, 7:] >= low - 1e-9).all()
    assert (found.qpos[:, 7:] <= high + 1e-9).all()


def test_a_limb_is_moved_no_farther_than_it_must() -> None:
    """The forearm is 17 mm inside the thigh, 0.19 m below the shoulder: it takes 0.09 rad, and some to be clear."""
    rig = load_rig("puppet")
    asked = broken(rig)
    found = pushed_apart(rig, asked.qpos, FPS, ~leg_joints(rig))
    assert 0.09 < np.abs(found.qpos - asked.qpos).max() < 0.25
    np.testing.assert_allclose(found.qpos[:10], asked.qpos[:10], atol=0.02)  # and not where it is clear


def test_the_gate_refuses_the_one_and_passes_the_other() -> None:
    rig = load_rig("puppet")
    asked = broken(rig)
    assert {"self_collision", "self_contact"} <= {c.name for c in judge(asked, rig)[0].failures()}
    mended, report, _ = judge_mended(asked, rig)
    assert report.ok
    assert [change.name for change in report.changes] == ["apart"]
    assert report.changes[0].amount == pytest.approx(np.abs(mended.qpos - asked.qpos).max())
    assert "17 mm" in report.changes[0].text


def test_parts_that_do_not_meet_stay_where_they_are() -> None:
    rig = load_rig("puppet")
    plain = still(rig)
    assert pushed_apart(rig, plain.qpos, FPS, ~leg_joints(rig)).qpos is plain.qpos
    tidied = tidy(plain, rig, "free")
    assert tidied.trajectory is plain
    assert tidied.changes == ()


@pytest.mark.parametrize("hertz", [1.0, 3.0, 6.0])
def test_a_sine_is_damped_as_a_gaussian_damps_it(hertz: float) -> None:
    """By 2^(−(f / cut)² / 2), and without lag."""
    t = np.arange(400) / FPS
    wave = 0.5 * np.sin(2 * np.pi * hertz * t)
    limit = 0.3 * 0.5 * (2 * np.pi * hertz) ** 3
    out, cut = smoothed(wave[:, None], FPS, limit)
    assert np.isfinite(cut[0])
    middle = slice(100, 300)
    expected = 0.5 ** ((hertz / cut[0]) ** 2 / 2) * wave
    np.testing.assert_allclose(out[middle, 0], expected[middle], atol=5e-3)
    assert np.percentile(np.abs(np.diff(out[:, 0], n=3)) * FPS**3, 99) <= limit


def test_only_the_joint_that_jerks_is_smoothed_and_least() -> None:
    rig, rng = load_rig("puppet"), np.random.default_rng(0)
    plain = still(rig, 4.0)
    qpos = plain.qpos.copy()
    arm = rig.joint_names().index("left_shoulder_pitch")
    qpos[:, 7 + arm] += 0.3 * np.sin(np.pi * np.arange(len(qpos)) / 50) + rng.normal(scale=0.05, size=len(qpos))
    asked = replace(plain, qpos=qpos)
    assert "jerk" in {c.name for c in judge(asked, rig)[0].failures()}
    mended, report, _ = judge_mended(asked, rig)
    assert "jerk" not in {c.name for c in report.failures()}
    change = next(c for c in report.changes if c.name == "smooth")
    assert 3 < change.amount < HIGHEST
    assert "left_shoulder_pitch" in change.text
    others = [7 + i for i in range(len(rig.joints)) if i != arm]
    np.testing.assert_array_equal(tidy(asked, rig, "stand").trajectory.qpos[:, others], qpos[:, others])
    assert mended.contacts.keys() == asked.contacts.keys()


def test_legs_that_stand_are_not_smoothed() -> None:
    """A harness carries the root: a knee that was smoothed would drag its foot."""
    rig, rng = load_rig("puppet"), np.random.default_rng(0)
    plain = still(rig, 4.0)
    qpos = plain.qpos.copy()
    knee = 7 + rig.joint_names().index("left_knee")
    qpos[:, knee] += rng.normal(scale=0.05, size=len(qpos))
    asked = replace(plain, qpos=qpos)
    assert tidy(asked, rig, "hung").trajectory is asked
    assert tidy(asked, rig, "stand").trajectory is not asked
