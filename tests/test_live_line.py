"""The live line with a generator that plays gestures by heart: what is admitted, changed, refused, and led to rest."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scripted_live import Scripted

from motiongen.live.steering import Steer
from motiongen.motion import cut
from retarget.rig import Rig, load_rig
from rigcast.service.line import BLOCK, FPS, LEAD_S, STEP, Line
from rigcast.service.playlist import Playlist, Row
from sim import thresholds


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("puppet")


def opened(rig: Rig) -> Line:
    generator: Any = Scripted()
    return Line(generator, rig, clock=lambda: 0.0)


def made(line: Line, until: int, before: np.ndarray | None = None) -> np.ndarray:
    """The frames (n, 7 + nj) that go out up to `until`, where those `before` were made; later blocks take the place of
    earlier ones."""
    out = np.zeros((0, 7 + len(line.rig.joints))) if before is None else before
    while line.frame < until or line.changing:
        block = line.make()
        assert block.first <= len(out)
        out = np.concatenate([out[: block.first], block.qpos])
    return out


def test_the_motion_of_the_fixture_is_30_frames_a_second() -> None:
    assert Scripted().next_chunk().fps == 30.0
    assert len(cut(Scripted().next_chunk(), 0, STEP)) == STEP


def test_prompt_changes_what_was_made_but_not_what_is_too_near(rig: Rig) -> None:
    line, other = opened(rig), opened(rig)
    mine, others = made(line, 60), made(other, 95)
    found = line.say("raise the right hand", 20)
    assert found.known
    assert line.changing
    at = line.frame
    assert 20 + LEAD_S * FPS <= at <= 20 + (LEAD_S + (STEP + 1) / 30) * FPS
    mine = made(line, 95, mine)
    assert not line.changing
    assert np.array_equal(mine[:at], others[:at])
    shoulder = [7 + k for k, name in enumerate(rig.joint_names()) if name.startswith("right_shoulder")]
    assert np.abs(mine[at:95] - others[at:95])[:, shoulder].max() > 0.3
    assert np.abs(np.diff(mine[:, 7:], axis=0) * FPS).max() < max(j.velocity for j in rig.joints)


def test_what_is_said_begins_where_it_begins_on_the_wire(rig: Rig) -> None:
    """What retargeting had looked at ahead is forgotten: the generator goes back to within a step of the wire."""
    line = opened(rig)
    made(line, 80)
    line.say("raise the right hand", 30)
    assert 0 <= line.generator.frame / 30 - line.frame / FPS < (STEP + 1) / 30


def test_prompts_at_every_turn_are_taken_in_turn(rig: Rig) -> None:
    line = opened(rig)
    out = made(line, 40)
    for i in range(8):
        line.say(("raise the right hand", "stand idle")[i % 2], 10 * i)
        line.say(("stand idle", "raise the right hand")[i % 2], 10 * i)
        line.steer(Steer(speed=0.1 * i), 10 * i)
        out = made(line, line.frame + 1, out)
    assert np.abs(np.diff(out[:, 7:], axis=0) * FPS).max() < max(j.velocity for j in rig.joints)
    assert line.work.refused == 0


def test_unknown_text_changes_nothing(rig: Rig) -> None:
    line = opened(rig)
    made(line, 40)
    at = line.frame
    assert not line.say("sing", 5).known
    assert not line.changing
    assert line.frame == at


def test_rest_from_the_middle_of_a_move_ends_in_the_pose_it_began_with(rig: Rig) -> None:
    line = opened(rig)
    line.say("raise the right hand", 0)
    out = made(line, 70)
    block = line.rest(40)
    assert block.text == "rest"
    assert 40 <= block.first <= 40 + BLOCK * STEP / 30 * FPS
    assert np.allclose(block.qpos[-1], line.rest_pose)
    assert np.abs(out[block.first - 1, 7:] - line.rest_pose[7:]).max() > 0.1
    out = made(line, line.frame + 30, np.concatenate([out[: block.first], block.qpos]))
    assert np.abs(np.diff(out[:, 7:], axis=0) * FPS).max() < max(j.velocity for j in rig.joints)


def test_refused_block_gives_way_to_rest_and_it_goes_on(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    line = opened(rig)
    line.say("raise the right hand", 0)
    out = made(line, 50)
    limit = thresholds.THRESHOLDS["joint_speed"]
    monkeypatch.setitem(thresholds.THRESHOLDS, "joint_speed", replace(limit, limit=0.0))
    block = line.make()
    assert block.text == "rest"
    assert line.work.refused == 1
    assert "rad/s" in line.work.why
    monkeypatch.undo()
    made(line, line.frame + 20, np.concatenate([out, block.qpos]))
    assert line.work.refused == 1
    assert np.allclose(block.qpos[-1], line.rest_pose)


@pytest.mark.parametrize("late", [False, True])
def test_what_was_admitted_is_done_where_something_else_is_refused_or_late(
    rig: Rig, late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    line = opened(rig)
    out = made(line, 60)
    end = line.frame
    line.say("raise the right hand", 20)
    if late:
        line.make()
        line.forget()
        block = line.take_way()
    else:
        limit = thresholds.THRESHOLDS["joint_speed"]
        monkeypatch.setitem(thresholds.THRESHOLDS, "joint_speed", replace(limit, limit=0.0))
        block = line.make()
    assert block.first == end == len(out)
    assert np.abs(np.diff(np.concatenate([out, block.qpos])[:, 7:], axis=0) * FPS).max() < 1.0
    assert np.allclose(block.qpos[-1], line.rest_pose)


def test_what_comes_too_late_is_made_again_further_ahead(rig: Rig) -> None:
    line, other = opened(rig), opened(rig)
    out, others = made(line, 60), made(other, 60)
    line.say("raise the right hand", 10)
    line.make()  # and frames beyond its first one have been played by now
    line.again(24)
    other.say("raise the right hand", 24)
    assert line.changing
    assert line.frame == other.frame >= 24 + LEAD_S * FPS
    assert np.array_equal(made(line, 90, out)[:90], made(other, 90, others)[:90])


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


def test_playlist_has_later_rows_take_the_place_of_earlier_ones() -> None:
    playlist = Playlist()
    playlist.put(rows(10, "a"), tuple(rows(1, "far")), 0)
    playlist.play()
    with playlist.held() as playhead:
        assert playhead == 1
    assert playlist.put(rows(1, "b"), tuple(rows(1, "near")), 4)
    assert [p[0].text for p in (playlist.play() for _ in range(5)) if p] == ["a", "a", "a", "b", "near"]


def test_rows_that_come_too_late_change_nothing() -> None:
    playlist = Playlist()
    playlist.put(rows(4, "a"), tuple(rows(1, "way")), 0)
    playlist.play()
    playlist.play()
    assert not playlist.put(rows(4, "late"), (), 1)
    assert not playlist.ran_out
    assert [p[0].text for p in (playlist.play() for _ in range(3)) if p] == ["a", "a", "way"]


def test_who_waits_for_room_wakes_for_something_else() -> None:
    playlist = Playlist()
    playlist.put(rows(4, "a"), (), 0)
    assert playlist.wait_below(5, 0.0)
    assert not playlist.wait_below(5, 0.0, lambda: True)
    asked = threading.Event()
    woken = threading.Thread(target=lambda: playlist.wait_below(2, 60.0, asked.is_set))
    woken.start()
    asked.set()
    playlist.wake()
    woken.join(10.0)
    assert not woken.is_alive()
