"""A file of what was on the wire, byte for byte. It only grows, and whatever was written before a kill can be read.

Little-endian. A header of 24 bytes: `RIGREC` and two bytes of version (1), then UTC and CLOCK_MONOTONIC at the start,
u64 nanoseconds each. Then records: u32 bytes of the message, u8 channel, u64 monotonic nanoseconds at which it came,
the message, and a CRC-32 over all of the record before it. `docs/wire.md` says the same.
"""

from __future__ import annotations

import os
import struct
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from drivers.endpoint import StreamError
from drivers.frame import MAX_BYTES

SUFFIX = ".rigrec"
MAGIC = b"RIGREC\x01\x00"
START = struct.Struct("<8sQQ")
HEAD = struct.Struct("<IBQ")
CRC = struct.Struct("<I")


class Channel(IntEnum):
    """The socket that a message came from."""

    FRAMES = 0
    HELLO = 1
    STOP = 2


@dataclass(frozen=True, slots=True)
class Record:
    """A message as it came: its bytes, whole or not, and CLOCK_MONOTONIC of that moment, ns."""

    channel: Channel
    time_ns: int
    data: bytes


class Recorder:
    """Writes records to a new file; a context manager. Each record is in the file once `write` returns.

    Raises FileExistsError where `path` is there already, OSError where it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._file = open(path, "xb", buffering=0)  # noqa: SIM115
        self._file.write(START.pack(MAGIC, time.time_ns(), time.monotonic_ns()))

    def write(self, record: Record) -> None:
        """Append `record`. Raises OSError, as where the disk is full."""
        body = HEAD.pack(len(record.data), record.channel, record.time_ns) + record.data
        self._file.write(body + CRC.pack(zlib.crc32(body)))

    def close(self) -> None:
        """Close the file, once it is on the disk."""
        os.fsync(self._file.fileno())
        self._file.close()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


class Recording:
    """The records of a file, in the order in which they came; iterate as often as you like.

    `utc_ns` and `monotonic_ns`: both clocks when it began. `lost` bytes at the end could not be read, known after the
    first time through: the writer was killed, or the file was damaged. Raises StreamError where it is no recording.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.lost = 0
        with open(path, "rb") as file:
            start = file.read(START.size)
        if len(start) < START.size or start[: len(MAGIC)] != MAGIC:
            raise StreamError(f"{path}: not a recording of a stream, version 1")
        _, self.utc_ns, self.monotonic_ns = START.unpack(start)

    def __iter__(self) -> Iterator[Record]:
        with open(self._path, "rb") as file:
            end = os.fstat(file.fileno()).st_size
            at = file.seek(START.size)
            while (record := _next(file)) is not None:
                at = file.tell()
                yield record
            self.lost = end - at


def _next(file: BinaryIO) -> Record | None:
    """The record that begins here; None where it is cut short or damaged, and at the end."""
    head = file.read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    length, channel, time_ns = HEAD.unpack(head)
    if length > MAX_BYTES or channel not in _CHANNELS:
        return None
    rest = file.read(length + CRC.size)
    data = rest[:length]
    if len(rest) < length + CRC.size or zlib.crc32(data, zlib.crc32(head)) != CRC.unpack_from(rest, length)[0]:
        return None
    return Record(_CHANNELS[channel], time_ns, data)


_CHANNELS = {int(c): c for c in Channel}
