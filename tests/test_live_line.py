"""The live line with a generator that plays gestures by heart: what is admitted, changed, refused, and led to rest."""

from __future__ import annotations

import queue
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from motiongen.generator import Familiarity, check_prompt, load_generator
from motiongen.motion import Label, Motion, cut
from retarget.rig import Rig, load_rig
from rigcast.__main__ import main
from rigcast.prompt import REST, Maker
from rigcast.service.line import BLOCK, FPS, LEAD_S, Line
from rigcast.service.playlist import Playlist, Row
from sim import thresholds

CHUNK = 30


class Scripted:
    """The part of `LiveGenerator` that a line uses: `texts` tells what is shown from which frame on."""

    def __init__(self) -> None:
        gestures = load_generator("gestures")
        self._motions = {t: gestures.generate(t, seconds=8.0) for t in ("stand idle", "raise the right hand")}
        self.skeleton = self._motions["stand idle"].skeleton
        self.frame, self.texts = 0, {0: "stand idle"}

    def next_chunk(self) -> Motion:
        since = max(f for f in self.texts if f <= self.frame)
        text, whole = self.texts[since], self._motions[self.texts[since]]
        rows = np.minimum(np.arange(CHUNK) + self.frame - since, len(whole) - 1)
        self.frame += CHUNK
        label = Label(0.0, (CHUNK - 1) / whole.fps, text)
        root, quat = whole.root_pos[rows], whole.joint_quat[rows]
        return replace(whole, root_pos=root, joint_quat=quat, contacts=None, labels=(label,))

    def familiarity(self, text: str) -> Familiarity:
        return Familiarity(check_prompt(text) in self._motions, 0.0, ("wave",))

    def say(self, text: str, at_frame: int, *, seconds: float | None = None) -> Familiarity:
        found = self.familiarity(text)
        if found.known:
            self.texts = {f: t for f, t in self.texts.items() if f < at_frame} | {at_frame: text}
            self.frame = at_frame
        return found

    def idle(self, at_frame: int) -> None:
        self.say("stand idle", at_frame)


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


def test_what_is_typed_is_obeyed_or_answered_in_a_line(rig: Rig) -> None:
    line, playlist, told = opened(rig), Playlist(), queue.SimpleQueue[str]()
    maker = Maker(line, playlist, told.put)
    for text in ("sing", "wave " * 1000, "raise the right hand", REST, None):
        maker.said.put(text)
    maker.start()
    maker.join(300.0)
    assert maker.failed is None
    assert maker.over.is_set()
    assert told.get(timeout=1) == "'sing' is far from what is known; nearest: wave; it goes on as it was"
    assert told.get(timeout=1) == "the text has 4999 characters; at most 1000 are taken"
    assert told.empty()
    last = None
    while not playlist.done:
        last = playlist.play()
    assert last is not None
    assert np.allclose(last[0].qpos, line.rest_pose)


def test_failure_plays_the_way_to_rest_and_is_told(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    line, playlist = opened(rig), Playlist()
    maker = Maker(line, playlist, lambda text: None)
    chunks = line.generator.next_chunk
    drawn = iter([chunks(), chunks()])
    monkeypatch.setattr(line.generator, "next_chunk", lambda: next(drawn))  # then StopIteration
    maker.start()
    last = None
    while not (maker.over.is_set() and playlist.done):
        last = playlist.play() or last
    maker.join(300.0)
    assert isinstance(maker.failed, StopIteration)
    assert last is not None
    assert np.allclose(last[0].qpos, line.rest_pose)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--out", "x.npz"], "--live streams at 50 Hz what has passed, and nothing else"),
        (["--seconds", "3"], "--live follows what is typed"),
        (["--generator", "mdm-paper"], "no such weights file"),
    ],
)
def test_live_with_other_wishes_is_refused(given: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["say", "--live", *given]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
