"""Publisher and receiver: what is accepted, what is refused, and what happens when frames stay away."""

import time
from dataclasses import replace

import numpy as np
import pytest
import zmq
from small_rig import REPORT, free_address, small_rig, swing

from drivers.endpoint import StreamError, endpoints
from drivers.frame import Frame, State
from drivers.messages import RigState
from drivers.publisher import Publisher, frames_of, hello_for, publish, require_free
from drivers.receiver import Receiver
from retarget.resample import resampled
from retarget.rig import Foot

RIG = small_rig()
MS = 1_000_000
S = 1_000 * MS


class FakeClock:
    """Time that passes only where somebody sleeps; every sleep overshoots by `late_ns`."""

    def __init__(self, late_ns: int = 0) -> None:
        self.ns, self.late_ns, self.slept = 100 * S, late_ns, []

    def now_ns(self) -> int:
        return self.ns

    def sleep_until_ns(self, when_ns: int) -> None:
        self.slept.append(when_ns)
        self.ns = max(self.ns, when_ns + self.late_ns)


def a_frame(seq=0, sent_ns=0, **changes) -> Frame:
    fields = {
        "stream": 1,
        "seq": seq,
        "rig_hash": RIG.hash,
        "report_id": REPORT,
        "capture_ns": sent_ns,
        "due_ns": sent_ns,
        "period_ns": 20 * MS,
        "pos": np.zeros((1, 3)),
        "vel": np.zeros((1, 3)),
        "root": np.array([[0, 0, 0, 1, 0, 0, 0]]),
        "contacts": np.zeros(1, np.uint32),
    }
    return Frame(**{**fields, **changes})


def until(condition, seconds=5.0):
    """Wait for `condition()`, which a socket's own thread makes true."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "nothing came"
        time.sleep(0.005)
    return found


# --- endpoints


def test_endpoints_derive_from_one():
    at = endpoints("tcp://127.0.0.1:5555")
    assert (at.frames, at.hello) == ("tcp://127.0.0.1:5555", "tcp://127.0.0.1:5556")
    assert (at.stop, at.state) == ("tcp://127.0.0.1:5557", "tcp://127.0.0.1:5558")
    assert endpoints("ipc:///tmp/x").hello == "ipc:///tmp/x.hello"


@pytest.mark.parametrize("address", ["", "localhost", "tcp://1.2.3.4", "tcp://h:0", "tcp://h:65533", "udp://h:1"])
def test_a_wrong_endpoint_is_one_clear_line(address):
    with pytest.raises(StreamError, match=r"endpoint|port") as caught:
        endpoints(address)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["tcp", "ipc"])
def test_of_two_publishers_on_one_endpoint_the_second_is_refused(kind, tmp_path):
    address, trajectory = free_address() if kind == "tcp" else f"ipc://{tmp_path}/s", swing(RIG)
    hello = hello_for(trajectory, RIG, REPORT, 1)
    require_free(address)
    with Publisher(hello, address), pytest.raises(StreamError, match="is busy"):
        require_free(address)
    with Publisher(hello, address), pytest.raises(StreamError, match="is busy"):
        Publisher(hello, address)
    with Publisher(hello, address):  # Everything was closed: the ports are free again.
        pass


# --- over real sockets


def test_frames_of_a_trajectory():
    foot = Foot("left", "foot", (), "left_ankle")
    rig = replace(RIG, feet=(replace(foot, name="right"), foot))
    trajectory = replace(swing(RIG, 0.2), contacts={"left": np.arange(11) % 2 == 0})
    frames = list(frames_of(trajectory, rig, REPORT, 9, 5 * S))
    assert [f.seq for f in frames] == list(range(14))
    assert [f.due_ns for f in frames] == [5 * S + k * 20 * MS for k in range(14)]
    assert [f.state for f in frames] == [State.PLAY] * 11 + [State.IDLE] * 3
    assert [int(f.contacts[0]) for f in frames[:3]] == [2, 0, 2]
    angle = np.array([f.pos[0, 0] for f in frames[:11]])
    np.testing.assert_allclose(angle, 0.2 + 0.2 * (1 - np.cos(2 * np.pi * np.arange(11) / 50)), atol=1e-6)
    speed = np.array([f.vel[0, 0] for f in frames[1:10]])
    np.testing.assert_allclose(speed, 0.4 * np.pi * np.sin(2 * np.pi * np.arange(1, 10) / 50), atol=5e-3)
    assert not frames[-1].vel.any()


def test_a_trajectory_of_another_rig_is_refused():
    trajectory = replace(swing(RIG), joints=("x", "y", "z"), rig="other")
    with pytest.raises(StreamError, match="other"):
        next(frames_of(trajectory, RIG, REPORT, 1, 0))


def test_deadlines_are_absolute():
    clock = FakeClock(late_ns=3 * MS)
    done = publish(swing(RIG, 0.5), RIG, REPORT, free_address(), clock=clock)
    assert clock.slept == [100 * S + k * 20 * MS for k in range(26 + 3)]
    assert (done.frames, done.heard, done.first_ns) == (29, False, 100 * S)
    assert (done.median_late_s, done.p99_late_s, done.worst_late_s) == (0.003, 0.003, 0.003)
    assert done.skipped == 0


class StallingClock(FakeClock):
    """Stands still for a second, once, at 100.2 s."""

    def now_ns(self) -> int:
        if 100 * S + 200 * MS <= self.ns < 101 * S:
            self.ns += S
        return self.ns


def test_after_a_stall_what_is_too_old_is_skipped_and_the_rest_is_in_time():
    done = publish(swing(RIG, 2.0), RIG, REPORT, free_address(), clock=StallingClock())
    assert done.skipped == 35  # due at 0.20 … 0.88 s, at 1.20 s: older than 0.3 s
    assert done.frames == 101 + 3 - 35
    assert done.worst_late_s == pytest.approx(1.0)
    assert (done.median_late_s, done.p99_late_s) == (0.0, pytest.approx(0.98))


def test_the_wire_rate_is_as_asked_and_keeps_the_motion():
    clock = FakeClock()
    done = publish(swing(RIG, 0.5), RIG, REPORT, free_address(), rate_hz=200, clock=clock)
    assert clock.slept == [100 * S + k * 5 * MS for k in range(101 + 3)]
    assert done.frames == 104
    for rate in (0.5, 1001, float("nan")):
        with pytest.raises(StreamError, match=r"rate .* 1…1000"):
            publish(swing(RIG, 0.5), RIG, REPORT, free_address(), rate_hz=rate, clock=clock)


@pytest.mark.parametrize("fps", [200.0, 60.0, 7.0])
def test_resampling_is_linear_between_frames_and_ends_at_the_last(fps):
    before = replace(swing(RIG, 0.5), contacts={"left": np.arange(26) < 13})
    after = resampled(before, fps)
    at = np.minimum(np.arange(len(after)) / fps, 0.5)
    assert at[-1] == 0.5
    assert len(after) == np.ceil(0.5 * fps) + 1
    angle = 0.2 + 0.2 * (1 - np.cos(2 * np.pi * at))
    np.testing.assert_allclose(after.qpos[:, 7], angle, atol=0.4 * np.pi**2 * 0.02**2 / 4 + 1e-9)  # h²/8 · max |f''|
    np.testing.assert_array_equal(after.contacts["left"], np.rint(at * 50) < 13)
    same = resampled(before, 50.0)
    np.testing.assert_array_equal(same.qpos, before.qpos)


def test_a_turn_is_resampled_the_short_way():
    before = swing(RIG, 1.0)
    yaw = np.arange(51) * 0.1  # 5.7° a frame, most of a turn
    qpos = before.qpos.copy()
    qpos[:, 3], qpos[:, 6] = np.cos(yaw / 2), np.sin(yaw / 2)
    qpos[::3, 3:7] *= -1
    after = resampled(replace(before, qpos=qpos), 175.0)
    found = np.unwrap(2 * np.arctan2(after.qpos[:, 6], after.qpos[:, 3]), period=4 * np.pi)
    np.testing.assert_allclose(found - found[0], np.minimum(np.arange(len(after)) / 175, 1) * 5, atol=1e-4)


def test_the_receiver_sees_the_newest_frame_only():
    address = free_address()
    hello = hello_for(swing(RIG), RIG, REPORT, 1)
    with Publisher(hello, address) as publisher, Receiver(address, rig_hash=RIG.hash) as receiver:
        assert publisher.wait_for_subscriber(5)
        assert receiver.poll(0) is None
        for seq in range(50):
            publisher.send(a_frame(seq, seq))
            time.sleep(0.001)
        time.sleep(0.2)
        assert receiver.poll(100).seq == 49
        assert receiver.poll(200) is None
        assert (receiver.gate.accepted, receiver.watchdog.mode) == (1, "following")


def test_hello_stop_and_state_travel_on_their_own_sockets():
    address = free_address()
    hello = hello_for(swing(RIG), RIG, REPORT, 1)
    clock = FakeClock()
    with Publisher(hello, address, clock=clock) as publisher:

        def tick(receiver):
            clock.ns += S
            publisher.tick()
            receiver.poll(0)

        with Receiver(address, rig_hash=RIG.hash) as receiver:
            until(lambda: tick(receiver) or receiver.hello)
            assert receiver.hello == hello
            state = RigState("small", RIG.hash, "following", "", 3, 4, (0.1, 0.2, 0.3))
            found = until(lambda: receiver.send_state(state) or publisher.states())
            assert found[0] == state
            publisher.stop("enough")
            until(lambda: receiver.poll(0) or receiver.watchdog.mode == "stopped")
        with Receiver(address, rig_hash=RIG.hash) as late:  # One that joins after the stop hears it all the same.
            until(lambda: tick(late) or late.watchdog.mode == "stopped")
            assert "enough" in late.watchdog.reason


def test_a_receiver_for_another_rig_follows_nothing_and_names_both():
    address = free_address()
    other = replace(RIG, name="other", joints=tuple(replace(j, upper=1.6) for j in RIG.joints))
    assert other.hash != RIG.hash
    with (
        Publisher(hello_for(swing(RIG), RIG, REPORT, 1), address) as publisher,
        Receiver(address, rig_hash=other.hash, rig=other.name, preview=True) as receiver,
    ):

        def refused():
            publisher.send(a_frame(receiver.gate.refused["rig"], time.monotonic_ns()))
            receiver.poll(time.monotonic_ns())
            return receiver.gate.refused["rig"] and receiver.hello

        until(refused)
        names = f"the rig 'small' ({RIG.hash:016x}); this one is 'other' ({other.hash:016x})"
        assert receiver.trouble == f"the stream is for {names}"
        assert (receiver.gate.accepted, receiver.watchdog.mode) == (0, "waiting")


def test_foreign_bytes_on_every_socket_are_counted_and_harmless():
    address = free_address()
    at = endpoints(address)
    context = zmq.Context()
    try:
        sockets = []
        for where in (at.frames, at.hello, at.stop):
            sockets.append(context.socket(zmq.PUB))
            sockets[-1].setsockopt(zmq.LINGER, 0)
            sockets[-1].bind(where)
        with Receiver(address, rig_hash=RIG.hash) as receiver:

            def all_refused():
                for socket in sockets:
                    socket.send(b"\x93NUMPY junk")
                receiver.poll(0)
                return receiver.gate.refused["damaged"] and receiver.gate.refused["message"] >= 2

            until(all_refused)
            assert (receiver.watchdog.mode, receiver.hello, receiver.gate.accepted) == ("waiting", None, 0)
    finally:
        context.destroy(0)
