"""Boards that make pulses for hobby servos: bytes of the Pololu Maestro and the Lynxmotion SSC-32U. Pure.

Pulses are in µs, a pulse of 0 is none: the servo goes limp (an analogue one does; some digital ones hold on).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol


class Board(Protocol):
    """What a PWM board is told and asked. `bauds`: rates that it runs at; `channels`: how many it may have."""

    name: str
    bauds: tuple[int, ...]
    channels: int
    tells_off: bool  # whether `question` shows that a pulse has ended

    def limit(self, speeds: Mapping[int, int]) -> bytes:
        """Hold channels to µs/s from now on; nothing where `pulses` says it each time."""
        ...

    def pulses(self, widths: Mapping[int, int], speeds: Mapping[int, int]) -> bytes:
        """Set the pulses of channels, in µs, at most at `speeds` µs/s."""
        ...

    def question(self, channels: tuple[int, ...]) -> tuple[bytes, int]:
        """Ask what pulses the channels have now: the bytes to send, and how many bytes answer."""
        ...

    def answer(self, data: bytes) -> list[int] | None:
        """The pulses in the answer, µs; None where it is none."""
        ...

    def trouble(self) -> tuple[bytes, int]:
        """Ask for the board's error flags: the bytes to send, and how many bytes answer; none where it has none."""
        ...

    def errors(self, data: bytes) -> list[str]:
        """The names of the errors in the answer."""
        ...


class Maestro:
    """Pololu Maestro; compact protocol, or the Pololu protocol with a `device` number, with or without a CRC.

    Source: Pololu Maestro Servo Controller User's Guide, 5.c–5.e, https://www.pololu.com/docs/0J40/5
    """

    name = "maestro"
    bauds: tuple[int, ...] = (9600, 19200, 38400, 57600, 115200)  # on USB any will do
    channels = 24
    tells_off = True
    ERRORS = (
        "serial signal",
        "serial overrun",
        "serial buffer full",
        "serial CRC",
        "serial protocol",
        "serial timeout",
        "script stack",
        "script call stack",
        "script program counter",
    )

    def __init__(self, device: int | None = None, *, crc: bool = False) -> None:
        self._device, self._crc = device, crc

    def command(self, code: int, data: bytes = b"") -> bytes:
        """A command with its data; `code` has its highest bit set."""
        packet = bytes([code]) + data if self._device is None else bytes([0xAA, self._device, code & 0x7F]) + data
        return packet + bytes([crc7(packet)]) if self._crc else packet

    def limit(self, speeds: Mapping[int, int]) -> bytes:
        """One Set Speed (0x87) a channel, in quarter µs every 10 ms, rounded up."""
        units = {c: -(-speed * 4 // 100) for c, speed in speeds.items()}
        return b"".join(self.command(0x87, bytes([c, u & 0x7F, u >> 7 & 0x7F])) for c, u in units.items())

    def pulses(self, widths: Mapping[int, int], speeds: Mapping[int, int]) -> bytes:
        """One Set Target (0x84) a channel, in quarter µs, seven bits a byte."""
        out = b""
        for channel, us in widths.items():
            out += self.command(0x84, bytes([channel, us * 4 & 0x7F, us * 4 >> 7 & 0x7F]))
        return out

    def question(self, channels: tuple[int, ...]) -> tuple[bytes, int]:
        """One Get Position (0x90) a channel."""
        return b"".join(self.command(0x90, bytes([c])) for c in channels), 2 * len(channels)

    def answer(self, data: bytes) -> list[int] | None:
        """Two bytes a channel, quarter µs, low byte first."""
        return [int.from_bytes(data[at : at + 2], "little") // 4 for at in range(0, len(data), 2)]

    def trouble(self) -> tuple[bytes, int]:
        """Get Errors (0xA1), which also clears them."""
        return self.command(0xA1), 2

    def errors(self, data: bytes) -> list[str]:
        """One bit each."""
        bits = int.from_bytes(data, "little")
        return [name for bit, name in enumerate(self.ERRORS) if bits >> bit & 1]


class Ssc32:
    """Lynxmotion SSC-32U: a line of text, ended by a carriage return, moves all its channels at once.

    Source: Lynxmotion SSC-32U User Guide, "Command Group", "Discrete Output", "Query Pulse Width".
    """

    name = "ssc32"
    bauds: tuple[int, ...] = (9600, 38400, 115200)
    channels = 32
    tells_off = False

    def limit(self, speeds: Mapping[int, int]) -> bytes:
        """Nothing: each move carries its speeds."""
        return b""

    def pulses(self, widths: Mapping[int, int], speeds: Mapping[int, int]) -> bytes:
        """A group move; a channel without a pulse is made a low output, which ends its pulses."""
        moves = "".join(f"#{c}P{us}S{speeds[c]}" for c, us in widths.items() if us)
        lows = "".join(f"#{c}L" for c, us in widths.items() if not us)
        return "".join(f"{group}\r" for group in (moves, lows) if group).encode()  # Groups of two kinds cannot mix.

    def question(self, channels: tuple[int, ...]) -> tuple[bytes, int]:
        """One QP line a channel."""
        return "".join(f"QP{c}\r" for c in channels).encode(), len(channels)

    def answer(self, data: bytes) -> list[int] | None:
        """One byte a channel, 10 µs."""
        return [10 * byte for byte in data]

    def trouble(self) -> tuple[bytes, int]:
        """There is no such question."""
        return b"", 0

    def errors(self, data: bytes) -> list[str]:
        """None."""
        return []


def crc7(data: bytes) -> int:
    """Pololu's CRC-7, polynomial 0x91 with the lowest bit first; User's Guide 5.d."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc ^ 0x91 if crc & 1 else crc) >> 1
    return crc
