"""Dynamixel protocol 2.0 packets: `FF FF FD 00 | id | length | instruction | parameters | CRC-16`, stuffed.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0", https://emanual.robotis.com/docs/en/dxl/protocol2/
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

from drivers.servos.family import BROADCAST, Packet, Reply, Request

HEADER = b"\xff\xff\xfd\x00"
MAX_LENGTH = 1024  # of the length field; longer ones are noise


class Instruction(IntEnum):
    """What a packet asks for; STATUS marks a reply."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93


class Fault(IntEnum):
    """Error number of a status packet; `ALERT` is or-ed in while the servo's hardware error status is not zero."""

    NONE = 0
    RESULT = 1
    INSTRUCTION = 2
    CRC = 3
    RANGE = 4
    LENGTH = 5
    LIMIT = 6
    ACCESS = 7
    ALERT = 0x80


def _crc_row(byte: int) -> int:
    row = byte << 8
    for _ in range(8):
        row = (row << 1) ^ (0x8005 if row & 0x8000 else 0)
    return row & 0xFFFF


_CRC_TABLE = tuple(_crc_row(byte) for byte in range(256))


def crc16(data: bytes, crc: int = 0) -> int:
    """CRC-16 of `data`: polynomial 0x8005, not reflected, continued from `crc`."""
    for byte in data:
        crc = (crc << 8) & 0xFFFF ^ _CRC_TABLE[crc >> 8 ^ byte]
    return crc


def build(ident: int, instruction: int, params: bytes = b"") -> bytes:
    """The bytes of a packet, stuffed: `FF FF FD` inside it becomes `FF FF FD FD`, so that it is no header."""
    body = (bytes([instruction]) + params).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = HEADER + bytes([ident]) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc16(head).to_bytes(2, "little")


def status(ident: int, error: int, params: bytes = b"") -> bytes:
    """The bytes of a status packet."""
    return build(ident, Instruction.STATUS, bytes([error]) + params)


class Parser:
    """Finds packets in a byte stream, unstuffed; see `Parser` of `family.py`."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.damaged = 0

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that `data` completes."""
        self._buffer += data
        found: list[Packet] = []
        while True:
            start = self._buffer.find(HEADER)
            if start < 0:
                del self._buffer[: max(0, len(self._buffer) - len(HEADER) + 1)]
                return found
            del self._buffer[:start]
            if len(self._buffer) < 7:
                return found
            length = int.from_bytes(self._buffer[5:7], "little")
            if not 3 <= length <= MAX_LENGTH:
                self._skip()
                continue
            if len(self._buffer) < 7 + length:
                return found
            whole = bytes(self._buffer[: 7 + length])
            if crc16(whole[:-2]) != int.from_bytes(whole[-2:], "little"):
                self._skip()
                continue
            del self._buffer[: len(whole)]
            body = whole[7:-2]
            if (whole[4], body[0]) != (BROADCAST, Instruction.STATUS):  # A fast reply is not stuffed.
                body = body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            found.append(Packet(whole[4], body[0], body[1:]))

    def _skip(self) -> None:
        self.damaged += 1
        del self._buffer[: len(HEADER)]


class Dynamixel2:
    """The `Codec` of protocol 2.0."""

    def parser(self) -> Parser:
        """A new parser."""
        return Parser()

    def ping(self, ident: int) -> Request:
        """Ask servo `ident` for its model number and firmware."""
        return Request(build(ident, Instruction.PING), (ident,), 3, 14)

    def read(self, idents: Sequence[int], address: int, size: int, *, group: bool, fast: bool) -> list[Request]:
        """A sync read; `fast` has all servos answer in one packet."""
        ids, span = tuple(idents), address.to_bytes(2, "little") + size.to_bytes(2, "little")
        if fast:
            data = build(BROADCAST, Instruction.FAST_SYNC_READ, span + bytes(ids))
            return [Request(data, ids, size, 8 + len(ids) * (size + 4), address)]
        data = build(BROADCAST, Instruction.SYNC_READ, span + bytes(ids))
        return [Request(data, ids, size, len(ids) * (size + 11), address)]

    def write(self, address: int, rows: Sequence[tuple[int, bytes]]) -> bytes:
        """A sync write."""
        size = len(rows[0][1])
        span = address.to_bytes(2, "little") + size.to_bytes(2, "little")
        return build(BROADCAST, Instruction.SYNC_WRITE, span + b"".join(bytes([i]) + data for i, data in rows))

    def replies(self, packet: Packet, request: Request) -> list[Reply]:
        """Of a status packet, or of each servo's part of a fast one: error, id, data, CRC."""
        if packet.code != Instruction.STATUS or not packet.params:
            return []
        if packet.id != BROADCAST:
            return [Reply(packet.id, packet.params[0], packet.params[1:])]
        step = request.size + 4
        whole = packet.params + b"\0\0"  # The last CRC is the packet's own.
        if len(whole) != step * len(request.ids):
            return []
        parts = [whole[at : at + step] for at in range(0, len(whole), step)]
        return [Reply(p[1], p[0], p[2:-2]) for p in parts]
