"""Dynamixel protocol 1.0 and the servos that speak it: AX-12A, MX-28.

Sources: ROBOTIS e-Manual, "DYNAMIXEL Protocol 1.0", https://emanual.robotis.com/docs/en/dxl/protocol1/, and the control
tables of https://emanual.robotis.com/docs/en/dxl/ax/ax-12a/ and https://emanual.robotis.com/docs/en/dxl/mx/mx-28/.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

from drivers.servos.family import BROADCAST, Family, Model, Packet, Register, Reply, Request
from drivers.servos.summed import Frame, SummedParser

FRAME = Frame(b"\xff\xff", 2)
OVERHEAD = 6  # bytes of a frame without parameters
HARDWARE = 0b100101  # the error bits that are the servo's: voltage, temperature, load; the others judge the packet
ERRORS = {0: "input voltage", 2: "overheating", 5: "overload"}


class Instruction(IntEnum):
    """What a frame asks for."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    RESET = 0x06
    REBOOT = 0x08
    SYNC_READ = 0x82  # Feetech STS only
    SYNC_WRITE = 0x83
    BULK_READ = 0x92  # MX only


class Fault(IntEnum):
    """Error bits that judge the packet."""

    NONE = 0
    LIMIT = 0x02
    RANGE = 0x08
    SUM = 0x10
    INSTRUCTION = 0x40


@dataclass(frozen=True)
class Dynamixel1:
    """The `Codec` of protocol 1.0."""

    def parser(self) -> SummedParser:
        """A new parser."""
        return SummedParser(FRAME)

    def ping(self, ident: int) -> Request:
        """Ask servo `ident` for its error byte."""
        return Request(FRAME.build(ident, Instruction.PING), (ident,), 0, OVERHEAD)

    def read(self, idents: Sequence[int], address: int, size: int, *, group: bool, fast: bool) -> list[Request]:
        """A read for each servo, or one sync read where the servos know it (Feetech STS)."""
        ids, span = tuple(idents), bytes([address, size])
        if group:
            data = FRAME.build(BROADCAST, Instruction.SYNC_READ, span + bytes(ids))
            return [Request(data, ids, size, len(ids) * (OVERHEAD + size), address)]
        return [Request(FRAME.build(i, Instruction.READ, span), (i,), size, OVERHEAD + size, address) for i in ids]

    def write(self, address: int, rows: Sequence[tuple[int, bytes]]) -> bytes:
        """A sync write."""
        size = len(rows[0][1])
        params = bytes([address, size]) + b"".join(bytes([i]) + data for i, data in rows)
        return FRAME.build(BROADCAST, Instruction.SYNC_WRITE, params)

    def replies(self, packet: Packet, request: Request) -> list[Reply]:
        """Of a status frame: nothing marks it as one but its place after the request."""
        return [Reply(packet.id, packet.code, packet.params)]


def _registers(turn: int, compliance: tuple[Register, ...], *, current: int) -> tuple[Register, ...]:
    """The table that AX and MX share; `turn`: highest position; `current`: default of the punch register."""
    return (
        Register("model_number", 0, 2),
        Register("firmware_version", 2, 1, 24),
        Register("id", 3, 1, 1, 0, 253),
        Register("baud_rate", 4, 1, 1, 0, 254),
        Register("return_delay_time", 5, 1, 250, 0, 254),
        Register("cw_angle_limit", 6, 2, 0, 0, turn),
        Register("ccw_angle_limit", 8, 2, turn, 0, turn),
        Register("temperature_limit", 11, 1, 70, 0, 99),
        Register("min_voltage_limit", 12, 1, 60, 50, 160),
        Register("max_voltage_limit", 13, 1, 140, 50, 160),
        Register("max_torque", 14, 2, 1023, 0, 1023),
        Register("status_return_level", 16, 1, 2, 0, 2),
        Register("alarm_led", 17, 1, 36, 0, 127),
        Register("shutdown", 18, 1, 36, 0, 127),
        Register("torque_enable", 24, 1, 0, 0, 1),
        Register("led", 25, 1, 0, 0, 1),
        *compliance,
        Register("goal_position", 30, 2, 0, 0, turn),
        Register("moving_speed", 32, 2, 0, 0, 1023),
        Register("torque_limit", 34, 2, 1023, 0, 1023),
        Register("present_position", 36, 2),
        Register("present_speed", 38, 2, sign_bit=10),
        Register("present_load", 40, 2, sign_bit=10),
        Register("present_input_voltage", 42, 1, 120),
        Register("present_temperature", 43, 1, 30),
        Register("registered_instruction", 44, 1),
        Register("moving", 46, 1),
        Register("lock", 47, 1, 0, 0, 1),
        Register("punch", 48, 2, current, 0, 1023),
    )


_AX = (
    Register("cw_compliance_margin", 26, 1, 1, 0, 255),
    Register("ccw_compliance_margin", 27, 1, 1, 0, 255),
    Register("cw_compliance_slope", 28, 1, 32, 2, 254),
    Register("ccw_compliance_slope", 29, 1, 32, 2, 254),
)
_MX = (
    Register("d_gain", 26, 1, 0, 0, 254),
    Register("i_gain", 27, 1, 0, 0, 254),
    Register("p_gain", 28, 1, 32, 0, 254),
)


def _model(number: int, registers: tuple[Register, ...], stall: float, speed_rpm: float, full_error: float) -> Model:
    return Model(
        number=number,
        registers=registers,
        eeprom=range(24),
        state=("present_position", "present_load", "present_input_voltage", "present_temperature"),
        voltage_unit=0.1,
        full_error=full_error,
        errors=ERRORS,
        current=("present_load", stall / 1023),
        speed=("moving_speed", speed_rpm * 2 * math.pi / 60),
        slow=(("torque_enable", "moving_speed"),),
        guard=("torque_enable", "moving_speed"),
        setup={"return_delay_time": 0},
        group_read=False,
        enables=True,
        torque=("torque_limit", "max_torque"),
    )


# Load is told in 1/1023 of what the motor can give: of the stall current it is an estimate. A compliance slope of 32
# gives full torque at 32 steps of 0.29°; that of an MX with P gain 32 is taken to be the same.
AX_MX = Family(
    name="dynamixel1",
    codec=Dynamixel1(),
    models={
        "AX-12A": _model(12, _registers(1023, _AX, current=32), 1.5, 0.111, math.radians(32 * 300 / 1023)),
        "MX-28": _model(29, _registers(4095, _MX, current=0), 1.4, 0.114, math.radians(32 * 300 / 1023)),
    },
    bauds={2_000_000 // (code + 1): code for code in (1, 3, 4, 7, 9, 16, 34, 103, 207)},
    alerts=HARDWARE,
)
