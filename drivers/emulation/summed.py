"""What servos answer to frames of Dynamixel protocol 1.0, of Feetech's version of it, and of the LX-16A."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.emulation.listeners import Listeners
from drivers.emulation.servo import EmulatedServo
from drivers.servos import lx16a
from drivers.servos.dynamixel1 import FRAME, Fault, Instruction
from drivers.servos.dynamixel2 import Fault as Verdict
from drivers.servos.family import BROADCAST, Packet

REPLY_S = 50  # units of 2 µs that an LX-16A thinks before it answers: an estimate


def protocol1(packet: Packet, line: Listeners) -> Iterator[tuple[int, bytes]]:
    """Carry out a frame of protocol 1.0; yields each status frame with its servo's return delay, in units of 2 µs."""
    kind, params = packet.code, packet.params
    if kind == Instruction.SYNC_WRITE and len(params) > 2:
        address, size = params[0], params[1]
        for at in range(2, len(params) - size, 1 + size):
            line.write_at(params[at], address, params[at + 1 : at + 1 + size])
    elif kind == Instruction.SYNC_READ and len(params) > 2:
        for ident in params[2:]:
            if any(s.model.group_read for s in line.at(ident)):
                yield from _read(line, ident, params[0], params[1])
    elif kind == Instruction.BULK_READ:
        for at in range(1, len(params) - 2, 3):
            if any(s.get("model_number") == 29 for s in line.at(params[at + 1])):  # MX only
                yield from _read(line, params[at + 1], params[at + 2], params[at])
    else:
        for ident in line.ids() if packet.id == BROADCAST else [packet.id] * bool(line.at(packet.id)):
            first = line.at(ident)[0]
            level, delay = first.get("status_return_level"), first.get("return_delay_time")
            reply = line.together(ident, lambda servo: _single(servo, packet, line))
            if packet.id == BROADCAST or kind == Instruction.PING:
                talks = kind == Instruction.PING
            elif kind == Instruction.READ:
                talks = level > 0 or first.family.name == "feetech"
            else:
                talks = level == (1 if first.family.name == "feetech" else 2)
            if talks:
                yield delay, reply


def _single(servo: EmulatedServo, packet: Packet, line: Listeners) -> bytes:
    kind, params = packet.code, packet.params
    ident, error, data = servo.get("id"), 0, b""
    if kind == Instruction.READ and len(params) == 2:
        read = servo.read(params[0], params[1])
        error, data = (Fault.RANGE, b"") if isinstance(read, Verdict) else (0, read)
    elif kind == Instruction.WRITE and len(params) > 1:
        error = _verdict(servo, line.write(servo, params[0], params[1:]))
    elif kind == Instruction.REG_WRITE and len(params) > 1:
        servo.pending = (params[0], params[1:])
    elif kind == Instruction.ACTION:
        if servo.pending is not None:
            error = _verdict(servo, line.write(servo, *servo.pending))
            servo.pending = None
    elif kind == Instruction.REBOOT:
        servo.reboot(line.now)
    elif kind != Instruction.PING:
        error = Fault.INSTRUCTION
    return FRAME.build(ident, error | servo.alert, data)


def _verdict(servo: EmulatedServo, fault: Verdict) -> int:
    """The error bits of a write: Feetech servos keep quiet about it."""
    if servo.family.name == "feetech" or not fault:
        return 0
    return Fault.LIMIT if fault == Verdict.LIMIT else Fault.RANGE


def _read(line: Listeners, ident: int, address: int, size: int) -> Iterator[tuple[int, bytes]]:
    def answer(servo: EmulatedServo) -> bytes:
        read = servo.read(address, size)
        return FRAME.build(ident, servo.alert, b"" if isinstance(read, Verdict) else read)

    if line.at(ident):
        yield line.at(ident)[0].get("return_delay_time"), line.together(ident, answer)


def lewansoul(packet: Packet, line: Listeners) -> Iterator[tuple[int, bytes]]:
    """Carry out a frame for LX-16A servos; only reading commands are answered."""
    command, params = packet.code, packet.params
    idents = line.ids() if packet.id == BROADCAST else [packet.id]
    for register in lx16a.REGISTERS:
        reads = register.address if register.low is None else register.address + 1
        if command == register.address and register.low is not None and len(params) == register.size:
            for ident in idents:
                for servo in line.at(ident):
                    line.take(servo, register, params)
        elif command == reads and not params:
            for ident in idents:
                if line.at(ident):
                    yield REPLY_S, line.together(ident, lambda s, r=register: _told(s, r.name, command))  # type: ignore[misc]


def _told(servo: EmulatedServo, name: str, command: int) -> bytes:
    register = servo.model.by_name[name]
    return lx16a.FRAME.build(servo.get("id"), command, register.encode(servo.get(name)))
