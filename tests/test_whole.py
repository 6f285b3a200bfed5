"""Whole-trajectory inverse kinematics against finite differences, MuJoCo itself, and motions made from a rig."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import motions
import numpy as np
import pytest
from two_arm_rig import two_arm_rig
from wandering import FPS, RIGS, goals_from, nominal, wandering

from motiongen.motion import Motion
from motiongen.rotation import Array, quat_conj, quat_mul, quat_to_rotvec
from retarget.banded import FIRST, SECOND, Equations
from retarget.contacts import planted, runs
from retarget.kinematics import on_body, poses, tree_of
from retarget.loops import moved
from retarget.model import load_model
from retarget.rest import rest_of
from retarget.retarget import floor_goals
from retarget.rig import Rig, load_rig
from retarget.sparse import parts
from retarget.springs import Springs
from retarget.tracking import angles, pulls, reached, targets_of
from retarget.whole import solve


@pytest.mark.parametrize("base", ["", "torso"])
def test_the_gradient_is_that_of_finite_differences(base: str) -> None:
    """Of half the weighted squared error: also where it is large, and measured in a moving frame."""
    rig = load_rig("puppet")
    model = load_model(rig)
    tree = tree_of(model)
    goals = goals_from(wandering(rig, 0.1, 5), model, {"left_wrist": "left_forearm", "left_ankle": "left_foot"}, base)
    places, turns = targets_of(list(goals.values()), rig, model)
    qpos = wandering(rig, 0.1, 6)

    def cost(q: Array) -> Array:
        off, turned = reached(places, poses(tree, q))[1], angles(turns, poses(tree, q))
        return ((places.weight * (off**2).sum(-1)).sum(1) + (turns.weight * (turned**2).sum(-1)).sum(1)) / 2

    at = poses(tree, qpos)
    curvature, found = pulls(tree, places, turns, at, *reached(places, at), angles(turns, at))
    assert (np.triu(curvature, 1) == 0).all()
    for dof in range(model.nv):
        nudge = np.zeros((len(qpos), model.nv))
        nudge[:, dof] = 1e-6
        wanted = (cost(moved(qpos, nudge)) - cost(moved(qpos, -nudge))) / 2e-6
        assert found[:, dof] == pytest.approx(wanted, abs=1e-6)


def test_springs_add_up_frame_by_frame() -> None:
    rng = np.random.default_rng(10)
    frame, rows, room = np.array([0, 2, 2, 2, 5]), rng.normal(size=(5, 4)), rng.normal(size=5)
    pushing = np.array([True, True, False, True, True])
    before = np.ones((6, 4, 4)), np.ones((6, 4))
    springs = Springs(frame, rows, room, 3.0, 0.0)
    curvature, gradient = springs.added(*before, pushing)
    step = rng.normal(size=(6, 4))
    assert springs.after(step).room == pytest.approx(
        [p + r @ step[t] for t, r, p in zip(frame, rows, room, strict=True)]
    )
    for t in range(6):
        mine = (frame == t) & pushing
        assert np.tril(curvature[t]) == pytest.approx(np.tril(1 + 3 * rows[mine].T @ rows[mine]))
        assert gradient[t] == pytest.approx(1 + 3 * rows[mine].T @ room[mine])
    assert (before[0] == 1).all()
    assert (before[1] == 1).all()


@pytest.mark.parametrize(
    ("groups", "count"), [("aaa", 1), ("aba", 2), ("abc", 3), ("abc then aab", 2), ("abc then aab then abb", 1)]
)
def test_banded_equations_are_the_dense_ones(groups: str, count: int) -> None:
    """Unknowns of one letter are tied to each other in all frames, or in the fourth and fifth only."""
    frames, size, known = 9, 3, 2
    rng = np.random.default_rng(7)
    dense, right = np.zeros((frames * size,) * 2), np.zeros(frames * size)
    half, gradient = rng.normal(size=(frames, size, 5)), rng.normal(size=(frames, size))
    blocks = half @ half.swapaxes(1, 2)
    for t, block in enumerate(blocks):
        said = groups.split(" then ")
        letters = np.array(list(said[t - 3] if 3 < t < 3 + len(said) else said[0]))
        block *= letters[:, None] == letters
        rows = slice(t * size, (t + 1) * size)
        dense[rows, rows] += block
        right[rows] -= gradient[t]
    assert len(set(parts(np.tril(blocks)))) == count
    out = Equations(np.tril(blocks), gradient)
    for stencil in (FIRST, SECOND):
        rows = frames - len(stencil) + 1
        weight, value = rng.uniform(1, 2, (rows, size)), rng.normal(size=(rows, size))
        if stencil is SECOND:
            weight[:] = weight[0]
        out.add_differences(stencil, weight[0] if stencil is SECOND else weight, value)
        for t in range(rows):
            for i in range(size):
                row = np.zeros(frames * size)
                row[[(t + k) * size + i for k in range(len(stencil))]] = stencil
                dense += weight[t, i] * np.outer(row, row)
                right -= weight[t, i] * value[t, i] * row
    damping = rng.uniform(0, 1, (frames, size))
    left = (dense + np.diag(damping.ravel()))[known * size :, known * size :]
    wanted = np.linalg.solve(left, right[known * size :]).reshape(-1, size)
    found = out.solved(known, damping)
    assert found[known:] == pytest.approx(wanted)
    assert not found[:known].any()


@pytest.mark.parametrize("name", RIGS)
def test_a_motion_made_from_the_rig_comes_back(name: str) -> None:
    """Random smooth angles → where that puts every body → the angles, within 0.01 rad, from the nominal pose.

    Such angles may put one body into another: here they do not mind.
    """
    rig = load_rig(name)
    model = load_model(rig)
    model.geom_contype[:] = model.geom_conaffinity[:] = 0
    made = wandering(rig, 2.0, 8)
    bodies = {str(body): model.body(body).name for body in range(1, model.nbody)}
    start = nominal(rig)
    found = solve(rig, model, goals_from(made, model, bodies), start, FPS, fixed_root=False, planted={})
    assert np.abs(found[:, 7:] - made[:, 7:]).max() < 0.01
    assert np.abs(found[:, :3] - made[:, :3]).max() < 0.01 * rig.nominal.height
    assert np.abs(quat_to_rotvec(quat_mul(quat_conj(made[:, 3:7]), found[:, 3:7]))).max() < 0.01


def test_two_arms_come_back_and_stop_at_their_limits(tmp_path: Path) -> None:
    """The left arm is asked for 2.4 rad of its 2.0, twice, and then for a jump, which it may take at 3.5 rad/s."""
    rig = two_arm_rig(tmp_path)
    model = load_model(rig)
    t = np.arange(151) / FPS
    made = np.tile(nominal(rig), (len(t), 1))
    made[:, 7] = np.where(t < 2, 2.4 * np.sin(np.pi / 2 * t) ** 2, -1.0)
    made[:, 8] = 0.5 * np.sin(2 * t)
    goals = goals_from(made, model, {"left_wrist": "left_arm", "right_wrist": "right_arm", "pelvis": "base"})
    found = solve(rig, model, goals, nominal(rig), FPS, fixed_root=True, planted={})
    assert found[:, :7] == pytest.approx(made[:, :7])
    assert found[:, 8] == pytest.approx(made[:, 8], abs=0.01)
    assert found[:, 7].max() == pytest.approx(2.0, abs=1e-3)
    assert found[:, 7].max() <= 2.0
    assert np.abs(np.diff(found[:, 7])).max() <= 3.5 / FPS + 1e-12
    assert found[-1, 7] == pytest.approx(-1.0, abs=0.02)


def stood(rig: Rig, clip: Motion) -> tuple[Array, dict[str, Array], Array]:
    """The solution, the soles (T, points, 3) and the stance, by human ankle."""
    model = load_model(rig)
    stance = planted(clip)
    goals = floor_goals(clip, rig, rest_of(rig, model), stance)
    qpos = solve(rig, model, goals, nominal(rig), clip.fps, fixed_root=False, planted=stance)
    at = poses(tree_of(model), qpos)
    soles = {}
    for foot in rig.feet:
        sites = [model.site(site) for site in foot.sites]
        soles[foot.human] = on_body(at, np.array([s.bodyid[0] for s in sites]), np.array([s.pos for s in sites]))
    return qpos, soles, stance


@pytest.mark.parametrize(("name", "speed"), [("puppet", 0.4), ("humanoid", 1.2)])
def test_planted_feet_move_less_than_a_millimetre(name: str, speed: float) -> None:
    clip = motions.walk(speed).resampled(FPS)
    _, soles, stance = stood(load_rig(name), clip)
    stances = 0
    for foot, points in soles.items():
        assert points[..., 2].min() > -1e-3
        for start, end in runs(stance[foot]):
            still = points[start:end]
            assert np.linalg.norm(still - still[0], axis=-1).max() < 1e-3
            assert np.abs(still[..., 2]).max() < 1e-3
            stances += 1
    assert stances >= 7


def test_windows_join_without_a_seam(monkeypatch: pytest.MonkeyPatch) -> None:
    """A walk in windows of 1 s is the walk in one piece, but for what a window does not see of the future."""
    rig, clip = load_rig("humanoid"), motions.walk().resampled(FPS)
    whole, _, _ = stood(rig, clip)
    monkeypatch.setattr("retarget.whole.WINDOW", 1.0)
    pieces, soles, stance = stood(rig, clip)
    assert np.abs(pieces - whole).max() < 0.05
    third = [np.abs(np.diff(q[:, 7:], n=3, axis=0)).max() for q in (pieces, whole)]
    assert third[0] < 1.2 * third[1]
    moved_by = [np.ptp(soles[foot][start:end], axis=0).max() for foot in soles for start, end in runs(stance[foot])]
    assert max(moved_by) < 1e-3


@pytest.mark.parametrize("frames", [1, 2, 3, 5])
def test_short_clips(frames: int) -> None:
    rig, clip = load_rig("puppet"), motions.stand()
    short = replace(clip, root_pos=clip.root_pos[:frames], joint_quat=clip.joint_quat[:frames])
    qpos, soles, _ = stood(rig, short)
    assert len(qpos) == frames
    assert all(np.abs(points[..., 2]).max() < 1e-3 for points in soles.values())


def test_the_same_twice() -> None:
    rig, clip = load_rig("puppet"), motions.wave(seconds=1)
    assert (stood(rig, clip)[0] == stood(rig, clip)[0]).all()
