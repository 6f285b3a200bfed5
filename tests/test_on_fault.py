"""When one servo fails: all let go, or, where the rig says so, the others go to the safe pose first."""

from dataclasses import replace

import pytest
from families import FAMILIES, rig_of
from test_faults import SETTINGS, Stream

from drivers.bus import BusError
from drivers.drive import drive
from drivers.emulation.in_process import InProcess
from drivers.servos.connect import connect
from retarget.rig import load_rig

PACKETS = [k for k in FAMILIES if k not in ("maestro", "ssc32")]
SAFE = [0.1, 0.0, 0.0]


def play(kind, on_fault, *faults):
    """Swing joint a, and at 0.7 s and every 0.1 s from then on one of `faults` happens; error, wire, states."""
    rig = replace(rig_of(kind), on_fault=on_fault)
    wire, stream, left = InProcess(rig), Stream(rig), list(faults)

    def watch(state):
        if left and wire.now() >= 0.7 + 0.1 * (len(faults) - len(left)):
            left.pop(0)(wire)

    with pytest.raises(BusError) as caught:
        drive(rig, stream, connect(rig, wire), SETTINGS, clock=wire, watch=watch)
    return str(caught.value), wire, stream.states


def overload(wire):
    wire.servo("b").fail("overload")


def offs(wire, ident):
    return [e.time for e in wire.events("torque_enable") if e.id == ident and e.value == 0 and e.time > 0.69]


@pytest.mark.parametrize("kind", PACKETS)
def test_the_others_go_to_the_safe_pose_and_then_let_go(kind):
    error, wire, states = play(kind, "rest", overload)
    assert "servo 7 (b)" in error
    assert {s.mode for s in states if s.time_ns > 0.9e9} == {"tripped"}
    assert all("servo 7 (b)" in s.reason for s in states if s.mode == "tripped")
    assert states[-1].position[0] == pytest.approx(SAFE[0], abs=0.03)
    assert states[-1].position[2] == pytest.approx(SAFE[2], abs=0.03)
    assert min(offs(wire, 7)) < 1.1  # at once
    assert min(offs(wire, 3)) > min(offs(wire, 7)) + 0.1  # once there
    assert not any(wire.torque().values())


@pytest.mark.parametrize("kind", PACKETS)
def test_by_default_all_let_go_at_once(kind):
    error, wire, states = play(kind, "limp", overload)
    assert "servo 7 (b)" in error
    assert states[-1].position[0] > 0.2
    assert not any(wire.torque().values())


def test_a_servo_that_is_gone_is_done_without_too():
    error, wire, states = play("feetech", "rest", lambda wire: wire.remove("b"))
    assert error.startswith("torque off is not confirmed, cut the power: no answer on in process from servo 7 (b)")
    assert states[-1].position[0] == pytest.approx(SAFE[0], abs=0.03)
    assert wire.torque() == {"a": False, "c": False}


@pytest.mark.parametrize("kind", PACKETS)
def test_a_second_fault_ends_it_at_once(kind):
    error, wire, states = play(kind, "rest", overload, lambda wire: wire.servo("c").fail("overload"))
    assert "servo 1 (c)" in error
    assert states[-1].time_ns < 1.4e9
    assert not any(wire.torque().values())


def test_a_lost_port_is_no_fault_of_one_servo():
    error, _, states = play("dynamixel2", "rest", lambda wire: wire.unplug())
    assert "cut the power: serial port" in error
    assert states[-1].time_ns < 0.9e9


def test_the_rig_says_which(tmp_path):
    text = (load_rig("puppet").folder / "rig.toml").read_text()
    assert load_rig("puppet").on_fault == "limp"
    for word in ("rest", "home"):
        (tmp_path / word).mkdir()
        (tmp_path / word / "rig.toml").write_text(f'on_fault = "{word}"\n{text}')
    assert load_rig(tmp_path / "rest").on_fault == "rest"
    with pytest.raises(ValueError, match="on_fault = 'home' should be one of limp, rest"):
        load_rig(tmp_path / "home")
