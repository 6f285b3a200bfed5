"""A serial port that says in one line what is wrong with it, and waits for replies in the kernel."""

from __future__ import annotations

import contextlib
import errno
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import serial

from drivers.bus import BusError
from drivers.servos.family import Codec, Parser, Reply, Request

try:
    import termios

    PORT_ERRORS: tuple[type[Exception], ...] = (OSError, termios.error)  # pyserial lets both through
except ImportError:  # Windows
    PORT_ERRORS = (OSError,)

OPEN_ERRORS: tuple[type[Exception], ...] = (*PORT_ERRORS, ValueError)  # a rate that the port does not know
CHUNK = 4096
SLICE_S = 0.005  # one blocking read; the kernel waits, not the processor
LATENCY_S = 0.034  # a USB adapter's buffer keeps bytes back for 16 ms, each way
BITS_PER_BYTE = 10  # start, eight, stop
QUIET_S = 0.05  # After a request that failed, the line must be quiet for so long: a late answer has no mark of its own.
RETURN_DELAY_S = 0.51e-3  # before each reply, at most: 254 units of 2 µs


class Serial(Protocol):
    """What is used of an open port; `read` gives fewer bytes where no more came within its timeout."""

    def write(self, data: bytes) -> int | None: ...
    def read(self, size: int) -> bytes: ...
    def reset_input_buffer(self) -> None: ...
    def close(self) -> None: ...


class Wire(Protocol):
    """Where the bytes go: a serial port, or an emulated bus in this process with a clock of its own."""

    @property
    def path(self) -> str:
        """What errors call it."""
        ...

    def open(self, baud: int, timeout: float) -> Serial:
        """Open it; raises OSError or ValueError where that cannot be."""
        ...

    def now(self) -> float:
        """Seconds of a clock that only goes forward."""
        ...


@dataclass(frozen=True)
class SerialWire:
    """The serial port `path`, or the pyserial URL (`socket://host:port`) of one elsewhere.

    Where the system allows, the port's adapter passes each byte on at once.
    """

    path: str

    def open(self, baud: int, timeout: float) -> Serial:
        """Open it for this program alone."""
        port = serial.serial_for_url(self.path, baud, timeout=timeout, exclusive=True)
        with contextlib.suppress(*PORT_ERRORS, ValueError, AttributeError, NotImplementedError):
            port.set_low_latency_mode(True)  # Linux, and not on a pty
        return port

    def now(self) -> float:
        """Seconds of CLOCK_MONOTONIC."""
        return time.monotonic()


class Port:
    """The port `wire`, or the serial port of this path, at `baud`; a context manager.

    `patience_s`: how long an answer may take beyond its time on the wire. Every method raises BusError where the port
    fails.
    """

    def __init__(self, wire: str | Wire, baud: int, *, patience_s: float = LATENCY_S) -> None:
        self._wire: Wire = SerialWire(wire) if isinstance(wire, str) else wire
        self.path, self.baud, self.now = self._wire.path, baud, self._wire.now
        self._serial: Serial | None = None
        self._patience_s = patience_s
        self.asked_at = 0.0  # when the last request went out
        self.silence = 0.0  # s, the longest between two sends since somebody set it to 0
        self.garbled = False  # whether more came in answer to the last request than makes sense
        self._last_sent = 0.0
        self._failed: Request | None = None  # the last one, where answers to it may still come
        self._cut_short = False  # whether bytes of the last answer that is no packet may still come
        self._awaited: tuple[bytes, Request, float] | None = None

    def __enter__(self) -> Port:
        try:
            self._serial = self._wire.open(self.baud, SLICE_S)
        except OPEN_ERRORS as error:
            raise not_opened(self.path, self.baud, error) from None
        return self

    def __exit__(self, *_: object) -> None:
        if self._serial is not None:
            with contextlib.suppress(*PORT_ERRORS):
                self._serial.close()
            self._serial = None

    def send(self, data: bytes) -> None:
        """Write bytes that nobody answers."""
        with self._lost() as wire:
            self.note_silence()
            wire.write(data)

    def note_silence(self) -> float:
        """Something is about to be sent: the longest silence so far, in s."""
        now = self.now()
        self.silence, self._last_sent = max(self.silence, now - self._last_sent), now
        return self.silence

    def ask(self, codec: Codec, request: Request) -> dict[int, Reply]:
        """Send `request` and collect what answers it, by id; servos that are silent or garbled are missing."""
        self.start(request)
        return self.collect(codec)

    def start(self, request: Request, before: bytes = b"") -> None:
        """Send `request`, right after the bytes `before`; `collect` reads the answers."""
        sent = before + request.data
        with self._lost() as wire:
            self._drain(wire, request)
            self.note_silence()
            wire.write(sent)
        wire_s = (len(sent) + request.reply_bytes) * BITS_PER_BYTE / self.baud
        self.asked_at = self._last_sent
        self._awaited = (sent, request, self.asked_at + wire_s + len(request.ids) * RETURN_DELAY_S + self._patience_s)

    def collect(self, codec: Codec) -> dict[int, Reply]:
        """The answers to the request that was started last."""
        if self._awaited is None:
            raise BusError(f"{self.path}: nothing was asked")
        sent, request, deadline = self._awaited
        self._awaited = None
        parser, found, left = codec.parser(), {}, request.reply_bytes
        echo = _Echo(sent)
        heard = 0
        with self._lost() as wire:
            while True:
                data = wire.read(max(1, left))
                answer = echo.strip(data)
                heard += len(answer)
                for reply in _replies(codec, parser, request, answer):
                    found[reply.id] = reply
                left = max(left - len(data), 0) + echo.take_back()
                if len(found) == len(request.ids) or self.now() > deadline:
                    self.garbled = heard * len(request.ids) > len(found) * request.reply_bytes
                    if len(found) < len(request.ids):
                        self._failed = request
                    return found

    def _drain(self, wire: Serial, request: Request) -> None:
        """Forget what has come in; where answers to another question may still come, wait until none does."""
        wire.reset_input_buffer()
        failed = self._failed
        if failed is None or (failed.address, failed.size) == (request.address, request.size):
            return
        self._failed = None
        self._wait_until_quiet(wire)

    def _wait_until_quiet(self, wire: Serial) -> None:
        quiet_at = self.now() + QUIET_S
        while self.now() < quiet_at:
            if wire.read(CHUNK):
                quiet_at = self.now() + QUIET_S

    def read_bytes(self, request: bytes, size: int) -> bytes:
        """Send `request` and read `size` bytes that are no packet; fewer where no more came."""
        with self._lost() as wire:
            wire.reset_input_buffer()
            if self._cut_short:
                self._wait_until_quiet(wire)
            self.note_silence()
            wire.write(request)
            deadline = self._last_sent + (len(request) + size) * BITS_PER_BYTE / self.baud + self._patience_s
            data = b""
            while len(data) < size and self.now() < deadline:
                data += wire.read(size - len(data))
        self._cut_short = len(data) < size
        return data

    @contextlib.contextmanager
    def _lost(self) -> Iterator[Serial]:
        if self._serial is None:
            raise BusError(f"{self.path} is not open: use the bus as a context manager")
        try:
            yield self._serial
        except PORT_ERRORS as error:
            raise lost(self.path, error) from None


class _Echo:
    """Takes from a half-duplex line what the host hears of its own bytes: whether there is an echo shows itself."""

    def __init__(self, sent: bytes) -> None:
        self._sent = sent
        self._held = b""
        self._open = True
        self._stripped = 0

    def strip(self, data: bytes) -> bytes:
        """`data` less the echo; bytes that may still turn out to be one are held."""
        if not self._open:
            return data
        self._held += data
        if len(self._held) < len(self._sent) and self._sent.startswith(self._held):
            return b""
        self._open = False
        held, self._held = self._held, b""
        if held.startswith(self._sent):
            self._stripped = len(self._sent)
            return held[len(self._sent) :]
        return held

    def take_back(self) -> int:
        """How many bytes more are to come than was thought, once."""
        more, self._stripped = self._stripped, 0
        return more


def not_opened(path: str, baud: int, error: BaseException) -> BusError:
    """What to raise where the port at `path` cannot be opened at `baud`."""
    if isinstance(error, ValueError):
        return BusError(f"{path}: {baud} baud is no rate of this port")
    return BusError(f"cannot open serial port {path!r}: {why_not_opened(path, error)}")


def lost(path: str, error: BaseException) -> BusError:
    """What to raise where the open port at `path` fails."""
    return BusError(f"serial port {path!r} is lost: {_text(error)}")


def why_not_opened(path: str, error: BaseException) -> str:
    """The cause in words, and what helps: the ports that are there, the group to join, who has it open."""
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        from serial.tools.list_ports import comports

        there = ", ".join(sorted(p.device for p in comports())) or "none"
        return f"No such file or directory; serial ports here: {there}"
    if number == errno.EACCES:
        return f"no permission: {_group(path)}"
    if number in (errno.EAGAIN, errno.EBUSY) or "exclusively lock" in str(error):
        return "another program has it open"
    return _text(error)


def _group(path: str) -> str:
    try:
        import grp

        name = grp.getgrgid(Path(path).stat().st_gid).gr_name
    except (ImportError, KeyError, OSError):
        return "you may not open it"
    return f"it belongs to group {name!r}; sudo usermod -aG {name} $USER, then log in again"


def _replies(codec: Codec, parser: Parser, request: Request, data: bytes) -> Iterator[Reply]:
    for packet in parser.feed(data):
        for reply in codec.replies(packet, request):
            if reply.id in request.ids and len(reply.data) == request.size:
                yield reply


def _text(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    return os.strerror(number) if number else " ".join(str(a) for a in error.args)
