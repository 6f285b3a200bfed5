"""What a make of servo is to the driver and to the emulator: registers, models, and a codec of bytes.

A family is one file that fills these in. The driver (`packet_bus.py`) and the emulator (`drivers/emulation/`) know
servos only through them.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple, Protocol

BROADCAST = 0xFE
MAX_ID = 0xFC
CODES = {1: "B", 2: "H", 4: "I"}  # of `struct`, by size


@dataclass(frozen=True)
class Register:
    """`size` bytes at `address`; `low` … `high` may be written, where `low` is None nothing may.

    `signed` is two's complement; `sign_bit` is the bit that makes a number negative where it is sign and magnitude.
    """

    name: str
    address: int
    size: int
    default: int = 0
    low: int | None = None
    high: int = 0
    signed: bool = False
    sign_bit: int | None = None
    order: Literal["little", "big"] = "little"

    def decode(self, raw: bytes) -> int:
        """The number in `raw`."""
        return self.signed_magnitude(int.from_bytes(raw[: self.size], self.order, signed=self.signed))

    def signed_magnitude(self, value: int) -> int:
        """`value`, negative where its sign bit, if there is one, is set."""
        if self.sign_bit is not None and value >> self.sign_bit & 1:
            return -(value & (1 << self.sign_bit) - 1)
        return value

    def encode(self, value: int) -> bytes:
        """`value` as the servo stores it; raises OverflowError where it does not fit."""
        if self.sign_bit is not None and value < 0:
            value = -value | 1 << self.sign_bit
        return value.to_bytes(self.size, self.order, signed=self.signed)


@dataclass(frozen=True)
class Block:
    """Registers that are read together: `size` bytes from `address`, and where in them each one lies."""

    address: int
    size: int
    offsets: tuple[tuple[Register, int], ...]

    @cached_property
    def _layout(self) -> struct.Struct:
        """All of it in one go: a cycle decodes hundreds of numbers."""
        text, end = "<" if self.offsets[0][0].order == "little" else ">", 0
        for register, at in sorted(self.offsets, key=lambda pair: pair[1]):
            code = CODES[register.size]
            text += "x" * (at - end) + (code.lower() if register.signed else code)
            end = at + register.size
        return struct.Struct(text)

    @cached_property
    def _names(self) -> tuple[list[str], list[Register]]:
        registers = [r for r, _ in sorted(self.offsets, key=lambda pair: pair[1])]
        return [r.name for r in registers], [r for r in registers if r.sign_bit is not None]

    def decode(self, data: bytes) -> dict[str, int]:
        """Values by name."""
        names, with_sign = self._names
        values = dict(zip(names, self._layout.unpack_from(data), strict=True))
        for register in with_sign:
            values[register.name] = register.signed_magnitude(values[register.name])
        return values


@dataclass(frozen=True)
class Model:
    """One servo of a family. `number`: what its model register says, None where it has none.

    `state`: registers that every cycle needs, next to each other. `slow`: groups of registers, each read of one servo
    a cycle, in turn. `guard`: registers that must keep what the driver wrote; a servo that lost them has rebooted.
    `setup`: values that are written before the torque comes on. `speed`, `current`: a register and its unit, rad/s and
    A. `errors`: names of the error bits. `full_error` rad: position error at which the motor gets full power.
    `indirect`: first address and first data register of indirect addressing. `enables`: a goal switches torque on.
    `torque`: the register that limits the torque, and the one that says how far it may go.
    """

    number: int | None
    registers: tuple[Register, ...]
    eeprom: range
    state: tuple[str, ...]
    voltage_unit: float
    full_error: float
    errors: Mapping[int, str]
    current: tuple[str, float] | None = None
    speed: tuple[str, float] | None = None
    slow: tuple[tuple[str, ...], ...] = ()
    guard: tuple[str, ...] = ("torque_enable",)
    setup: Mapping[str, int] = field(default_factory=dict)
    error_register: str | None = None
    indirect: tuple[int, int] | None = None
    group_read: bool = True
    enables: bool = False
    torque: tuple[str, str] | None = None

    @cached_property
    def by_name(self) -> dict[str, Register]:
        """The registers by name."""
        return {r.name: r for r in self.registers}

    def block(self, names: Sequence[str]) -> Block:
        """The block from the first to the last of the registers `names`."""
        registers = [self.by_name[n] for n in names]
        start = min(r.address for r in registers)
        end = max(r.address + r.size for r in registers)
        return Block(start, end - start, tuple((r, r.address - start) for r in registers))


@dataclass(frozen=True)
class Packet:
    """One packet: `code` is its instruction or, where the protocol has no instruction in replies, its error byte."""

    id: int
    code: int
    params: bytes


class Reply(NamedTuple):
    """What servo `id` answered. A tuple, since a cycle makes one for each servo."""

    id: int
    error: int
    data: bytes


@dataclass(frozen=True)
class Request:
    """`data` to send, `ids` that each answer `size` bytes of data, in `reply_bytes` on the wire altogether.

    `address`: what is asked for, None for whether somebody is there.
    """

    data: bytes
    ids: tuple[int, ...]
    size: int
    reply_bytes: int
    address: int | None = None


class Parser(Protocol):
    """Finds packets in a byte stream, whatever pieces it comes in; `damaged` counts those with a wrong sum."""

    damaged: int

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that `data` completes."""
        ...


class Codec(Protocol):
    """Bytes of one protocol. Pure: nothing here knows a port."""

    def parser(self) -> Parser:
        """A new parser."""
        ...

    def ping(self, ident: int) -> Request:
        """Ask servo `ident` whether it is there."""
        ...

    def read(self, idents: Sequence[int], address: int, size: int, *, group: bool, fast: bool) -> list[Request]:
        """Ask servos for `size` bytes from `address`: one request where the servo knows group reads, else one each."""
        ...

    def write(self, address: int, rows: Sequence[tuple[int, bytes]]) -> bytes:
        """Write (id, data) rows from `address` on; no servo answers."""
        ...

    def replies(self, packet: Packet, request: Request) -> list[Reply]:
        """The answers to `request` in `packet`; none where it is something else."""
        ...


@dataclass(frozen=True)
class Family:
    """A make of servo. `bauds`: rates and their codes in the register `baud_rate`; `alerts`: error bits that tell of
    the servo's own health rather than of the packet. `watchdog_s`: unit and highest value of the servos' bus watchdog,
    None where they have none.
    """

    name: str
    codec: Codec
    models: Mapping[str, Model]
    bauds: Mapping[int, int]
    alerts: int
    watchdog_s: tuple[float, int] | None = None

    def model_name(self, number: int) -> str:
        """The model whose register says `number`."""
        return next((name for name, m in self.models.items() if m.number == number), f"unknown ({number})")
