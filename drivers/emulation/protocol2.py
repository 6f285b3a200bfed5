"""What servos answer to instruction packets of Dynamixel protocol 2.0."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.emulation.listeners import Listeners, collide
from drivers.emulation.servo import EmulatedServo
from drivers.servos.dynamixel2 import HEADER, Fault, Instruction, crc16, status
from drivers.servos.family import BROADCAST, Packet

LONGEST = 256  # bytes that one servo's part of a fast reply may have


def answers(packet: Packet, line: Listeners) -> Iterator[tuple[int, bytes]]:
    """Carry out `packet`; yields each status packet with its servo's return delay, in units of register 9."""
    kind, params = packet.code, packet.params
    if kind == Instruction.SYNC_WRITE and len(params) >= 4:
        address, size = _pair(params, 0)
        for at in range(4, len(params) - size, 1 + size):
            line.write_at(params[at], address, params[at + 1 : at + 1 + size])
    elif kind == Instruction.BULK_WRITE:
        at = 0
        while at + 5 <= len(params):
            address, size = _pair(params, at + 1)
            line.write_at(params[at], address, params[at + 5 : at + 5 + size])
            at += 5 + size
    elif kind == Instruction.SYNC_READ and len(params) >= 4:
        address, size = _pair(params, 0)
        for ident in params[4:]:
            yield from _read(line, ident, address, size)
    elif kind == Instruction.BULK_READ:
        for at in range(0, len(params) - 4, 5):
            yield from _read(line, params[at], *_pair(params, at + 1))
    elif kind == Instruction.FAST_SYNC_READ and len(params) >= 4:
        yield from _fast_read(line, params)
    elif packet.id == BROADCAST:
        for ident in line.ids():
            reply = line.together(ident, lambda servo: _single(servo, packet, line))
            if kind == Instruction.PING:
                yield line.at(ident)[0].get("return_delay_time"), reply
    elif line.at(packet.id):
        first = line.at(packet.id)[0]
        level, delay = first.get("status_return_level"), first.get("return_delay_time")
        reply = line.together(packet.id, lambda servo: _single(servo, packet, line))
        if kind == Instruction.PING or level == 2 or (level == 1 and kind == Instruction.READ):
            yield delay, reply


def _single(servo: EmulatedServo, packet: Packet, line: Listeners) -> bytes:
    """Carry out an instruction for one servo; returns its status packet."""
    kind, params, ident = packet.code, packet.params, servo.get("id")
    fault, data = Fault.NONE, b""
    if kind == Instruction.PING:
        data = servo.get("model_number").to_bytes(2, "little") + bytes([servo.get("firmware_version")])
    elif kind == Instruction.READ and len(params) == 4:
        answer = servo.read(*_pair(params, 0))
        fault, data = (answer, b"") if isinstance(answer, Fault) else (fault, answer)
    elif kind == Instruction.WRITE and len(params) > 2:
        fault = line.write(servo, _pair(params + b"\0\0", 0)[0], params[2:])
    elif kind == Instruction.REG_WRITE and len(params) > 2:
        servo.pending = (_pair(params + b"\0\0", 0)[0], params[2:])
        servo.put("registered_instruction", 1)
    elif kind == Instruction.ACTION:
        if servo.pending is None:
            fault = Fault.RESULT
        else:
            fault = line.write(servo, *servo.pending)
            servo.pending = None
            servo.put("registered_instruction", 0)
    elif kind == Instruction.REBOOT:
        servo.reboot(line.now)
    else:
        fault = Fault.INSTRUCTION
    return status(ident, fault | servo.alert, data)


def _pair(params: bytes, at: int) -> tuple[int, int]:
    """Address and size, two little-endian words."""
    return int.from_bytes(params[at : at + 2], "little"), int.from_bytes(params[at + 2 : at + 4], "little")


def _read(line: Listeners, ident: int, address: int, size: int) -> Iterator[tuple[int, bytes]]:
    def answer(servo: EmulatedServo) -> bytes:
        read = servo.read(address, size)
        fault, data = (read, b"") if isinstance(read, Fault) else (Fault.NONE, read)
        return status(ident, fault | servo.alert, data)

    if line.at(ident) and line.at(ident)[0].get("status_return_level") > 0:
        yield line.at(ident)[0].get("return_delay_time"), line.together(ident, answer)


def _fast_read(line: Listeners, params: bytes) -> Iterator[tuple[int, bytes]]:
    """One status packet that all the servos write together, each continuing the CRC of those before it.

    Its length is announced by the first servo, so there is no byte stuffing. A servo that is missing ends it.
    """
    address, size = _pair(params, 0)
    idents = params[4:]
    if not 0 < size <= LONGEST:
        return
    packet = HEADER + bytes([BROADCAST]) + (1 + len(idents) * (size + 4)).to_bytes(2, "little")
    packet += bytes([Instruction.STATUS])
    delay, crc = 0, crc16(packet)
    for ident in idents:
        servos = line.at(ident)
        read = [(s.alert, s.read(address, size)) for s in servos]
        parts = [bytes([alert, ident]) + a for alert, a in read if not isinstance(a, Fault)]
        if not servos or len(parts) < len(servos):
            break
        part = collide(parts)
        crc = crc16(part, crc)
        packet += part + crc.to_bytes(2, "little")
        crc = crc16(crc.to_bytes(2, "little"), crc)
        delay = delay or servos[0].get("return_delay_time")
    yield delay, packet
