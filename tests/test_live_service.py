"""The service over a live line, in step with a clock of its own: prompts at once, in turn, refused; steering; ends."""

from __future__ import annotations

import io
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_weights import live_weights
from scripted_live import Scripted
from small_rig import free_address
from test_service import DESK, PHONE, FakePublisher
from test_stream import FakeClock

from drivers.control import Rest, Say, Told
from drivers.frame import State
from drivers.messages import Hello, RigState
from motiongen.generator import is_live
from motiongen.live.steering import Area, Steer
from retarget.rig import Rig, load_rig
from rigcast.__main__ import main
from rigcast.prompt import listen
from rigcast.service.desk import Settings
from rigcast.service.line import FPS, Line
from rigcast.service.live_maker import LiveMaker
from rigcast.service.live_service import REST, LiveService
from rigcast.service.running import run
from sim import thresholds

RAISE = "raise the right hand"


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("puppet")


class Stage:
    """A live service whose maker takes its turn between frames; two answers of the generator are known."""

    def __init__(self, rig: Rig) -> None:
        self.rig, self.generator, self.clock = rig, Scripted(), FakeClock()
        generator: Any = self.generator
        self.maker = LiveMaker(Line(generator, rig, clock=lambda: 0.0))
        self.publisher: Any = FakePublisher()
        limits = tuple(0.0 for _ in rig.joints)
        self.publisher.hello = Hello(rig.name, rig.hash, rig.joint_names(), limits, limits, limits, FPS, 7, "1" * 16)
        self.typed_told: list[Told] = []
        settings = Settings(FPS, 5.0, "scripted")
        self.service = LiveService(self.publisher, self.maker, settings, self.clock, self.typed_told.append)
        for _ in range(4):
            self.maker.step()

    def ask(self, caller: Any, request: Any) -> None:
        self.publisher.asked.append((caller, request))

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds * FPS)):
            self.service.cycle()
            if not self.maker.over.is_set():
                self.maker.step()

    def events(self, id: str) -> list[str]:
        return self.publisher.events(id)

    def shoulder(self) -> np.ndarray:
        """How far the right upper arm is from where it hangs, in each frame."""
        arm = [k for k, name in enumerate(self.rig.joint_names()) if name.startswith("right_shoulder")]
        pos = np.array([frame.pos[0, arm] for frame in self.publisher.frames])
        return np.abs(pos - pos[0]).max(1)

    def check_smooth(self) -> None:
        """One numbering, a period apart, no joint above its speed."""
        frames = self.publisher.frames
        assert [frame.seq for frame in frames] == list(range(len(frames)))
        steps = np.diff([frame.pos[0] for frame in frames], axis=0) * FPS
        assert (np.abs(steps) <= 1.01 * np.array([j.velocity for j in self.rig.joints])).all()


@pytest.fixture
def stage(rig: Rig) -> Stage:
    return Stage(rig)


def test_a_prompt_is_shown_at_once_and_ends(stage: Stage) -> None:
    stage.go(0.5)
    stage.ask(DESK, Say("a", RAISE, seconds=2.0))
    stage.go(0.6)
    assert stage.events("a") == ["queued", "making", "ready", "playing"]
    assert (stage.service.status().mode, stage.service.status().playing) == ("playing", RAISE)
    assert 1.0 < stage.service.status().left_s < 2.0
    stage.go(2.2)
    assert stage.events("a")[-1] == "played"
    assert stage.shoulder().max() > 0.5
    assert all(frame.report_id for frame in stage.publisher.frames)
    stage.check_smooth()


def test_prompts_wait_their_turn_or_take_the_place_of_others(stage: Stage) -> None:
    for id in "abc":
        stage.ask(DESK, Say(id, RAISE, seconds=1.0))
    stage.go(0.7)
    assert [stage.events(id)[-1] for id in "abc"] == ["playing", "queued", "queued"]
    stage.go(1.0)
    assert [stage.events(id)[-1] for id in "abc"] == ["played", "playing", "queued"]
    stage.ask(DESK, Say("d", RAISE, seconds=1.0, replace=True))
    stage.go(0.7)
    assert [stage.events(id)[-1] for id in "abcd"] == ["played", "dropped", "dropped", "playing"]
    assert stage.service.counts["cuts"] == 1
    stage.check_smooth()


def test_a_prompt_every_50_ms_keeps_the_stream_going_and_the_last_one_wins(stage: Stage) -> None:
    for i in range(12):
        stage.service.typed.put(RAISE if i % 2 else "stand idle")
        stage.go(0.05)
    stage.go(1.5)
    assert stage.maker.line.work.refused == 0
    outcomes = stage.service.outcomes
    assert outcomes["dropped"] + outcomes["rejected"] + outcomes["played"] == 11
    assert stage.shoulder()[-1] > 0.5
    assert not stage.typed_told or {t.event for t in stage.typed_told} <= {
        "queued",
        "making",
        "ready",
        "playing",
        "dropped",
    }
    stage.check_smooth()


def test_unknown_and_endless_texts_are_one_line_and_change_nothing(stage: Stage) -> None:
    stage.ask(DESK, Say("a", "sing"))
    stage.ask(DESK, Say("b", RAISE, seed=3))
    stage.go(0.3)
    stage.service.typed.put("sing")
    stage.go(0.3)
    stage.service.typed.put("wave " * 1000)
    stage.go(0.3)
    far = "'sing' is far from what is known; nearest: wave; it goes on as it was"
    ends = [t for t in stage.typed_told if t.event in ("refused", "rejected")]
    assert [t.detail for t in ends] == [far, "the text has 4999 characters; at most 1000 are taken"]
    assert far in [a.detail for _, a in stage.publisher.told if a.id == "a"]
    assert "seed and guidance" in [a.detail for _, a in stage.publisher.told if a.id == "b"][-1]
    assert stage.shoulder().max() < 0.3


def test_who_types_need_not_wait_for_who_sends(stage: Stage) -> None:
    stage.ask(PHONE, Say("a", RAISE, seconds=4.0))
    stage.go(0.5)
    stage.ask(DESK, Say("b", RAISE))
    stage.service.typed.put("stand idle")
    stage.go(0.5)
    assert stage.events("a")[-1] == "dropped"
    assert "'phone' has the rig" in stage.publisher.told[-1][1].detail or stage.events("b") == ["refused"]


def test_steering_goes_beside_the_text(stage: Stage) -> None:
    stage.generator.area = Area((-2, -2), (2, 2))
    stage.service.typed.put(RAISE)
    stage.ask(DESK, Say("a", "heading 90"))
    stage.ask(DESK, Say("b", "speed 0.5"))
    stage.ask(DESK, Say("c", "path 1,0 3,0"))
    stage.ask(DESK, Say("d", "heading left"))
    stage.go(0.8)
    assert [stage.events(id)[-1] for id in "abcd"] == ["played", "played", "refused", "refused"]
    told = {a.id: a.detail for _, a in stage.publisher.told}
    assert told["c"] == "the path leaves the floor at (3, 0) m; it is allowed within x -2…2 m, y -2…2 m"
    assert told["d"].startswith("'heading left': say heading DEGREES")
    assert stage.generator.steers == [Steer(heading=np.pi / 2), Steer(heading=np.pi / 2, speed=0.5)]
    assert stage.shoulder().max() > 0.3


def test_rest_leads_back_and_forgets(stage: Stage) -> None:
    stage.service.typed.put(RAISE)
    stage.service.typed.put("heading 90")
    stage.go(1.5)
    stage.ask(DESK, Rest("r"))
    stage.go(3.0)
    assert stage.events("r") == ["resting"]
    assert stage.generator.steers[-1] == Steer()
    assert stage.shoulder()[-1] < 0.15
    stage.service.typed.put(REST)
    stage.go(0.1)
    stage.check_smooth()


def test_the_gates_no_is_told_to_who_asked(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    stage.ask(DESK, Say("a", RAISE))
    stage.go(0.3)
    limit = thresholds.THRESHOLDS["joint_speed"]
    monkeypatch.setitem(thresholds.THRESHOLDS, "joint_speed", replace(limit, limit=0.0))
    stage.go(0.6)
    monkeypatch.undo()
    stage.go(0.8)
    assert stage.events("a")[-1] == "rejected"
    assert "the gate refused what was drawn" in stage.publisher.told[-1][1].detail
    stage.check_smooth()


def test_late_frames_lead_to_rest_and_it_goes_on(stage: Stage) -> None:
    for _ in range(2):
        for _ in range(200):
            stage.service.cycle()  # and nothing is made meanwhile
        stage.go(0.3)
    assert ["too slow" in told.detail for told in stage.typed_told] == [True]  # once
    stage.ask(DESK, Say("a", RAISE, seconds=4.0))
    stage.go(0.3)
    for _ in range(200):
        stage.service.cycle()
    stage.go(0.3)
    assert stage.events("a")[-1] == "rejected"
    assert "too slow" in stage.publisher.told[-1][1].detail
    stage.ask(DESK, Say("b", RAISE))
    stage.go(1.5)
    assert stage.events("b")[-1] == "playing"
    stage.check_smooth()


def test_a_rig_that_trips_drops_what_was_asked_and_a_stop_is_for_good(stage: Stage) -> None:
    stage.ask(DESK, Say("a", RAISE))
    stage.go(0.5)
    tripped = RigState("puppet", stage.rig.hash, "tripped", "too hot", 0, 0, ())
    stage.publisher.roster.note("", tripped, stage.clock.ns)
    stage.go(2.5)
    assert stage.events("a")[-1] == "dropped"
    assert stage.shoulder()[-1] < 0.15
    stage.publisher.stopped = "desk said stop"
    stage.service.typed.put(RAISE)
    stage.go(0.1)
    assert stage.publisher.frames[-1].state == State.SAFE
    assert "start the service again" in stage.typed_told[-1].detail
    stage.service.leave("the service is ending")
    assert stage.service.over


def test_it_ends_at_rest_once_what_was_typed_is_shown(stage: Stage) -> None:
    ended = threading.Event()
    listen(["", f"{RAISE}\n"], stage.service.typed, ended)
    assert ended.is_set()

    class InStep:
        """The clock of a service whose maker has a turn before each frame."""

        def __getattr__(self, name: str) -> Any:
            return getattr(stage.clock, name)

        def sleep_until_ns(self, ns: int) -> None:
            if not stage.maker.over.is_set():
                stage.maker.step()
            stage.clock.sleep_until_ns(ns)

    clock: Any = InStep()
    stage.service._clock = clock
    run(stage.service, lambda: int(ended.is_set() and not stage.service.busy), lambda: None, clock)
    assert stage.service.outcomes["played"] == 1
    assert stage.shoulder().max() > 0.5
    assert stage.shoulder()[-1] < 0.05
    assert [frame.state for frame in stage.publisher.frames[-3:]] == [State.IDLE] * 3


def test_failure_plays_the_way_to_rest_and_is_told(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    stage.ask(DESK, Say("a", RAISE))
    stage.go(1.0)
    monkeypatch.setattr(stage.generator, "next_chunk", lambda: None)
    stage.maker.start()
    while not stage.service.over:
        stage.service.cycle()
        time.sleep(0.001)
    stage.maker.join(60.0)
    assert isinstance(stage.maker.error, (AttributeError, TypeError))
    assert stage.shoulder()[-1] < 0.15


def test_the_command_streams_what_is_typed_and_ends_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    weights, address = live_weights(tmp_path / "small.safetensors"), free_address()
    assert is_live(str(weights))
    monkeypatch.setattr("sys.stdin", io.StringIO("make me a sandwich\npath 9,0\n"))
    assert main(["say", "--live", "--generator", str(weights), "--publish", address, "--floor", "2"]) == 0
    told = capsys.readouterr()
    assert int(told.out.split()[0]) > 20
    assert f"puppet idles on {address}" in told.err
    assert "'make me a sandwich' is far from what is known; nearest: " in told.err
    assert "the path leaves the floor at (9, 0) m" in told.err


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["say", "--live", "--out", "x.npz"], "--live streams at 50 Hz what has passed, and nothing else"),
        (["say", "--live", "--seconds", "3"], "--live follows what is typed"),
        (["say", "--live", "--generator", "mdm-paper"], "no such weights file"),
        (["say", "wave", "--floor", "2"], "--floor goes with --live"),
        (["say", "--live", "--floor", "-1"], "a floor of -1 m"),
        (["serve", "--rate", "100"], "live streams at 50 Hz"),
        (["serve", "--generator", "gestures", "--floor", "2"], "--seed and --floor are for live motion"),
        (["serve", "--generator", "live", "--mount", "free"], "live motion is for rigs on a stand, not free"),
    ],
)
def test_live_with_other_wishes_is_refused(given: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(given) == 2
    assert message in " ".join(capsys.readouterr().err.split())
