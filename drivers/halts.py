"""Ways to stop a drive at once: a key on the terminal, a button on a control line of a serial port.

Each is asked in every cycle and answers why to stop, "" while there is no reason. A way that fails is a reason.
"""

from __future__ import annotations

import contextlib
import os
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
    with _typed() as (ready, _):
        yield lambda: "a key was pressed" if ready() else ""


@contextlib.contextmanager
def yes_or_no() -> Iterator[Callable[[], bool | None]]:
    """Asked for the answer on stdin: True or False once y or n was typed, None until then; never waits.

    Asking raises ValueError where the input has ended.
    """
    with _typed() as (ready, read):

        def answer() -> bool | None:
            while ready():
                key = read()
                if not key:
                    raise ValueError("an answer, y or n, is awaited, and the input has ended")
                if key in "yYnN":
                    return key in "yY"
            return None

        yield answer


@contextlib.contextmanager
def _typed() -> Iterator[tuple[Callable[[], bool], Callable[[], str]]]:
    """Whether something was typed, and what it is, key by key, "" at the end of the input."""
    try:
        import termios
        import tty
    except ImportError:  # Windows
        import msvcrt

        yield msvcrt.kbhit, msvcrt.getwch  # type: ignore[attr-defined]
        return
    source = sys.stdin.fileno()
    before = termios.tcgetattr(source) if sys.stdin.isatty() else None
    if before is not None:
        tty.setcbreak(source)  # keys come one by one; Ctrl-C still is a signal
    try:
        yield lambda: bool(select.select([source], [], [], 0)[0]), lambda: os.read(source, 1).decode("ascii", "replace")
    finally:
        if before is not None:
            termios.tcflush(source, termios.TCIFLUSH)  # the keys were meant for us, not for the shell
            termios.tcsetattr(source, termios.TCSADRAIN, before)


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
