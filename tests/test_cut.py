"""Trajectories that end before their time, and that begin where the one before them ended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_rig import small_rig, swing

from motiongen.gestures.generator import GestureGenerator
from motiongen.motion import Label
from motiongen.rotation import yaw_of_quat
from retarget.cut import cut_short, standing_at
from retarget.retarget import retarget
from retarget.rig import load_rig
from sim.checks import judge

RIG = small_rig()


@pytest.mark.parametrize("frame", [0, 1, 10, 25, 49, 50])
def test_a_cut_goes_on_at_the_same_speed_and_rests_in_the_nominal_pose(frame: int) -> None:
    whole = replace(swing(RIG, 1.0), labels=(Label(0.0, 1.0, "swing"),))
    short = cut_short(whole, frame, RIG)
    np.testing.assert_array_equal(short.qpos[: frame + 1], whole.qpos[: frame + 1])
    np.testing.assert_allclose(short.joint_pos[-1], RIG.pose_vector(RIG.nominal), atol=1e-12)
    steps = np.abs(np.diff(short.joint_pos, axis=0))
    fastest = np.abs(np.diff(whole.joint_pos, axis=0)).max()
    assert steps[: frame + 15].max() <= fastest + 1e-12  # while it runs down
    assert steps.max() <= RIG.joints[0].velocity / short.fps
    assert np.abs(np.diff(short.joint_pos, n=2, axis=0)).max() < 0.02  # no step in speed: 1 rad/s of one frame is 0.02
    assert steps[-1].max() < 1e-3
    assert short.labels == ((Label(0.0, frame / 50, "swing"),) if frame else ())


def test_a_cut_out_of_the_trajectory_is_refused() -> None:
    with pytest.raises(ValueError, match="cut at frame 51 of 51"):
        cut_short(swing(RIG, 1.0), 51, RIG)


def test_physics_takes_a_wave_that_is_cut_at_any_moment() -> None:
    rig = load_rig("puppet")
    wave = retarget(GestureGenerator().generate("wave"), rig)
    limit = np.array([j.velocity for j in rig.joints]) / wave.fps
    for frame in range(20, len(wave), 45):
        short = cut_short(wave, frame, rig)
        assert (np.abs(np.diff(short.joint_pos, axis=0)) <= limit + 1e-9).all()
        report, _ = judge(short, rig)
        assert report.ok, report.failures()


def test_what_comes_next_begins_where_the_last_ended() -> None:
    rng = np.random.default_rng(1)
    here = swing(RIG, 1.0)
    qpos = here.qpos.copy()
    qpos[:, :3] = np.cumsum(rng.normal(0, 0.01, (51, 3)), 0)
    qpos[:, :3] += np.array([3.0, -2.0, 0.4])
    yaw = 0.7 + np.linspace(0, 1, 51)
    qpos[:, 3:7] = np.stack([np.cos(yaw / 2), 0 * yaw, 0 * yaw, np.sin(yaw / 2)], 1)
    walk = replace(here, qpos=qpos)
    root = np.array([-1.0, 5.0, 9.9, np.cos(-1.0), 0, 0, np.sin(-1.0)])
    moved = standing_at(walk, root)
    np.testing.assert_allclose(moved.qpos[0, :2], root[:2], atol=1e-12)
    np.testing.assert_allclose(yaw_of_quat(moved.qpos[:, 3:7]) - yaw_of_quat(qpos[:, 3:7]), -2.0 - 0.7, atol=1e-9)
    np.testing.assert_array_equal(moved.qpos[:, [2, *range(7, 10)]], qpos[:, [2, *range(7, 10)]])
    between = np.linalg.norm(np.diff(moved.root_pos, axis=0), axis=1)
    np.testing.assert_allclose(between, np.linalg.norm(np.diff(walk.root_pos, axis=0), axis=1), atol=1e-12)


def test_what_servos_are_told_beyond_the_motion_fades_with_it() -> None:
    whole = swing(RIG, 1.0)
    aimed = replace(whole, aim=whole.joint_pos + 0.1)
    short = cut_short(aimed, 25, RIG)
    lead = short.targets - short.joint_pos
    np.testing.assert_allclose(lead[:25], 0.1, atol=1e-12)
    np.testing.assert_allclose(lead[-1], 0, atol=1e-12)
    assert (np.diff(lead, axis=0) <= 1e-12).all()
