"""Disturbed trials: what is disturbed and by how much, and that the rate is that of the trials."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from two_arm_rig import WEIGHT
from two_arm_rig import two_arm_motion as motion
from two_arm_rig import two_arm_rig as make_rig

from sim.checks import judge
from sim.geometry import measure
from sim.scene import DRIVE, GAIN, build_scene
from sim.simulate import Push, run, run_many
from sim.trials import PUSH, PUSH_TIME, any_push, run_trials, variant

UP = np.array([0.0, 0.0, 1.0])
WOBBLY = (float(np.cos(0.045)), 0.0, float(np.sin(0.045)), 0.0)  # 0.09 rad of the 0.13 at which it tips


def trials(rig, trajectory, count, **how):
    scene = build_scene(rig, "free", trajectory.qpos[0])
    return run_trials(trajectory, scene, measure(scene, trajectory.qpos), count, **how)


def test_a_figure_that_stands_well_always_does_and_one_that_leans_does_not(tmp_path):
    rig = make_rig(tmp_path, play=0.01)
    steady = trials(rig, motion(), 4)
    assert (steady.count, steady.passed, steady.rate, steady.failures) == (4, 4, 1.0, ())
    leaning = trials(rig, motion(quat=(float(np.cos(0.15)), 0.0, float(np.sin(0.15)), 0.0)), 4)
    assert leaning.passed == 0
    assert dict(leaning.failures)["fall_tilt"] == 4


def test_a_trial_is_the_same_however_many_there_are(tmp_path):
    rig, wobbly = make_rig(tmp_path), motion(quat=WOBBLY)
    three, six = trials(rig, wobbly, 3), trials(rig, wobbly, 6, threads=2)
    assert trials(rig, wobbly, 3, threads=2) == three
    assert 0 <= six.passed - three.passed <= 3
    assert trials(rig, wobbly, 6) == six


def test_the_report_says_the_rate_and_fails_with_it(tmp_path):
    rig = make_rig(tmp_path)
    good, _ = judge(motion(), rig, trials=2, seed=5)
    assert good.ok
    assert good.trials is not None
    assert (good.trials.count, good.trials.seed) == (2, 5)
    assert judge(motion(), rig)[0].trials is None
    easily = replace(rig, joints=tuple(replace(j, torque=1.55, kp=40.0) for j in rig.joints))
    bad, _ = judge(motion(), easily, mount="stand", trials=6)
    assert bad.trials is not None
    assert bad.ok == (all(c.ok for c in bad.checks) and bad.trials.rate >= 0.9)


def test_a_variant_changes_what_it_says_within_what_it_says(tmp_path):
    scene = build_scene(make_rig(tmp_path), "free", motion().qpos[0])
    model = variant(scene, np.random.default_rng(1))
    plain = scene.model
    for field, share in (("body_mass", 0.05), ("body_inertia", 0.05)):
        ratio = getattr(model, field)[1:] / getattr(plain, field)[1:]
        assert np.abs(ratio - 1).max() <= share
        assert len(np.unique(ratio.round(9))) == 3  # three bodies
    friction = model.geom_friction[:, 0] / plain.geom_friction[:, 0]
    assert np.ptp(friction) < 1e-12
    assert 0 < abs(friction[0] - 1) <= 0.25
    gains = model.actuator_gainprm[:, GAIN] / plain.actuator_gainprm[:, GAIN]
    assert np.ptp(gains) > 0
    assert np.abs(gains - 1).max() <= 0.1
    supply = model.actuator_gainprm[:, DRIVE] / plain.actuator_gainprm[:, DRIVE]
    np.testing.assert_allclose(model.actuator_forcerange / plain.actuator_forcerange, np.tile(supply, (2, 1)).T)
    assert 0 < abs(supply[0] - 1) <= 0.05
    assert plain.body_mass[1] == 10  # the scene's own is untouched


def test_a_push_changes_the_speed_by_its_impulse(tmp_path):
    falling = motion(seconds=0.4, root=lambda t: 5 * UP * np.ones((len(t), 1)))
    scene = build_scene(make_rig(tmp_path), "free", falling.qpos[0])
    push = Push(0.1, 0.1, (0.0, PUSH * WEIGHT, 0.0))
    data = mujoco.MjData(scene.model)
    pushed, alone = run(scene, falling, push), run(scene, falling)
    assert (pushed.qpos[:5] == alone.qpos[:5]).all()  # not before
    moved = np.empty((2, 3))
    for out, rollout in zip(moved, (pushed, alone), strict=True):
        com = []
        for k in (15, 20):
            scene.place(data, rollout.qpos[k])
            mujoco.mj_kinematics(scene.model, data)
            mujoco.mj_comPos(scene.model, data)
            com.append(data.subtree_com[1].copy())
        out[:] = (com[1] - com[0]) / 0.1
    np.testing.assert_allclose(moved[0] - moved[1], [0, 0.1 * 9.81 * PUSH_TIME, 0], atol=1e-3)


def test_pushes_come_any_time_from_any_side_and_not_on_a_stand(tmp_path):
    rig, draw = make_rig(tmp_path), np.random.default_rng(0)
    scene = build_scene(rig, "free", motion().qpos[0])
    pushes = [any_push(scene, 3.0, draw) for _ in range(100)]
    force = np.array([p.force for p in pushes])
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), PUSH * WEIGHT)
    assert (force[:, 2] == 0).all()
    assert np.abs(force[:, :2].mean(0)).max() < 0.2 * PUSH * WEIGHT
    assert min(p.start for p in pushes) < 0.3
    assert 2.7 < max(p.start for p in pushes) < 3.0
    assert any_push(build_scene(rig, "stand", motion().qpos[0]), 3.0, draw) is None


def test_one_run_that_flies_apart_leaves_the_others_alone(tmp_path):
    rig = make_rig(tmp_path, mount="stand")
    wave = motion(left=lambda t: 0.3 * np.sin(5 * t))
    scene = build_scene(rig, "stand", wave.qpos[0])
    wild = variant(scene, np.random.default_rng(0))
    wild.actuator_gainprm[:2, GAIN] = 1e13
    wild.actuator_gainprm[:2, DRIVE] = 1e13
    wild.actuator_forcerange[:2] *= 1e13
    first, broken, last = run_many(scene, [scene.model, wild, scene.model], wave, [None] * 3, threads=2)
    assert broken.breakdown is not None
    assert broken.breakdown.body in {"left_arm", "right_arm"}
    assert np.isfinite(broken.qpos).all()
    assert first.breakdown is None
    assert last.breakdown is None
    np.testing.assert_array_equal(first.qpos, run(scene, wave).qpos)
    np.testing.assert_array_equal(last.qpos, first.qpos)


def test_one_that_flies_apart_while_it_settles_is_noticed(tmp_path):
    wave = motion(left=lambda t: 0.3 * np.sin(5 * t) + 0.5)
    scene = build_scene(make_rig(tmp_path, mount="stand", torque=1e13, kp=1e13, kv=0.0), "stand", wave.qpos[0])
    rollout = run(scene, wave)
    assert rollout.breakdown is not None
    assert rollout.breakdown.at_s == 0
    np.testing.assert_array_equal(rollout.qpos, np.tile(wave.qpos[0], (len(wave), 1)))
    assert not rollout.torque.any()


@pytest.mark.parametrize(("count", "threads"), [(-1, 1), (3, 0)])
def test_numbers_that_make_no_sense_are_refused(tmp_path, count, threads):
    with pytest.raises(ValueError, match="there should be at least 1 of both"):
        trials(make_rig(tmp_path), motion(), count, threads=threads)
