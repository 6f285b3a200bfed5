"""Ways to stop a drive at once: a key on the terminal, a button on a control line of a serial port.

Each is asked in every cycle and answers why to stop, "" while there is no reason. A way that fails is a reason.
"""

from __future__ import annotations

import contextlib
import select
import sys
from collections.abc import Callable, Iterator
from typing import Protocol

import serial

from drivers.bus import BusError
from drivers.servos.port import OPEN_ERRORS, PORT_ERRORS, not_opened

Halt = Callable[[], str]
LINES = ("cts", "dsr", "cd", "ri")


@contextlib.contextmanager
def any_key() -> Iterator[Halt]:
    """Any key on the terminal stops; where stdin is no terminal none can. Put back as it was in the end."""
    if not sys.stdin.isatty():
        yield lambda: ""
        return
    try:
        import termios
        import tty
    except ImportError:  # Windows
        import msvcrt

        yield lambda: "a key was pressed" if msvcrt.kbhit() else ""  # type: ignore[attr-defined]
        return
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)  # keys come one by one; Ctrl-C still is a signal

    def pressed() -> str:
        return "a key was pressed" if select.select([terminal], [], [], 0)[0] else ""

    try:
        yield pressed
    finally:
        termios.tcflush(terminal, termios.TCIFLUSH)  # the keys were meant for us, not for the shell
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


class ControlLines(Protocol):
    """What is used of an open serial port."""

    cts: bool
    dsr: bool
    cd: bool
    ri: bool


@contextlib.contextmanager
def button(place: str) -> Iterator[Halt]:
    """The button at `place`, such as `/dev/ttyUSB1:cts`: it opens when pressed, between DTR or RTS and that line.

    The line is high while all is well, so that a broken wire stops the rig like a pressed button does. Raises BusError
    where the port does not open or the line is low from the start.
    """
    path, _, line = place.rpartition(":")
    if not path or line not in LINES:
        raise BusError(f"button {place!r}; give port:line, such as /dev/ttyUSB1:cts; lines are {', '.join(LINES)}")
    try:
        port = serial.serial_for_url(path, exclusive=True)
    except OPEN_ERRORS as error:
        raise not_opened(path, 9600, error) from None
    with contextlib.closing(port):
        halt = watch_line(port, line, place)
        if why := halt():
            raise BusError(why)
        yield halt


def watch_line(port: ControlLines, line: str, place: str) -> Halt:
    """Asks `line` of an open `port`; `place` is what messages call it."""

    def asked() -> str:
        try:
            return "" if getattr(port, line) else f"the button at {place} is pressed, or its wire is broken"
        except PORT_ERRORS as error:
            return f"the button at {place} cannot be read: {error}"

    return asked
