"""The jitter buffer: what comes late, out of step or not at all makes no difference as long as it waits long enough."""

import random
from dataclasses import replace

import numpy as np
import pytest
from small_rig import REPORT, free_address, small_rig, swing
from test_stream import FakeClock

from drivers.buffer import Buffer
from drivers.drive import Settings, drive
from drivers.endpoint import StreamError
from drivers.frame import encode
from drivers.gate import Gate
from drivers.publisher import frames_of
from drivers.receiver import Receiver
from drivers.roster import Roster
from drivers.simulated import SimulatedBus
from drivers.watchdog import Watchdog

RIG = small_rig()
MS = 1_000_000
FRAMES = [f for f in frames_of(swing(RIG, 2.0), RIG, REPORT, 1, 0) if f.state.name == "PLAY"]


def played(delay_s: float, late_ms: float, lost: float) -> tuple[np.ndarray, np.ndarray]:
    """Targets of joint a every 7 ms, and what they should be: frames are up to `late_ms` late and a share is `lost`."""
    rng = random.Random(2)
    kept = [f for f in FRAMES if rng.random() >= lost or not f.seq]
    comes = sorted((f.due_ns + int(rng.random() * late_ms * MS), f.seq) for f in kept)
    newest, buffer, found, wanted = -1, Buffer(delay_s), [], []
    for now in range(400 * MS, 2000 * MS, 7 * MS):
        while comes and comes[0][0] <= now:
            _, seq = comes.pop(0)
            if seq > newest:  # as the gate has it
                newest = seq
                buffer.put(FRAMES[seq])
        found.append(buffer.target_at(now)[0])
        at = (now - delay_s * 1e9) / 20 / MS
        wanted.append(np.interp(at, np.arange(len(FRAMES)), [f.pos[0, 0] for f in FRAMES]))
    return np.array(found), np.array(wanted)


def test_a_buffer_longer_than_the_jitter_takes_it_away():
    found, wanted = played(0.1, 60, 0.0)
    smooth = np.abs(found - wanted).max()
    assert smooth < 0.02  # frames that were overtaken are gone: linear over two periods in their place
    found, wanted = played(0.0, 60, 0.0)
    assert np.abs(found - wanted).max() > 3 * smooth


def test_what_is_lost_is_bridged():
    found, wanted = played(0.1, 0, 0.3)
    assert np.abs(found - wanted).max() < 0.03  # f'' of the swing is 7.9: 0.025 in the middle of 160 ms, 0.004 of 60 ms


def test_a_newer_frame_replaces_what_was_to_come_and_a_new_stream_everything():
    buffer = Buffer()
    still = {"vel": np.zeros((3, 3)), "root": np.tile(FRAMES[0].root, (3, 1)), "contacts": np.zeros(3)}
    buffer.put(replace(FRAMES[0], pos=np.full((3, 3), 1.0), **still))
    buffer.put(replace(FRAMES[1], pos=np.full((3, 3), 2.0), **still))
    assert [buffer.target_at(k * 10 * MS)[0] for k in (0, 1, 2, 4, 9)] == [1.0, 1.5, 2.0, 2.0, 2.0]
    buffer.put(replace(FRAMES[9], stream=2, pos=np.full((3, 3), 3.0), **still))
    assert buffer.target_at(0)[0] == 3.0


def test_a_buffer_that_would_hold_first_is_refused():
    with pytest.raises(StreamError, match=r"buffer 0\.4 s; it must be in 0…0\.3"):
        Receiver(free_address(), rig_hash=RIG.hash, buffer_s=0.4)


class FakeReceiver:
    """Gives the frames that are due but for those in `gap` (seconds); then it is over."""

    def __init__(self, gap: tuple[float, float]) -> None:
        self.gate, self.watchdog, self.buffer, self.roster, self.run = Gate(RIG.hash), Watchdog(), Buffer(), Roster(), 1
        self._left, self._gap, self.states = list(FRAMES), gap, []
        self.trouble, self.hello = "", None

    def poll(self, now_ns: int):
        self.watchdog.update(now_ns)
        frame = None
        while self._left and self._left[0].due_ns + 100_000 * MS <= now_ns:
            due = self._left[0].due_ns
            moved = replace(self._left.pop(0), capture_ns=due + 100_000 * MS, due_ns=due + 100_000 * MS)
            if not self._gap[0] <= due / 1e9 < self._gap[1]:
                frame = self.gate.check(encode(moved), now_ns)
        if frame is not None:
            self.buffer.put(frame)
            self.watchdog.fresh(frame.state, now_ns)
        self.watchdog.update(now_ns)
        return frame

    def send_state(self, state) -> None:
        self.states.append(state)


class PushedBus(SimulatedBus):
    """Somebody keeps joint a at 1 rad while the rig holds; `written` is (seconds, command, mode)."""

    def __init__(self, receiver: FakeReceiver, clock: FakeClock) -> None:
        super().__init__(RIG, clock=clock)
        self._receiver, self._its_clock, self.written, self.pushed = receiver, clock, [], False

    def read(self):
        if self._receiver.watchdog.mode == "hold" and self._its_clock.ns < 101_000 * MS:
            self.pushed = True
            self._advance()
            self.motors[0].angle = 1.0
        return super().read()

    def write(self, goal) -> None:
        self.written.append((self._its_clock.ns / 1e9 - 100, float(goal[0]), self._receiver.watchdog.mode))
        super().write(goal)


def test_after_a_hold_it_eases_from_where_the_rig_really_is():
    clock = FakeClock()
    receiver = FakeReceiver((0.4, 0.9))
    bus = PushedBus(receiver, clock)
    drive(RIG, receiver, bus, Settings(ease_velocity=1.0, settle_s=0.1, following_error=2.0), clock=clock)
    assert bus.pushed
    modes = [mode for _, _, mode in bus.written]
    back = modes.index("following", modes.index("hold"))
    before, after = bus.written[back - 1][1], [w[1] for w in bus.written[back : back + 6]]
    measured = next(s for s in receiver.states if s.mode == "following" and s.time_ns / 1e9 - 100 > 0.9).position[0]
    assert abs(measured - before) > 0.3
    assert abs(after[0] - measured) <= 1.0 * 0.02 + 1e-9
    assert np.abs(np.diff(after)).max() <= 1.0 * 0.02 + 1e-9
