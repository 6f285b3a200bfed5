"""A key, a button, a broken wire: each ends a drive in the next cycle, limp."""

import os
import pty
import sys
from types import SimpleNamespace

import pytest
from families import rig_of
from test_faults import Stream

from drivers.bus import BusError
from drivers.drive import drive
from drivers.emulation.in_process import InProcess
from drivers.halts import any_key, button, watch_line, yes_or_no
from drivers.servos.connect import connect


def drive_until(halts, at_s, act):
    """Drive the swing; `act` happens at `at_s` on the emulated clock."""
    rig = rig_of("feetech")
    wire, stream, acted = InProcess(rig), Stream(rig), []

    def watch(state):
        if not acted and wire.now() >= at_s:
            acted.append(wire.now())
            act()

    done = drive(rig, stream, connect(rig, wire), clock=wire, watch=watch, halts=halts)
    offs = [e.time for e in wire.events("torque_enable") if e.value == 0 and e.time >= acted[0]]
    return done, min(offs) - acted[0], wire


@pytest.fixture
def terminal(monkeypatch):
    """A terminal as stdin; the end where somebody types."""
    keys, stdin = pty.openpty()
    with os.fdopen(stdin) as file:
        monkeypatch.setattr(sys, "stdin", file)
        yield keys
    os.close(keys)


def test_any_key_stops(terminal):
    with any_key() as halt:
        assert halt() == ""
        done, took, wire = drive_until([halt], 0.7, lambda: os.write(terminal, b" "))
    assert (done.mode, done.reason) == ("stopped", "a key was pressed")
    assert took < 0.05
    assert not any(wire.torque().values())


def test_the_terminal_is_as_it_was(terminal):
    import termios

    before = termios.tcgetattr(sys.stdin)
    with any_key():
        assert termios.tcgetattr(sys.stdin) != before
    assert termios.tcgetattr(sys.stdin) == before


def test_without_a_terminal_no_key_can(monkeypatch):
    with open(os.devnull) as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        with any_key() as halt:
            assert halt() == ""


def test_yes_or_no_is_one_key_and_nobody_waits_for_it(terminal):
    with yes_or_no() as answer:
        assert answer() is None
        os.write(terminal, b"?\nN")
        assert answer() is False
        os.write(terminal, b"y")
        assert answer() is True
        assert answer() is None


def test_yes_or_no_of_an_input_that_has_ended(monkeypatch):
    with open(os.devnull) as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        with yes_or_no() as answer, pytest.raises(ValueError, match="y or n, is awaited, and the input has ended"):
            answer()


def test_a_button_stops():
    port = SimpleNamespace(cts=True, dsr=True)
    done, took, wire = drive_until(
        [watch_line(port, "cts", "/dev/ttyUSB1:cts")], 0.7, lambda: setattr(port, "cts", False)
    )
    assert (done.mode, done.reason) == ("stopped", "the button at /dev/ttyUSB1:cts is pressed, or its wire is broken")
    assert took < 0.05
    assert not any(wire.torque().values())


def test_a_button_that_cannot_be_read_stops():
    class Gone:
        @property
        def dsr(self):
            raise OSError(5, "Input/output error")

    assert "cannot be read: [Errno 5]" in watch_line(Gone(), "dsr", "x:dsr")()


@pytest.mark.parametrize(
    ("place", "says"),
    [
        ("/dev/ttyUSB1", "give port:line, such as /dev/ttyUSB1:cts; lines are cts, dsr"),
        ("/dev/none:dtr", "lines are cts, dsr"),
        ("/dev/none:cts", "cannot open serial port '/dev/none': No such file"),
    ],
)
def test_a_wrong_place_of_a_button_is_one_line(place, says):
    with pytest.raises(BusError, match=says), button(place):
        pass


def test_a_line_that_is_low_from_the_start_is_told(monkeypatch):
    port = SimpleNamespace(cts=False, close=lambda: None)
    monkeypatch.setattr("drivers.halts.serial.serial_for_url", lambda path, exclusive: port)
    with pytest.raises(BusError, match="is pressed, or its wire is broken"), button("/dev/ttyUSB1:cts"):
        pass
