"""The live line with a generator that plays gestures by heart: what is admitted, changed, refused, and led to rest."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scripted_live import Scripted

from motiongen.motion import cut
from retarget.rig import Rig, load_rig
from rigcast.service.line import BLOCK, FPS, LEAD_S, Line
from rigcast.service.playlist import Playlist, Row
from sim import thresholds


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("puppet")


def opened(rig: Rig) -> Line:
    generator: Any = Scripted()
    return Line(generator, rig, clock=lambda: 0.0)


def made(line: Line, until: int) -> None:
    while line.frame < until:
        line.make()


def frames(line: Line) -> np.ndarray:
    assert [b.first for b in line.blocks[1:]] == [b.first + len(b.qpos) for b in line.blocks[:-1]]
    return np.concatenate([b.qpos for b in line.blocks])


def test_the_motion_of_the_fixture_is_30_frames_a_second() -> None:
    assert Scripted().next_chunk().fps == 30.0
    assert len(cut(Scripted().next_chunk(), 0, BLOCK)) == BLOCK


def test_prompt_changes_what_was_made_but_not_what_is_too_near(rig: Rig) -> None:
    line, other = opened(rig), opened(rig)
    for each in (line, other):
        made(each, 60)
    found = line.say("raise the right hand", 20)
    assert found.known
    at = line.frame
    assert 20 + LEAD_S * FPS <= at < 20 + LEAD_S * FPS + BLOCK / 30 * FPS + 1
    made(line, 95)
    made(other, 95)
    mine, others = frames(line), frames(other)
    assert np.array_equal(mine[:at], others[:at])
    shoulder = [7 + k for k, name in enumerate(rig.joint_names()) if name.startswith("right_shoulder")]
    assert np.abs(mine[at:95] - others[at:95])[:, shoulder].max() > 0.3
    assert np.abs(np.diff(mine[:, 7:], axis=0) * FPS).max() < max(j.velocity for j in rig.joints)


def test_unknown_text_changes_nothing(rig: Rig) -> None:
    line = opened(rig)
    made(line, 40)
    before = frames(line)
    assert not line.say("sing", 5).known
    assert np.array_equal(frames(line), before)


def test_rest_from_the_middle_of_a_move_ends_in_the_pose_it_began_with(rig: Rig) -> None:
    line = opened(rig)
    line.say("raise the right hand", 0)
    made(line, 70)
    block = line.rest(40)
    assert block.text == "rest"
    assert block.first >= 40 + LEAD_S * FPS
    assert np.allclose(block.qpos[-1], line.rest_pose)
    assert np.abs(frames(line)[block.first - 1, 7:] - line.rest_pose[7:]).max() > 0.1
    made(line, line.frame + 30)
    assert np.abs(np.diff(frames(line)[:, 7:], axis=0) * FPS).max() < max(j.velocity for j in rig.joints)


def test_refused_block_gives_way_to_rest_and_it_goes_on(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    line = opened(rig)
    line.say("raise the right hand", 0)
    made(line, 50)
    limit = thresholds.THRESHOLDS["joint_speed"]
    monkeypatch.setitem(thresholds.THRESHOLDS, "joint_speed", replace(limit, limit=0.0))
    block = line.make()
    assert block.text == "rest"
    assert line.work.refused == 1
    assert "rad/s" in line.work.why
    monkeypatch.undo()
    made(line, line.frame + 20)
    assert line.work.refused == 1
    assert np.allclose(block.qpos[-1], line.rest_pose)


def rows(count: int, name: str) -> list[Row]:
    return [Row(np.array([float(i)]), name, name) for i in range(count)]


def test_playlist_takes_the_way_where_rows_run_out() -> None:
    playlist = Playlist()
    assert playlist.play() is None
    assert playlist.put(rows(2, "a"), tuple(rows(3, "way")))
    played = [playlist.play() for _ in range(7)]
    assert [p[0].text for p in played if p] == ["a", "a", "way", "way", "way", "way", "way"]
    assert played[1] is not None
    assert played[-1] is not None
    assert played[-1][0].qpos == [2.0]
    assert not playlist.put(rows(2, "late"), ())
    assert playlist.take_ran_out()
    assert not playlist.take_ran_out()
    assert playlist.put(rows(1, "b"), ())
    assert [p[0].text for p in (playlist.play(), playlist.play()) if p] == ["b", "b"]


def test_playlist_takes_back_what_was_not_played() -> None:
    playlist = Playlist()
    playlist.put(rows(10, "a"), tuple(rows(1, "far")))
    playlist.play()
    with playlist.held() as playhead:
        assert playhead == 1
        playlist.cut(4, tuple(rows(1, "near")))
    assert [p[0].text for p in (playlist.play() for _ in range(4)) if p] == ["a", "a", "a", "near"]
