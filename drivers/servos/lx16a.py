"""LewanSoul LX-16A: one command a register, no group reads or writes, no error reports, 115200 baud.

Source: LewanSoul (Hiwonder) "Bus Servo Communication Protocol". A register's address is the command that writes it,
the next command reads it; what is read-only has its reading command.
"""

from __future__ import annotations

from collections.abc import Sequence

from drivers.servos.family import Family, Model, Packet, Register, Reply, Request
from drivers.servos.summed import Frame, SummedParser

FRAME = Frame(b"\x55\x55", 3)
OVERHEAD = 6  # bytes of a frame without parameters
READ_ONLY = (26, 27, 28)

# The goal is a position and the milliseconds to get there: 0 is as fast as it can.
REGISTERS = (
    Register("goal_position", 1, 4, 0, 0, 1000 | 30000 << 16),
    Register("id", 13, 1, 1, 0, 253),
    Register("angle_offset", 18, 1, 0, -125, 125, signed=True),
    Register("angle_limits", 20, 4, 1000 << 16, 0, 2**32 - 1),
    Register("voltage_limits", 22, 4, 4500 | 14000 << 16, 0, 2**32 - 1),
    Register("temperature_limit", 24, 1, 85, 50, 100),
    Register("present_temperature", 26, 1, 30),
    Register("present_input_voltage", 27, 2, 7400),
    Register("present_position", 28, 2, signed=True),
    Register("operating_mode", 29, 4, 0, 0, 2**32 - 1),
    Register("torque_enable", 31, 1, 0, 0, 1),
    Register("led", 33, 1, 0, 0, 1),
    Register("led_errors", 35, 1, 7, 0, 7),
)


class Lx16a:
    """The `Codec` of the LX-16A."""

    def parser(self) -> SummedParser:
        """A new parser."""
        return SummedParser(FRAME)

    def ping(self, ident: int) -> Request:
        """Ask servo `ident` for its id."""
        return Request(FRAME.build(ident, 14), (ident,), 1, OVERHEAD + 1)

    def read(self, idents: Sequence[int], address: int, size: int, *, group: bool, fast: bool) -> list[Request]:
        """One request for each servo."""
        command = address if address in READ_ONLY else address + 1
        return [Request(FRAME.build(i, command), (i,), size, OVERHEAD + size, address) for i in idents]

    def write(self, address: int, rows: Sequence[tuple[int, bytes]]) -> bytes:
        """One frame for each servo, one after the other."""
        return b"".join(FRAME.build(i, address, data) for i, data in rows)

    def replies(self, packet: Packet, request: Request) -> list[Reply]:
        """Of a frame with the command that was asked."""
        return [Reply(packet.id, 0, packet.params)] if packet.code == request.data[4] and packet.params else []


LX16A = Family(
    name="lx16a",
    codec=Lx16a(),
    models={
        "LX-16A": Model(
            number=None,
            registers=REGISTERS,
            eeprom=range(13, 31),
            state=("present_position",),
            voltage_unit=1e-3,
            full_error=0.1,  # rad, an estimate
            errors={},
            slow=(("present_temperature",), ("present_input_voltage",), ("torque_enable",)),
            setup={"operating_mode": 0},
            group_read=False,
            enables=True,
        )
    },
    bauds={115_200: 0},
    alerts=0,
)
