"""The live service on a clock of its own: who may say what, what plays when, and that no hand-over jumps."""

from __future__ import annotations

import sys
from collections import deque
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from small_rig import REPORT, small_rig, swing
from test_stream import FakeClock

from drivers.control import Look, Rest, Say, Status, Told
from drivers.frame import State
from drivers.messages import RigState
from drivers.publisher import Caller
from drivers.roster import Roster
from retarget.cut import cut_short
from retarget.files import load_trajectory, save_trajectory
from retarget.trajectory import Trajectory
from rigcast.service.desk import Settings
from rigcast.service.lease import Lease
from rigcast.service.making import Cut, Made, Make, Setup
from rigcast.service.player import IDLE, part_of
from rigcast.service.running import run
from rigcast.service.service import Service
from rigcast.service.workshop import Workshop

RIG = small_rig()
NS = 1_000_000_000
RATE = 100.0
DESK, PHONE = Caller(b"1", "desk"), Caller(b"2", "phone")


class FakePublisher:
    """Keeps what was sent and told; `asked` is what will be asked next."""

    def __init__(self) -> None:
        self.frames, self.told, self.hello, self.stopped, self.roster = [], [], None, "", Roster()
        self.asked: deque = deque()

    def send(self, frame) -> None:
        self.frames.append(frame)

    def states(self) -> None:
        pass

    def requests(self) -> list:
        found = list(self.asked)
        self.asked.clear()
        return found

    def tell(self, caller, answer) -> None:
        self.told.append((caller.key, answer))

    def events(self, id: str) -> list[str]:
        return [a.event for _, a in self.told if isinstance(a, Told) and a.id == id]


class FakeMaker:
    """Has what `take(job)` gives ready after `seconds` of the clock; `jobs` are those it was asked for."""

    def __init__(self, clock: FakeClock, take, seconds: float) -> None:
        self.busy, self.jobs, self.starts = False, [], 1
        self._clock, self._take, self._seconds = clock, take, seconds

    def ask(self, job) -> None:
        assert not self.busy
        self.busy, self._ready_ns = True, self._clock.ns + int(self._seconds * NS)
        self.jobs.append(job)

    def done(self):
        if self._clock.ns < self._ready_ns:
            return None
        self.busy = False
        return self._take(self.jobs[-1])


class Stage:
    """A service with makers that take `make_s` and `cut_s`; a text is the height of a swing that lasts 4 s."""

    def __init__(self, folder: Path, make_s: float = 2.0, cut_s: float = 0.3) -> None:
        self.folder, self.clock, self.publisher = folder, FakeClock(), FakePublisher()
        self.cuts_fail = 0
        save_trajectory(self.swing(0.1, 20.0), folder / "idle.npz")
        idle = part_of(IDLE, folder / "idle.npz", "1" * 16, RATE)
        self.maker = FakeMaker(self.clock, self.make, make_s)
        self.cutter = FakeMaker(self.clock, self.cut, cut_s)
        settings = Settings(rate_hz=RATE, lease_s=5.0, generator="fake")
        self.service = Service(RIG, self.publisher, idle, self.maker, self.cutter, settings, self.clock)

    def swing(self, height: float, seconds: float = 4.0) -> Trajectory:
        return swing(RIG, seconds, amplitude=height)

    def make(self, job: Make) -> Made:
        if job.text == "fall":
            return Made(job.number, ok=False, detail="it falls", report_id="f" * 16)
        path = self.folder / f"{job.number}.npz"
        save_trajectory(self.swing(float(job.text)), path)
        return Made(job.number, ok=True, path=str(path), seconds=4.0, report_id=f"{job.number:016x}")

    def cut(self, job: Cut) -> Made:
        if self.cuts_fail:
            self.cuts_fail -= 1
            return Made(job.number, ok=False, detail="it trips over itself")
        path = self.folder / f"{job.number}.npz"
        save_trajectory(cut_short(load_trajectory(job.path), job.frame, RIG), path)
        return Made(job.number, ok=True, path=str(path), report_id=f"{job.number:016x}")

    def ask(self, caller: Caller, request) -> None:
        self.publisher.asked.append((caller, request))

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds * RATE)):
            self.service.cycle()

    def status(self) -> Status:
        return self.service.status()

    def angles(self) -> np.ndarray:
        return np.array([frame.pos[0, 0] for frame in self.publisher.frames])

    def check_smooth(self) -> None:
        """Frames a period apart, no step above the rig's speed, no sudden change of speed, one numbering."""
        frames, angles = self.publisher.frames, self.angles()
        assert [frame.seq for frame in frames] == list(range(len(frames)))
        assert set(np.diff([frame.due_ns for frame in frames])) == {round(NS / RATE)}
        speed = np.diff(angles) * RATE
        assert np.abs(speed).max() <= RIG.joints[0].velocity + 1e-3
        assert np.abs(np.diff(speed)).max() < 0.4  # two frames are linear between two checked ones: 0.1 without cuts


@pytest.fixture
def stage(tmp_path: Path) -> Stage:
    return Stage(tmp_path)


def test_a_prompt_plays_once_it_has_passed_and_then_the_rig_idles(stage: Stage) -> None:
    stage.go(1.0)
    assert stage.status().mode == "idle"
    stage.ask(DESK, Say("a", "0.5"))
    stage.go(1.9)
    assert stage.publisher.events("a") == ["queued", "making"]
    assert stage.angles().max() < 0.31  # nothing of it before the gate has said yes
    stage.go(3.0)
    assert stage.publisher.events("a") == ["queued", "making", "ready", "playing"]
    assert (stage.status().mode, stage.status().playing) == ("playing", "0.5")
    assert stage.publisher.hello.report_id == stage.publisher.frames[-1].report_id == f"{1:016x}"
    stage.go(5.0)
    assert stage.publisher.events("a")[-1] == "played"
    assert stage.angles().max() == pytest.approx(0.2 + 0.5, abs=1e-3)
    assert stage.status().mode == "idle"
    assert stage.publisher.frames[-1].report_id == "1" * 16
    stage.check_smooth()
    assert not (stage.folder / "1.npz").exists()


def test_what_is_rejected_leaves_the_rig_idle_and_the_sender_knows_why(stage: Stage) -> None:
    stage.ask(DESK, Say("a", "fall"))
    stage.go(6.0)
    told = stage.publisher.told[-1][1]
    assert (told.event, told.detail, told.report_id) == ("rejected", "it falls", "f" * 16)
    assert {frame.report_id for frame in stage.publisher.frames} == {"1" * 16}
    assert (stage.status().mode, len(stage.cutter.jobs)) == ("idle", 0)


def test_prompts_play_in_turn_and_a_replacement_at_once(stage: Stage) -> None:
    for id, text in (("a", "0.5"), ("b", "0.6"), ("c", "0.7")):
        stage.ask(DESK, Say(id, text))
    stage.go(6.0)
    assert [stage.publisher.events(i)[-1] for i in "abc"] == ["playing", "ready", "making"]
    assert stage.status().waiting == ("0.6", "0.7")
    stage.ask(DESK, Say("d", "0.8", replace=True))
    stage.go(0.1)
    assert [stage.publisher.events(i)[-1] for i in "abcd"] == ["playing", "dropped", "dropped", "making"]
    stage.go(10.0)
    assert [stage.publisher.events(i)[-1] for i in "abcd"][::3] == ["played", "played"]
    assert stage.angles().max() == pytest.approx(1.0, abs=1e-3)
    stage.check_smooth()


def test_a_replacement_cuts_what_plays_short(stage: Stage) -> None:
    stage.maker._seconds = 0.5
    stage.ask(DESK, Say("a", "0.5"))
    stage.go(2.2)
    assert stage.publisher.events("a")[-1] == "playing"
    stage.ask(DESK, Say("b", "0.8", replace=True))
    stage.go(2.5)
    assert stage.publisher.events("a")[-1] == "dropped"
    assert stage.publisher.events("b")[-1] == "playing"
    stage.check_smooth()


def test_a_cut_that_the_gate_refuses_or_that_comes_too_late_is_tried_further_on(stage: Stage) -> None:
    stage.cuts_fail = 2
    stage.cutter._seconds = 1.0  # longer than the first cuts are ahead
    stage.ask(DESK, Say("a", "0.5"))
    stage.go(10.0)
    assert len(stage.cutter.jobs) >= 3
    frames = [job.frame for job in stage.cutter.jobs]
    assert frames == sorted(set(frames))
    assert stage.publisher.events("a")[-1] == "playing"
    stage.check_smooth()


def test_a_motion_that_cannot_be_cut_plays_to_its_end(stage: Stage) -> None:
    stage.cuts_fail = 1000
    stage.ask(DESK, Say("a", "0.5"))
    stage.go(26.0)  # the idle motion takes 20 s
    assert stage.publisher.events("a")[-1] == "played"
    stage.check_smooth()


def test_rest_drops_everything(stage: Stage) -> None:
    for id in "ab":
        stage.ask(DESK, Say(id, "0.5"))
    stage.go(3.5)
    stage.ask(DESK, Rest("c"))
    stage.go(2.5)
    assert [stage.publisher.events(i)[-1] for i in "abc"] == ["dropped", "dropped", "resting"]
    assert (stage.status().mode, stage.publisher.frames[-1].report_id) == ("idle", "1" * 16)
    stage.check_smooth()


def test_one_sender_has_the_rig_at_a_time(stage: Stage) -> None:
    stage.ask(DESK, Say("a", "0.5"))
    stage.go(0.1)
    for request in (Say("b", "0.6"), Rest("c")):
        stage.ask(PHONE, request)
        stage.go(0.1)
        assert stage.publisher.events(request.id) == ["refused"]
        assert "'desk' has the rig" in stage.publisher.told[-1][1].detail
    stage.ask(PHONE, Look("d"))
    stage.go(0.1)
    assert (stage.publisher.told[-1][0], stage.publisher.told[-1][1].owner) == (PHONE.key, "desk")
    stage.go(9.0)
    assert stage.publisher.events("a")[-1] == "played"
    stage.go(5.0)
    stage.ask(PHONE, Say("e", "0.6"))
    stage.go(0.1)
    assert stage.publisher.events("e")[0] == "queued"


def test_a_queue_that_is_full_says_so(stage: Stage) -> None:
    for k in range(17):
        stage.ask(DESK, Say(f"n{k}", "0.5"))
    stage.go(0.1)
    assert stage.publisher.events("n15")[0] == "queued"
    assert stage.publisher.events("n16") == ["refused"]


def state(mode: str, reason: str = "", run: int = 1) -> RigState:
    return RigState("small", RIG.hash, mode, reason, 0, 0, (0.0, 0.0, 0.0), run=run)


def test_nobody_walks_on_a_tripped_rig(stage: Stage) -> None:
    stage.ask(DESK, Say("a", "0.5"))
    stage.ask(DESK, Say("b", "0.5"))
    stage.go(3.5)
    stage.publisher.roster.note("", state("tripped", "joint a is jammed"), stage.clock.ns)
    stage.go(0.1)
    assert [stage.publisher.events(i)[-1] for i in "ab"] == ["dropped", "dropped"]
    stage.ask(DESK, Say("c", "0.5"))
    stage.go(2.0)
    assert stage.publisher.events("c") == ["refused"]
    assert (stage.status().mode, stage.status().reason) == ("resting", "small is tripped: joint a is jammed")
    assert stage.publisher.frames[-1].report_id == "1" * 16
    stage.publisher.roster.note("", state("waiting", run=2), stage.clock.ns)  # started anew, by somebody at the rig
    stage.go(0.1)
    assert stage.status().mode == "idle"
    stage.ask(DESK, Say("d", "0.5"))
    stage.go(0.1)
    assert stage.publisher.events("d")[0] == "queued"
    stage.check_smooth()


def test_rest_goes_on_without_a_rig_that_stays_away(stage: Stage) -> None:
    stage.publisher.roster.note("", state("safe"), stage.clock.ns)
    stage.go(0.1)
    stage.ask(DESK, Rest("a"))
    stage.go(0.1)
    assert stage.status().mode == "idle"


def test_a_stop_is_for_good(stage: Stage) -> None:
    stage.ask(DESK, Say("a", "0.5"))
    stage.go(4.0)
    stage.publisher.stopped = "a hand is in the way"
    stage.go(0.1)
    assert stage.publisher.events("a")[-1] == "dropped"
    still = stage.angles()[-9:]
    assert (still == still[0]).all()
    assert stage.publisher.frames[-1].state == State.SAFE
    stage.ask(DESK, Say("b", "0.5"))
    stage.go(0.1)
    assert "a hand is in the way" in stage.publisher.told[-1][1].detail


def test_a_machine_that_stood_still_does_not_jump_ahead(stage: Stage) -> None:
    stage.go(3.0)
    before = len(stage.publisher.frames)
    stage.clock.ns += 5 * NS
    stage.go(1.0)
    frames = stage.publisher.frames
    assert frames[before].due_ns - frames[before - 1].due_ns >= 5 * NS
    assert np.abs(np.diff(stage.angles())).max() * RATE <= RIG.joints[0].velocity


def test_a_signal_leads_back_to_rest_and_says_the_end(stage: Stage) -> None:
    stage.ask(DESK, Say("a", "0.5"))
    caught: list[int] = []

    def each_second() -> None:
        caught.extend([1] * (len(stage.publisher.frames) > 4 * RATE and not caught))

    run(stage.service, lambda: len(caught), each_second, stage.clock)
    assert stage.publisher.events("a")[-1] == "dropped"
    assert [frame.state for frame in stage.publisher.frames[-4:]] == [State.PLAY] + [State.IDLE] * 3
    np.testing.assert_allclose(stage.publisher.frames[-1].pos[0], RIG.pose_vector(RIG.nominal), atol=1e-6)
    assert len(stage.publisher.frames) < 8 * RATE
    stage.check_smooth()


def test_a_lease_ends_some_time_after_the_last_word() -> None:
    lease = Lease(5.0)
    assert lease.objection("a", 0) == ""
    lease.give("a", NS)
    assert (lease.objection("a", 2 * NS), lease.owner(2 * NS)) == ("", "a")
    assert "'a' has the rig" in lease.objection("b", 6 * NS - 1)
    assert lease.objection("b", 6 * NS) == ""


# --- makers that die, hang or talk


ECHO = """
import sys, json
print(json.dumps({"number": 0, "ok": True}), flush=True) if sys.stdin.readline() else None
for line in sys.stdin:
    job = json.loads(line)
    if job["text"] == "die":
        sys.exit(7)
    if job["text"] != "hang":
        print(json.dumps({"number": job["number"], "ok": False, "detail": job["text"]}), flush=True)
"""


def waited(workshop: Workshop) -> Made:
    while (made := workshop.done()) is None:
        pass
    return made


def test_a_maker_that_dies_is_started_anew_and_one_that_hangs_is_ended() -> None:
    now = [0.0]
    workshop = Workshop(Setup("small", "/nowhere"), (sys.executable, "-c", ECHO), lambda: now[0])
    try:
        assert waited(workshop).ok
        workshop.ask(Make(1, "hello"))
        assert waited(workshop).detail == "hello"
        workshop.ask(Make(2, "die"))
        made = waited(workshop)
        assert (made.number, made.ok, made.detail) == (2, False, "the process that makes motions ended with 7")
        workshop.ask(Make(3, "again"))
        assert (waited(workshop).detail, workshop.starts) == ("again", 2)
        workshop.ask(Make(4, "hang"))
        assert workshop.done() is None
        now[0] = 181.0
        made = waited(workshop)
        assert (made.number, made.detail) == (4, "it took more than 180 s")
        with pytest.raises(RuntimeError, match="job 6 while job 5"):
            workshop.ask(Make(5, "hang")) or workshop.ask(Make(6, "x"))
    finally:
        workshop.close()


@pytest.mark.parametrize(
    "change", [{"id": ""}, {"text": "x" * 1001}, {"seconds": -1.0}, {"seed": -1}, {"sender": "\x1b[2J"}]
)
def test_a_request_out_of_range_is_refused(change: dict) -> None:
    from drivers.control import request_in
    from drivers.frame import FrameError

    good = msgspec.to_builtins(Say("a", "wave"))
    assert request_in(msgspec.msgpack.encode(good)) == Say("a", "wave")
    with pytest.raises(FrameError, match="request"):
        request_in(msgspec.msgpack.encode({**good, **change}))


def test_a_part_is_played_at_the_rate_of_the_wire(tmp_path: Path) -> None:
    save_trajectory(replace(swing(RIG, 1.0), rig="small"), tmp_path / "x.npz")
    part = part_of(3, tmp_path / "x.npz", REPORT, 200.0)
    assert (len(part.trajectory), part.trajectory.fps, part.checked_fps) == (201, 200.0, 50.0)
