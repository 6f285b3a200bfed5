"""A retargeted rig on the floor: where its feet are, how far it goes, how high it jumps; and on its stand."""

from __future__ import annotations

from dataclasses import replace

import motions
import numpy as np
import pytest
from retargeted import RIGS, done, shown_at, soles

from retarget.contacts import runs
from retarget.retarget import retarget
from retarget.rig import load_rig


@pytest.mark.parametrize(("rig", "clip"), [("humanoid", "walk"), ("humanoid", "squat"), ("puppet", "squat")])
def test_planted_feet_stand_still_on_the_floor(rig: str, clip: str) -> None:
    trajectory = done(rig, clip, "hung")
    points = soles(trajectory)
    stances = 0
    for i, foot in enumerate(load_rig(rig).feet):
        for start, end in runs(trajectory.contacts[foot.name]):
            stance = points[start:end, i]
            assert np.linalg.norm((stance - stance[0])[..., :2], axis=-1).max() < 0.002
            assert np.abs(stance[..., 2]).max() < 0.002
            stances += 1
    assert stances == (8 if clip == "walk" else 2)


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("clip", ["stand", "walk", "squat"])
def test_the_lowest_sole_is_on_the_floor_and_never_below(rig: str, clip: str) -> None:
    low = soles(done(rig, clip, "hung"))[..., 2].min((1, 2))
    assert low.min() > -1e-6
    assert low.max() < 0.002


def test_the_root_travels_by_the_ratio_of_the_legs() -> None:
    for rig, legs in (("humanoid", 0.42 + 0.43), ("puppet", 0.110 + 0.110)):
        trajectory = done(rig, "walk", "hung")
        wanted = 1.2 * 4 * legs / (motions.THIGH + motions.SHIN)
        assert trajectory.root_pos[-1, 0] == pytest.approx(wanted, rel=0.04)
        assert abs(trajectory.root_pos[-1, 1]) < 0.05 * legs


def test_a_jump_keeps_its_height() -> None:
    """Free fall for 0.5 s from a stand rises by g t² / 8 = 0.31 m; the humanoid's legs are 1.05 times as long."""
    still = motions.stand(2.0, 50)
    t = np.arange(len(still)) / 50 - 0.75
    rise = np.where((t > 0) & (t < 0.5), 9.81 / 2 * t * (0.5 - t), 0.0)
    clip = replace(still, root_pos=still.root_pos + rise[:, None] * [0, 0, 1])
    trajectory = retarget(clip, load_rig("humanoid"))
    height = trajectory.root_pos[:, 2] - trajectory.root_pos[shown_at(clip, trajectory, 0.3), 2]
    assert height.max() == pytest.approx(9.81 * 0.5**2 / 8 * 0.85 / 0.81, rel=0.05)
    assert not trajectory.contacts["left_foot"][shown_at(clip, trajectory, 1.0)]


@pytest.mark.parametrize("rig", RIGS)
def test_on_a_stand_the_root_is_still_and_the_feet_hang(rig: str) -> None:
    description = load_rig(rig)
    trajectory = done(rig, "walk", "stand")
    height = description.nominal.height + description.stand_clearance
    assert trajectory.qpos[:, :7] == pytest.approx(np.tile([0, 0, height, 1, 0, 0, 0], (len(trajectory), 1)), abs=1e-9)
    assert soles(trajectory)[0, ..., 2] == pytest.approx(description.stand_clearance, abs=1e-3)
    assert not any(flags.any() for flags in trajectory.contacts.values())
    knees = trajectory.joint_pos[:, [description.joint_names().index(f"{s}_knee") for s in ("left", "right")]]
    assert np.ptp(knees, axis=0).min() > 0.3


def test_contact_labels_of_the_motion_come_first() -> None:
    clip = motions.stand(1.0)
    lifted = np.ones((len(clip), 4), bool)
    lifted[:, 2:] = False
    trajectory = retarget(replace(clip, contacts=lifted), load_rig("humanoid"))
    assert trajectory.contacts["left_foot"].any()
    assert not trajectory.contacts["right_foot"].any()
