"""A rig that mirrors a person: what it does while they show it, fall silent, show too much, or make no sense."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from motions import motion
from pythonosc.osc_message_builder import OscMessageBuilder

from drivers.inbox import Heard
from drivers.vmc import datagrams
from motiongen.motion import Motion, Source
from motiongen.rotation import axis_angle_to_quat
from retarget.rig import Rig, load_rig
from rigcast.mirroring import FPS, SILENT_S, START, Line, Mirror
from rigcast.performers import OfBones
from rigcast.service.playlist import Playlist
from sim.report import Check

MS = 1_000_000
TICK = round(1e9 / FPS)
FORWARD = np.array([1.0, 0.0, 0.0])


def lifting() -> Motion:
    """Both arms go up to the sides within two seconds and stay, 30 poses a second."""
    t = np.arange(121) / 30
    up = 1.4 * 0.5 * (1 - np.cos(np.pi * np.minimum(t / 2, 1)))
    turns = {f"{side}_shoulder": axis_angle_to_quat(FORWARD, sign * up) for side, sign in (("left", 1), ("right", -1))}
    return motion(4.0, 30.0, turns, "lift the arms")


class FakeInbox:
    """What is put into it, as an Inbox has it."""

    def __init__(self) -> None:
        self.waiting: deque[Heard] = deque()
        self.foreigner = ""

    def take(self) -> list[Heard]:
        return [self.waiting.popleft() for _ in range(len(self.waiting))]


class Stage:
    """A performer, a mirror and a player in step, on a clock of their own."""

    def __init__(self, rig: Rig) -> None:
        self.ns, self.shown, self.told = 10**9, 0, []
        self.inbox, self.playlist, self.line = FakeInbox(), Playlist(), Line(rig, "stand")
        tell = lambda about, line: self.told.append((about, line))  # noqa: E731
        self.mirror = Mirror(OfBones(), self.inbox, self.line, self.playlist, Source("test"), self, tell)
        self.rows: list[np.ndarray] = []
        self.held: list[bool] = []

    def now_ns(self) -> int:
        return self.ns

    def show(self, clip: Motion, seconds: float, spoil: Callable[[bytes], bytes] = lambda data: data) -> None:
        """Show `clip` from its start, and play meanwhile."""
        began, shown = self.ns, 0
        while self.ns < began + seconds * 1e9:
            while began + shown * 1e9 / clip.fps <= self.ns:
                for data in datagrams(clip, min(shown, len(clip) - 1), 0.0):
                    self.inbox.waiting.append(Heard(self.ns, "desk:1", spoil(data)))
                shown += 1
            self.tick()

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds * FPS)):
            self.tick()

    def tick(self) -> None:
        while self.mirror.work():
            pass
        self.held.append(self.playlist.done)
        row = self.playlist.play()
        self.rows.append(self.line.rest_pose if row is None else row[0].qpos)
        self.ns += TICK

    @property
    def about(self) -> list[str]:
        return list(dict.fromkeys(about for about, _ in self.told))

    def check(self) -> None:
        """Nothing jumps, whatever happened, and it begins and ends at rest."""
        rows = np.array(self.rows)
        speed = np.abs(np.diff(rows[:, 7:], axis=0)) * FPS
        assert (speed <= 1.01 * np.array([j.velocity for j in self.line.rig.joints])).all()
        np.testing.assert_allclose(rows[[0, -1]], np.tile(self.line.rest_pose, (2, 1)), atol=1e-6)
        assert self.held[-1]


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("puppet")


@pytest.fixture
def stage(rig: Rig) -> Stage:
    return Stage(rig)


def lifted(stage: Stage) -> np.ndarray:
    """How far the rig's left arm is up, rad, row by row."""
    at = stage.line.rig.joint_names().index("left_shoulder_roll")
    return np.abs(np.array(stage.rows)[:, 7 + at] - stage.line.rest_pose[7 + at])


def test_it_does_what_is_shown_and_rests_when_nobody_is_there(stage: Stage) -> None:
    stage.show(lifting(), 3.5)
    up = lifted(stage)
    begun = stage.held.index(False) / FPS
    assert 0.3 < begun < 1.0  # the delay
    assert up[round(3.4 * FPS)] > 1.0
    assert not any(stage.held[round(begun * FPS) :])
    stage.wait(2.5)
    assert stage.about == ["begun", "silent"]
    quiet = stage.held[round(3.5 * FPS) :].index(True) / FPS
    assert quiet < START / FPS + SILENT_S + 1.7  # it holds at rest
    stage.show(lifting(), 1.5)
    stage.mirror.leave()
    stage.wait(2.0)
    stage.check()
    assert stage.mirror.counts["refused"] == 0
    assert stage.mirror.counts["passed"] > 20


def test_what_the_gate_refuses_is_not_played(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    judge, judged = stage.line._gate.judge, []
    bad = Check("joint_speed", 9.0, 1.0, "rad/s", ok=False, advice="too fast, so slow down")

    def judging(moment: object, qpos: np.ndarray) -> object:
        verdict = judge(moment, qpos)
        judged.append(qpos)
        return replace(verdict, ok=False, failures=(bad,)) if len(judged) == 5 else verdict

    monkeypatch.setattr(stage.line._gate, "judge", judging)
    stage.show(lifting(), 2.0)
    assert ("refused", "the gate refuses what is shown; the rig goes to rest: too fast, so slow down") in stage.told
    played = np.array(stage.rows)
    assert not any((played == row).all(1).any() for row in judged[4])
    stage.wait(2.5)
    stage.check()


def test_frames_that_come_too_late_are_told_and_the_rig_has_rested(stage: Stage) -> None:
    stage.show(lifting(), 1.5)
    work = stage.mirror.work
    stage.mirror.work = lambda: False  # as where the machine is busy with something else
    stage.wait(1.0)
    stage.mirror.work = work
    stage.wait(2.0)
    assert "late" in stage.about
    stage.check()


def test_bones_that_are_missing_are_named(stage: Stage) -> None:
    stage.show(lifting(), 1.5, lambda data: data.replace(b"LeftHand\0", b"LeftFist\0"))
    stage.wait(0.1)
    assert ("lacking", "there is nobody to mirror: bones that never came: LeftHand") in stage.told
    assert stage.about == ["lacking"]
    stage.check()


def test_a_senseless_message_is_one_line_and_the_rest_goes_on(stage: Stage) -> None:
    builder = OscMessageBuilder("/VMC/Ext/Bone/Pos")
    for value in ("Hips", float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0, 1.0):
        builder.add_arg(value)
    for data in (builder.build().dgram, b"\x93NUMPY"):
        stage.inbox.waiting.append(Heard(stage.ns, "desk:1", data))
    stage.inbox.foreigner = "10.0.0.9:5"
    stage.show(lifting(), 1.0)
    assert stage.mirror.counts["senseless"] == 2
    lines = [line for _, line in stage.told]
    assert any("'Hips' is at nan" in line for line in lines)
    assert any("10.0.0.9:5 is not heard" in line for line in lines)
    assert stage.held.index(False) < FPS
    assert all("\n" not in line for line in lines)
