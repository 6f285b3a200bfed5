"""Retargeting of a motion that is still coming, against the same clip as a whole."""

from __future__ import annotations

from functools import cache

import motions
import numpy as np
import pytest

from motiongen.motion import Motion, cut
from motiongen.rotation import Array
from retarget.contacts import planted, runs
from retarget.incoming import Incoming, taken
from retarget.kinematics import on_body, poses, tree_of
from retarget.model import load_model
from retarget.rest import rest_of
from retarget.retarget import floor_goals, nominal_qpos
from retarget.rig import load_rig
from retarget.streaming import LEAD, Streamed, advance, drained, open_stream
from retarget.whole import solve

FPS = 50.0
WALKS = {"puppet": 0.4, "humanoid": 1.2}  # m/s


def walk(rig: str) -> Motion:
    return motions.walk(WALKS[rig], seconds=2.8)


def streamed(rig: str, clip: Motion, look_ahead: float, blocks: list[int]) -> Streamed:
    """`clip` on the floor, cut into blocks that begin at these frames."""
    stream, progress = open_stream(load_rig(rig), clip.skeleton, clip.fps, mount="free", look_ahead=look_ahead)
    out = []
    for start, end in zip(blocks, [*blocks[1:], len(clip)], strict=True):
        progress, done = advance(stream, progress, cut(clip, start, end))
        out.append(done)
    out.append(drained(stream, progress))
    contacts = {foot: np.concatenate([part.contacts[foot] for part in out]) for foot in out[0].contacts}
    return Streamed(np.concatenate([part.qpos for part in out]), contacts)


@cache
def walked(rig: str, look_ahead: float) -> Streamed:
    return streamed(rig, walk(rig), look_ahead, [0])


@cache
def whole(rig_name: str) -> Array:
    rig, clip = load_rig(rig_name), walk(rig_name).resampled(FPS)
    model, stance = load_model(rig), planted(clip)
    goals = floor_goals(clip, rig, rest_of(rig, model), stance)
    return solve(rig, model, goals, nominal_qpos(rig, "free"), FPS, fixed_root=False, planted=stance)


@pytest.mark.parametrize(("look_ahead", "near", "harsher"), [(0.2, 0.06, 1.5), (0.0, 0.12, 3.0)])
@pytest.mark.parametrize("rig", WALKS)
def test_it_is_the_whole_trajectory_but_for_what_it_does_not_see(
    rig: str, look_ahead: float, near: float, harsher: float
) -> None:
    """Root mean square of the joints in rad, and mean jerk, from when it has gone over to the motion."""
    inside = slice(round((LEAD + 0.2) * FPS), -round(0.3 * FPS))
    found, wanted = walked(rig, look_ahead).qpos[inside, 7:], whole(rig)[inside, 7:]
    assert np.sqrt(((found - wanted) ** 2).mean()) < near
    jerk = [np.abs(np.diff(angles, n=3, axis=0)).mean() for angles in (found, wanted)]
    assert jerk[0] < harsher * jerk[1]


@pytest.mark.parametrize("look_ahead", [0.2, 0.0])
@pytest.mark.parametrize("rig", WALKS)
def test_planted_feet_stay_planted(rig: str, look_ahead: float) -> None:
    found, body = walked(rig, look_ahead), load_rig(rig)
    model = load_model(body)
    at = poses(tree_of(model), found.qpos)
    stances = 0
    for foot in body.feet:
        sites = [model.site(site) for site in foot.sites]
        sole = on_body(at, np.array([s.bodyid[0] for s in sites]), np.array([s.pos for s in sites]))
        assert sole[..., 2].min() > -1e-9
        for start, end in runs(found.contacts[foot.name]):
            assert np.linalg.norm(sole[start:end] - sole[start], axis=-1).max() < 1e-3
            stances += end - start > 10
    assert stances >= 3


@pytest.mark.parametrize("look_ahead", [0.2, 0.0])
def test_it_starts_at_rest_in_the_nominal_pose_and_keeps_the_limits(look_ahead: float) -> None:
    rig, found = load_rig("puppet"), walked("puppet", look_ahead).qpos
    assert found[0] == pytest.approx(nominal_qpos(rig, "free"), abs=1e-4)
    angles = np.concatenate([found[:1, 7:], found[:, 7:]])
    for i, joint in enumerate(rig.joints):
        assert angles[:, i].min() >= joint.lower
        assert angles[:, i].max() <= joint.upper
        assert np.abs(np.diff(angles[:, i])).max() * FPS < joint.velocity + 1e-9
        assert np.abs(np.diff(angles[:, i], n=2)).max() * FPS**2 < joint.acceleration + 1e-6


@pytest.mark.parametrize("look_ahead", [0.2, 0.0])
def test_how_the_motion_is_cut_does_not_matter(look_ahead: float) -> None:
    clip = walk("puppet")
    for blocks in (list(range(len(clip))), [0, 1, 8, 40, 41]):
        found = streamed("puppet", clip, look_ahead, blocks)
        assert found.qpos == pytest.approx(walked("puppet", look_ahead).qpos, abs=1e-7)
        for foot, flags in walked("puppet", look_ahead).contacts.items():
            assert (found.contacts[foot] == flags).all()


@pytest.mark.parametrize("look_ahead", [0.0, 0.02, 0.1, 0.2])
def test_a_frame_goes_out_a_look_ahead_after_it_came_in(look_ahead: float) -> None:
    clip = motions.stand(0.5, FPS)
    stream, progress = open_stream(load_rig("puppet"), clip.skeleton, FPS, mount="free", look_ahead=look_ahead)
    assert stream.delay == round(look_ahead * FPS)
    count = 0
    for frame in range(len(clip)):
        progress, done = advance(stream, progress, cut(clip, frame, frame + 1))
        count += len(done.qpos)
        assert count == max(frame + 1 - stream.delay, 0)
    assert len(drained(stream, progress).qpos) == stream.delay


@pytest.mark.parametrize("fps", [20.0, 30.0, 120.0])
def test_frames_are_sampled_as_a_clip_s_are(fps: float) -> None:
    clip = motions.wave(seconds=1.0, fps=fps)
    state, parts = Incoming(), []
    for frame in range(len(clip)):
        state, part = taken(state, cut(clip, frame, frame + 1), FPS, smooth=False)
        parts += [] if part is None else [part]
    wanted = clip.resampled(FPS)
    assert np.concatenate([p.root_pos for p in parts]) == pytest.approx(wanted.root_pos, abs=1e-9)
    found = np.concatenate([p.joint_quat for p in parts])
    assert np.abs((found * wanted.joint_quat).sum(-1)) == pytest.approx(1.0, abs=1e-9)


def test_on_a_stand_the_root_is_still() -> None:
    clip = cut(motions.wave(seconds=3), 0, 50)
    rig = load_rig("puppet")
    stream, progress = open_stream(rig, clip.skeleton, clip.fps, mount="stand")
    done = advance(stream, progress, clip)[1]
    assert done.qpos[:, :7] == pytest.approx(np.tile(nominal_qpos(rig, "stand")[:7], (len(done.qpos), 1)))
    assert not any(flags.any() for flags in done.contacts.values())
    shoulder = rig.joint_names().index("right_shoulder_roll")
    assert done.qpos[-1, 7 + shoulder] > 1.0


@pytest.mark.parametrize("each", [2, 3])
def test_several_frames_of_a_solution_are_nearly_what_one_of_each_are(each: int) -> None:
    clip, rig = walk("puppet"), load_rig("puppet")
    found = {}
    for count in (1, each):
        stream, progress = open_stream(rig, clip.skeleton, clip.fps, mount="stand", look_ahead=0.1, each=count)
        parts = []
        for start in range(0, len(clip), 7):
            progress, done = advance(stream, progress, cut(clip, start, min(start + 7, len(clip))))
            parts.append(done.qpos)
        found[count] = np.concatenate([*parts, drained(stream, progress).qpos])
        assert sum(map(len, parts[:-1])) % count == 0
    assert found[each].shape == found[1].shape
    assert 1e-5 < np.abs(found[each] - found[1]).max() < 0.06
    steps = np.diff(found[each][:, 7:], axis=0) * FPS
    assert (np.abs(steps) <= np.array([j.velocity for j in rig.joints]) + 1e-9).all()


def test_a_progress_is_a_value() -> None:
    """Going on from it twice gives the same twice: a future can be tried and thrown away."""
    clip = walk("puppet")
    stream, progress = open_stream(load_rig("puppet"), clip.skeleton, clip.fps, mount="free", look_ahead=0.0)
    progress, _ = advance(stream, progress, cut(clip, 0, 10))
    advance(stream, progress, cut(clip, 40, 50))
    again = [advance(stream, progress, cut(clip, 10, 20))[1].qpos for _ in range(2)]
    assert (again[0] == again[1]).all()


def test_what_does_not_fit_is_named() -> None:
    clip, rig = motions.stand(), load_rig("puppet")
    stream, progress = open_stream(rig, clip.skeleton, 30, mount="free")
    assert len(drained(stream, progress).qpos) == 0
    with pytest.raises(ValueError, match="opened for 22 joints at 30 fps, not 22 at 20"):
        advance(stream, progress, motions.stand(fps=20))
    with pytest.raises(ValueError, match="look_ahead must be at least 0 s, not -1"):
        open_stream(rig, clip.skeleton, 30, look_ahead=-1)
    with pytest.raises(ValueError, match="each must be at least 1 frame, not 0"):
        open_stream(rig, clip.skeleton, 30, each=0)
    with pytest.raises(ValueError, match="fps must be above 0, not 50 and 0"):
        open_stream(rig, clip.skeleton, 0)
    with pytest.raises(ValueError, match="unknown mount 'shelf'; known are free, stand, hung"):
        open_stream(rig, clip.skeleton, 30, mount="shelf")  # type: ignore[arg-type]
