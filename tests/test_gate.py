"""Which frames a rig may follow, and what it does as they stay away: no sockets, and times that are made up."""

import numpy as np
import pytest
from test_stream import MS, RIG, S, a_frame

from drivers.frame import UNCHECKED, Clock, State, encode
from drivers.gate import Gate
from drivers.watchdog import Patience, Watchdog

# --- what the gate lets through


def test_the_gate_refuses_by_reason():
    gate = Gate(RIG.hash)
    assert gate.check(encode(a_frame(5, 0)), 0) is not None
    refused = {
        "damaged": b"nonsense",
        "rig": encode(a_frame(6, rig_hash=RIG.hash ^ 1)),
        "unchecked": encode(a_frame(6, report_id=UNCHECKED)),
        "torque": encode(a_frame(6, torque=np.ones(3))),
        "order": encode(a_frame(5)),
        "stream": encode(a_frame(0, stream=2)),
        "early": encode(a_frame(6, 0, due_ns=3 * S)),
    }
    for reason, data in refused.items():
        assert gate.check(data, 10 * MS) is None, reason
        assert gate.refused[reason] == 1, gate.last_error
    assert sum(gate.refused.values()) == len(refused)
    assert gate.accepted == 1


def test_a_preview_takes_unchecked_frames():
    gate = Gate(RIG.hash, preview=True)
    assert gate.check(encode(a_frame(report_id=UNCHECKED, torque=np.ones(3))), 0) is not None


def test_gaps_are_counted():
    gate = Gate(RIG.hash)
    for seq in (0, 1, 4):
        gate.check(encode(a_frame(seq, seq * 20 * MS)), seq * 20 * MS)
    assert (gate.accepted, gate.gaps) == (3, 2)


@pytest.mark.parametrize("offset", [0, 7 * S, -7 * S])
def test_a_late_frame_is_stale_however_the_clocks_differ(offset):
    gate, sent = Gate(RIG.hash), 50 * S
    assert gate.check(encode(a_frame(0, sent)), sent + offset + 2 * MS) is not None
    assert abs(gate.sender_ns(sent + offset + 2 * MS) - sent) <= 2 * MS
    assert gate.check(encode(a_frame(1, sent + 20 * MS)), sent + offset + 320 * MS) is not None
    assert gate.check(encode(a_frame(2, sent + 40 * MS)), sent + offset + 345 * MS) is None
    assert gate.refused == {"stale": 1}


def test_a_frame_whose_time_is_past_is_stale():
    gate = Gate(RIG.hash)
    gate.check(encode(a_frame(0, S)), S)
    assert gate.check(encode(a_frame(1, 2 * S, due_ns=S)), 2 * S) is None
    assert gate.refused == {"stale": 1}


@pytest.mark.parametrize("step_s", [-3600, -10, 10, 3600])
def test_a_sender_whose_clock_steps_is_never_followed_back_in_time(step_s):
    gate, accepted = Gate(RIG.hash), []
    for k in range(200):  # the clock steps after 2 s, as UTC may
        sent = 5000 * S + k * 20 * MS + (step_s * S if k >= 100 else 0)
        accepted.append(gate.check(encode(a_frame(k, sent, clock=Clock.UTC)), 100 * S + k * 20 * MS) is not None)
    assert all(accepted[:100])
    assert all(accepted[100:]) if step_s > 0 else not any(accepted[100:])  # the rig holds, goes safe, and relaxes
    assert set(gate.refused) <= {"stale"}


def test_slow_drift_of_the_clocks_is_followed():
    gate = Gate(RIG.hash)
    for k in range(0, 3 * 3600, 10):  # three hours, our clock fast by 100 parts in a million: 1.08 s in all
        assert gate.check(encode(a_frame(k, k * S)), k * S + k * S // 10_000) is not None
    assert gate.refused == {}


def test_a_new_stream_takes_over_after_silence():
    gate = Gate(RIG.hash)
    gate.check(encode(a_frame(100, S)), S)
    assert gate.check(encode(a_frame(0, S, stream=2)), S + 200 * MS) is None
    assert gate.check(encode(a_frame(1, S, stream=2)), S + 301 * MS) is not None
    assert gate.refused == {"stream": 1}


# --- the watchdog, on an injected clock


def test_silence_holds_then_goes_safe_and_latches():
    dog = Watchdog(Patience(0.3, 2.0))
    assert dog.update(10 * S) == "waiting"
    dog.fresh(State.PLAY, 10 * S)
    assert dog.update(10 * S + 300 * MS) == "following"
    assert dog.update(10 * S + 301 * MS) == "hold"
    assert "no fresh frame for 0.3 s" in dog.reason
    dog.fresh(State.PLAY, 11 * S)
    assert dog.update(11 * S) == "following"
    assert dog.update(13 * S) == "hold"
    assert dog.update(13 * S + MS) == "safe"
    dog.fresh(State.PLAY, 14 * S)
    assert dog.update(14 * S) == "safe"
    dog.rearm()
    dog.fresh(State.PLAY, 15 * S)
    assert dog.update(15 * S) == "following"


def test_a_stop_latches_from_anywhere():
    for state in (None, State.PLAY, State.HOLD, State.SAFE):
        dog = Watchdog()
        if state is not None:
            dog.fresh(State.PLAY, 0)
            dog.fresh(state, 0)
        dog.stop("hand in the way")
        dog.fresh(State.PLAY, MS)
        assert dog.update(MS) == "stopped"
        assert "hand in the way" in dog.reason


def test_the_sender_may_ask_to_hold_to_end_or_to_go_safe():
    dog = Watchdog()
    dog.fresh(State.HOLD, 0)
    assert dog.update(0) == "waiting"
    dog.fresh(State.PLAY, 0)
    for k in range(50):
        dog.fresh(State.HOLD, k * 100 * MS)
        assert dog.update(k * 100 * MS) == "hold"
    dog.fresh(State.PLAY, 5 * S)
    dog.fresh(State.IDLE, 5 * S)
    assert (dog.update(7 * S), dog.reason) == ("hold", "the stream ended")
    assert dog.update(7 * S + MS) == "safe"
    dog.rearm()
    dog.fresh(State.PLAY, 8 * S)
    dog.fresh(State.SAFE, 8 * S)
    assert dog.update(8 * S) == "safe"
