"""Frames of the older protocols: two header bytes, id, length, code, parameters and an inverted 8-bit sum.

Dynamixel protocol 1.0 and Feetech: `FF FF | id | n + 2 | code | n parameters | ~sum`. LewanSoul: `55 55`, n + 3. The
sum runs over all but the header. It lets about one damaged frame in 256 through.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.servos.family import Packet


@dataclass(frozen=True)
class Frame:
    """`header` of two equal bytes; the length field says `extra` more than there are parameters."""

    header: bytes
    extra: int

    def build(self, ident: int, code: int, params: bytes = b"") -> bytes:
        """The bytes of a frame; raises ValueError where `params` are more than its length field can tell."""
        body = bytes([ident, len(params) + self.extra, code]) + params
        return self.header + body + bytes([~sum(body) & 0xFF])


class SummedParser:
    """Finds frames in a byte stream; see `Parser`."""

    def __init__(self, frame: Frame) -> None:
        self._frame = frame
        self._buffer = bytearray()
        self.damaged = 0

    def feed(self, data: bytes) -> list[Packet]:
        """The packets that `data` completes."""
        header, extra = self._frame.header, self._frame.extra
        self._buffer += data
        found: list[Packet] = []
        while True:
            start = self._buffer.find(header)
            if start < 0:
                del self._buffer[: max(0, len(self._buffer) - 1)]
                return found
            del self._buffer[:start]
            if self._buffer[2:3] == b"\xff" == header[:1]:
                del self._buffer[0]  # No servo has the id 255: the frame starts one later.
                continue
            if len(self._buffer) < 4:
                return found
            count = self._buffer[3] - extra
            if count < 0:
                self._skip()
                continue
            if len(self._buffer) < 6 + count:
                return found
            whole = bytes(self._buffer[: 6 + count])
            if sum(whole[2:]) & 0xFF != 0xFF:
                self._skip()
                continue
            del self._buffer[: len(whole)]
            found.append(Packet(whole[2], whole[4], whole[5:-1]))

    def _skip(self) -> None:
        self.damaged += 1
        del self._buffer[0]
