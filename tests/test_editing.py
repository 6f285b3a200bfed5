"""Edits of somebody's clip: what is kept stays, in the world too; what is drawn meets it; bad ranges are one line."""

from dataclasses import replace

import numpy as np
import pytest
from motions import motion, stand, turned, walk

from motiongen.diffusion.editing import edit_of
from motiongen.diffusion.keeping import Kept, arriving, eased, settled
from motiongen.diffusion.planting import planted
from motiongen.diffusion.ranges import RangeError, kept_frames, runs
from motiongen.features import PLANAR, TURNS, YAW, motion_to_features, root_path
from motiongen.generator import load_generator
from motiongen.gestures.catalogue import perform
from motiongen.motion import SMPL_JOINTS, Motion, Skeleton
from motiongen.rotation import quat_mul, quat_to_matrix, yaw_quat

ALL = tuple(range(len(SMPL_JOINTS)))


@pytest.fixture(scope="module")
def generator():
    return load_generator()


def kept_of(clip: Motion, frames: np.ndarray, joints: tuple[int, ...] = ALL) -> Kept:
    return Kept(motion_to_features(clip).astype(float), frames, joints, quat_to_matrix(clip.joint_quat))


def jumps(clip: Motion) -> np.ndarray:
    """Largest change of a joint's velocity at frames 1 … T − 2, in m/s."""
    velocity = np.diff(clip.positions(), axis=0) * clip.fps
    return np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max(1)


# ---- Ranges


@pytest.mark.parametrize(
    ("ranges", "kept"),
    [
        ("0:1s,3s:", [(0, 30), (90, 121)]),
        ("0:30,90:", [(0, 30), (90, 121)]),
        (" 3s: , :0.5s ", [(0, 15), (90, 121)]),
        ("60:", [(60, 121)]),
        ("1s:2s,2s:3s", [(30, 90)]),
        ("5:6,9:10", [(5, 6), (9, 10)]),
    ],
)
def test_ranges(ranges: str, kept: list[tuple[int, int]]) -> None:
    assert runs(kept_frames(ranges, 121, 30.0)) == kept


@pytest.mark.parametrize(
    ("ranges", "words"),
    [
        ("0:9s", "outside the clip, which has 121 frames, 4.033 s"),
        ("-1s:2s", "outside the clip"),
        ("130:", "outside the clip"),
        ("0:2s,1s:3s", "'1s:3s' overlaps another one"),
        ("2s:2s", "empty"),
        ("3s:1s", "empty"),
        ("1s", "no range; write start:end"),
        ("", "no range"),
        ("0:1s,", "no range"),
        ("a:b", "'a' in the range 'a:b' is no number of frames"),
        ("0:1.5", "no number of frames"),
        ("0:nans", "no number of seconds"),
        (":", "keeps all 121 frames"),
        ("0:1s,1.05s:", "to draw; at least"),
    ],
)
def test_bad_ranges(ranges: str, words: str) -> None:
    with pytest.raises(RangeError, match=words):
        kept_frames(ranges, 121, 30.0)


# ---- How what is drawn meets what is kept


def test_easing_meets_place_and_speed() -> None:
    t = np.arange(60.0)[:, None]
    known, drawn = 0.1 * t, np.full((60, 1), 7.0)
    kept = (t < 20)[:, 0] | (t >= 50)[:, 0]
    out = eased(drawn, known, kept, 12)
    assert (out[kept] == known[kept]).all()
    speed = np.diff(out[:, 0])
    assert speed[19] == pytest.approx(0.1, abs=0.1)  # … of the step into the first frame that was drawn
    assert speed[49] == pytest.approx(0.1, abs=0.1)
    assert np.abs(out[32:38] - 7).max() < 1e-9
    hard = np.where(kept[:, None], known, drawn)
    assert np.abs(np.diff(out[:, 0], 2)).max() < 0.2 * np.abs(np.diff(hard[:, 0], 2)).max()


def test_easing_is_the_least_jerk_and_leaves_movement_alone() -> None:
    t = np.arange(80.0)[:, None]
    kept, moving = (t < 20)[:, 0], np.sin(t / 9)
    out = eased(moving + 1, moving, kept, 24)
    u = np.arange(1, 25) / 25
    assert np.abs((out - moving)[20:44, 0] - (10 * u**3 - 15 * u**4 + 6 * u**5)).max() < 0.03  # Flash & Hogan 1985
    assert np.abs(out - moving - 1)[44:].max() < 1e-9
    assert np.abs(np.diff(out[15:50, 0], 2)).max() < 0.01 + np.abs(np.diff(moving[:, 0], 2)).max()
    elsewhere = np.where(kept[:, None], 50.0, moving + 1)  # what is drawn there does not matter
    assert (eased(elsewhere, moving, kept, 24) == out).all()


def test_easing_short_gaps_and_nothing_kept() -> None:
    t = np.arange(12.0)[:, None]
    kept = (t < 5)[:, 0] | (t >= 8)[:, 0]
    assert np.abs(eased(np.zeros_like(t), t**2, kept, 24) - t**2).max() < 1e-9
    assert (eased(t, 0 * t, np.zeros(12, bool), 24) == t).all()
    assert (eased(t[:2], 0 * t[:2], np.array([True, False]), 24) == [[0], [1]]).all()


def test_a_drawn_path_arrives_where_the_kept_one_goes_on() -> None:
    clip = turned(walk(seconds=6), 0.7, np.array([3.0, -2.0, 0.0]))
    bend = np.interp(np.arange(len(clip)) / clip.fps, [2, 4], [0, 1.9])  # and turns while nobody looks
    quat = clip.joint_quat.copy()
    quat[:, 0] = quat_mul(yaw_quat(bend), quat[:, 0])
    clip = replace(clip, joint_quat=quat)
    kept = kept_of(clip, kept_frames("0:1s,90:91,5s:", len(clip), clip.fps))
    drawn = kept.features.copy()
    free = ~(kept.frames & np.append(kept.frames[1:], True))
    drawn[free, :3] = np.random.default_rng(0).normal(0, 0.5, (free.sum(), 3))
    out = arriving(drawn, kept)
    assert (out[~free] == drawn[~free]).all()
    (yaw, place), (true_yaw, true_place) = root_path(out), root_path(kept.features)
    missing = (yaw - true_yaw)[kept.frames]
    assert np.abs((missing + np.pi) % (2 * np.pi) - np.pi).max() < 1e-6
    assert np.abs(place - true_place)[kept.frames].max() < 1e-6
    assert np.abs(out[free, YAW]).max() < 3
    assert np.abs(out[free, PLANAR]).max() < 4


def test_what_hangs_on_a_drawn_joint_keeps_its_turn_on_it() -> None:
    clip = walk(seconds=2)
    torso = tuple(SMPL_JOINTS.index(n) for n in ("spine1", "spine2", "spine3"))
    kept = kept_of(clip, np.zeros(len(clip), bool), torso)
    drawn = kept.features + np.random.default_rng(0).normal(0, 0.3, kept.features.shape)
    out = settled(drawn, kept)
    assert (out[:, :3] == kept.features[:, :3]).all()
    turns = out[:, TURNS].reshape(len(clip), 22, 2, 3)
    x, y = turns[:, :, 0], turns[:, :, 1]
    world = np.stack([x, y, np.cross(x, y)], axis=-1)
    shoulder, collar = (SMPL_JOINTS.index(n) for n in ("left_shoulder", "left_collar"))
    local = np.swapaxes(world[:, collar], 1, 2) @ world[:, shoulder]
    assert np.abs(local - kept.local[:, shoulder]).max() < 1e-6
    assert np.abs(out - kept.features)[:, TURNS].max() > 0.1


def test_feet_that_stand_are_planted_by_the_legs() -> None:
    still = stand(2.0)
    t = np.arange(len(still)) / still.fps
    dragged = replace(still, root_pos=still.root_pos + np.outer(t, [0.08, 0, 0]))
    free = np.ones(len(t), bool)
    feet = [still.skeleton.index(n) for n in ("left_ankle", "left_foot", "right_ankle", "right_foot")]
    out = planted(dragged, np.ones((len(t), 4)), free)
    moved = np.diff(out.positions()[:, feet], axis=0) * out.fps
    assert np.abs(moved[..., :2]).max() < 1e-6
    assert np.abs(out.positions()[:, feet[0], 0].mean() - dragged.positions()[:, feet[0], 0].mean()) < 1e-6
    free[:30] = False  # a foot that stood stays where it stood
    out = planted(dragged, np.ones((len(t), 4)), free)
    assert np.abs(out.positions()[:30, feet, :2] - dragged.positions()[:30, feet, :2]).max() < 1e-6
    assert np.ptp(out.positions()[30:, feet[0], 0]) < 1e-6
    assert np.abs(planted(dragged, np.zeros((len(t), 4)), free).positions() - dragged.positions()).max() < 1e-9


# ---- Edits of whole clips


@pytest.mark.parametrize("fps", [20.0, 30.0, 120.0])
@pytest.mark.parametrize("keep", ["0:1s,3s:", "2s:", ":1.5s,2.5s:3s"])
def test_kept_frames_come_out_as_they_went_in(generator, keep: str, fps: float) -> None:
    clip = turned(walk(fps=fps), 2.0, np.array([5.0, 1.0, 0.0]))
    out = generator.edit(clip, "a person walks", keep=keep, seed=1)
    kept = kept_frames(keep, len(clip), fps)
    assert (len(out), out.fps, out.skeleton) == (len(clip), fps, clip.skeleton)
    assert np.abs(out.positions() - clip.positions())[kept].max() < 1e-4
    assert np.abs(out.positions() - clip.positions())[~kept].max() > 0.05
    seams = [f for run in runs(~kept) for end in run for f in (end - 1, end) if 1 <= f <= len(clip) - 2]
    assert jumps(out)[np.array(seams) - 1].max() < 2 * jumps(clip).max()


@pytest.mark.parametrize("keep", ["0:1s,3s:", "2s:"])
def test_nothing_jumps_where_the_network_expects_something_else(generator, keep: str) -> None:
    clip = perform("squat", seed=15)
    rows = np.minimum(np.arange(120), len(clip) - 1)  # stands still at its end, arms down
    clip = replace(clip, root_pos=clip.root_pos[rows], joint_quat=clip.joint_quat[rows], contacts=None)
    out = generator.edit(clip, "a person raises both hands", keep=keep, seed=15)
    kept = kept_frames(keep, len(clip), clip.fps)
    seams = [f for run in runs(~kept) for end in run for f in (end - 1, end) if 1 <= f <= len(clip) - 2]
    assert jumps(out)[np.array(seams) - 1].max() < 2 * max(jumps(clip).max(), 0.25)
    assert jumps(out).max() < 2.5


def test_a_long_gap_is_drawn_in_windows_and_arrives(generator) -> None:
    clip = walk(seconds=16)
    out = generator.edit(clip, "walk forward", keep="0:1s,15s:", seed=0)
    assert np.abs(out.root_pos - clip.root_pos)[[29, 450]].max() < 1e-4
    step = np.linalg.norm(np.diff(out.root_pos, axis=0), axis=1) * out.fps
    assert step.max() < 4  # m/s: nobody is thrown there at the end


@pytest.mark.parametrize(
    ("parts", "moved"),
    [
        (("right_arm",), {"right_collar", "right_shoulder", "right_elbow", "right_wrist"}),
        (("head", "left_leg"), {"neck", "head", "left_hip", "left_knee", "left_ankle", "left_foot"}),
        (("torso",), {"spine1", "spine2", "spine3"}),
    ],
)
def test_other_parts_and_the_root_stay(generator, parts: tuple[str, ...], moved: set[str]) -> None:
    clip = turned(walk(fps=60), 2.0, np.array([5.0, 1.0, 0.0]))
    out = generator.edit(clip, "a person waves with the right hand", parts=parts, seed=2)
    apart = 2 * np.arccos(np.clip(np.abs(np.sum(out.joint_quat * clip.joint_quat, axis=-1)), 0, 1))
    assert (out.root_pos == clip.root_pos).all()
    for j, name in enumerate(SMPL_JOINTS):
        assert (apart[:, j].max() > 1e-3) == (name in moved), name


def test_parts_in_some_frames_only(generator) -> None:
    clip = walk()
    out = generator.edit(clip, "wave", keep="0:2s", parts=["left_arm"], seed=2)
    assert (out.joint_quat[:60] == clip.joint_quat[:60]).all()
    assert np.abs(out.positions() - clip.positions())[60:, SMPL_JOINTS.index("left_wrist")].max() > 0.05
    assert (out.root_pos == clip.root_pos).all()


def test_an_edit_says_what_it_is_and_comes_again(generator) -> None:
    clip = walk()
    a, b, other = (generator.edit(clip, keep="0:1s", seed=s) for s in (3, 3, 4))
    assert (a.joint_quat == b.joint_quat).all()
    assert np.abs(a.joint_quat - other.joint_quat).max() > 1e-3
    assert a.labels[:-1] == clip.labels
    assert (a.labels[-1].start_s, a.labels[-1].text) == (1.0, "")
    assert a.source.generator == "synthetic+mdm"
    assert "NC" in a.source.licence
    assert a.contacts is None


def test_edits_that_nobody_can_do() -> None:
    clip = walk()
    with pytest.raises(RangeError, match="nothing says what to draw anew"):
        edit_of(clip, "", ())
    with pytest.raises(ValueError, match=r"unknown part of the body 'tail'; there are left_arm, .*whole_body"):
        edit_of(clip, "", ("tail",))
    other = Skeleton(("hip", "knee"), (-1, 0), np.array([[0, 0, 0], [0, 0, -0.4]]))
    with pytest.raises(ValueError, match="22 joints of SMPL"):
        edit_of(Motion(clip.root_pos, clip.joint_quat[:, :2], 30, other), "0:1s", ())


def test_a_clip_of_almost_nothing(generator) -> None:
    clip = motion(0.3, 30.0, {}, "stand")
    out = generator.edit(clip, "wave", keep="0:2", seed=0)
    assert np.abs(out.positions() - clip.positions())[:2].max() < 1e-4
