"""`Frame` version 1: a block of joint samples as one binary message. The layout is frozen; see `docs/wire.md`.

A 64-byte little-endian header, float32 arrays (positions, velocities, root, optional torque limits), contact bits as
uint32 and a CRC-32 over everything before it. Later versions change `VERSION`, never this layout.
"""

from __future__ import annotations

import re
import struct
import zlib
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

MAGIC = b"RIGF"
VERSION = 1
HEADER = struct.Struct("<4sBBBBIHHQQ8sQQQ")
CRC = struct.Struct("<I")
TORQUE_FLAG = 1

MAX_JOINTS = 128
MAX_SAMPLES = 256
MAX_PERIOD_NS = 10_000_000_000
MAX_NORM = 1e4  # of each array, in rad, rad/s, m or N·m: nothing real is larger, and a wrong scale or byte order is
UNCHECKED = "0" * 16

Float32 = NDArray[np.float32]


class FrameError(ValueError):
    """A message that is not a valid one of ours; one line says what is wrong with it."""


class State(IntEnum):
    """What the sender asks of the rig: nothing any more, follow, stay where you are, go to the safe pose and relax."""

    IDLE = 0
    PLAY = 1
    HOLD = 2
    SAFE = 3


class Clock(IntEnum):
    """Which clock the times of a frame are read from: the sender's CLOCK_MONOTONIC, or UTC since 1970."""

    MONOTONIC = 1
    UTC = 2


@dataclass(frozen=True, slots=True)
class Frame:
    """`N` ≥ 1 samples of a rig's `nj` joints, `period_ns` apart; sample k is due at `due_ns + k * period_ns`.

    `stream`: 32 random bits, one value per run of a publisher. `seq` counts that stream's frames. `capture_ns` is when
    the frame was made; both times are on `clock`. `report_id`: 16 hex digits of the passed report, `UNCHECKED` where
    there is none. `pos` (N, nj) rad; `vel` (N, nj) rad/s; `root` (N, 7) metres and quaternion w x y z, world;
    `contacts` (N,) uint32, bit k is foot k of the rig; `torque` (nj,) N·m at most, or None for the servos' own limit.

    Raises FrameError naming the field that is out of its range.
    """

    stream: int
    seq: int
    rig_hash: int
    report_id: str
    capture_ns: int
    due_ns: int
    period_ns: int
    pos: Float32
    vel: Float32
    root: Float32
    contacts: NDArray[np.uint32]
    torque: Float32 | None = None
    state: State = State.PLAY
    clock: Clock = Clock.MONOTONIC

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "pos", np.ascontiguousarray(self.pos, "<f4"))
        put(self, "vel", np.ascontiguousarray(self.vel, "<f4"))
        put(self, "root", np.ascontiguousarray(self.root, "<f4"))
        put(self, "contacts", np.ascontiguousarray(self.contacts, "<u4"))
        if self.torque is not None:
            put(self, "torque", np.ascontiguousarray(self.torque, "<f4"))
        _check_shapes(self)
        _check_values(self)
        _check_header(self)

    @property
    def checked(self) -> bool:
        """Whether a passed report stands behind the frame."""
        return self.report_id != UNCHECKED


def encode(frame: Frame) -> bytes:
    """One message for `frame`; the frame was validated when it was built."""
    count, joints = frame.pos.shape
    header = HEADER.pack(
        MAGIC,
        VERSION,
        frame.state,
        frame.clock,
        0 if frame.torque is None else TORQUE_FLAG,
        frame.stream,
        joints,
        count,
        frame.seq,
        frame.rig_hash,
        bytes.fromhex(frame.report_id),
        frame.capture_ns,
        frame.due_ns,
        frame.period_ns,
    )
    torque = b"" if frame.torque is None else frame.torque.tobytes()
    arrays = (frame.pos.tobytes(), frame.vel.tobytes(), frame.root.tobytes(), torque, frame.contacts.tobytes())
    body = b"".join((header, *arrays))
    return body + CRC.pack(zlib.crc32(body))


def size(joints: int, samples: int, torque: bool) -> int:
    """Bytes of a message with `samples` samples of `joints` joints."""
    return HEADER.size + 4 * (2 * samples * joints + 7 * samples + joints * torque + samples) + CRC.size


MAX_BYTES = size(MAX_JOINTS, MAX_SAMPLES, torque=True)


def decode(data: bytes) -> Frame:
    """The frame in `data`; its arrays are read-only views of it.

    Raises FrameError where anything is off: magic, version, length, CRC, a header field, a number that is not finite.
    """
    if len(data) < HEADER.size + CRC.size:
        raise FrameError(f"frame: {len(data)} bytes are too few for a header of {HEADER.size}")
    (magic, version, state, clock, flags, stream, joints, count, seq, rig_hash, report, capture, due, period) = (
        HEADER.unpack_from(data)
    )
    if magic != MAGIC:
        raise FrameError(f"frame: magic {magic!r} instead of {MAGIC!r}: not a frame of ours")
    if version != VERSION:
        raise FrameError(f"frame: version {version}; this receiver reads version {VERSION}")
    if flags & ~TORQUE_FLAG:
        raise FrameError(f"frame: unknown flags 0x{flags:02x}")
    if not (0 < joints <= MAX_JOINTS and 0 < count <= MAX_SAMPLES):
        raise FrameError(
            f"frame: {count} samples of {joints} joints; at most {MAX_SAMPLES} of {MAX_JOINTS}, at least 1"
        )
    if len(data) != size(joints, count, bool(flags)):
        raise FrameError(f"frame: {len(data)} bytes instead of {size(joints, count, bool(flags))}")
    crc = zlib.crc32(memoryview(data)[: -CRC.size])
    if crc != CRC.unpack_from(data, len(data) - CRC.size)[0]:
        raise FrameError("frame: CRC-32 does not match: the message was damaged")
    if state not in _STATES or clock not in _CLOCKS:
        raise FrameError(f"frame: state {state} and clock {clock}; states are 0…3, clocks 1 and 2")
    floats = (len(data) - HEADER.size - CRC.size) // 4 - count
    values, block = np.frombuffer(data, "<f4", floats, HEADER.size), count * joints
    return Frame(
        stream=stream,
        seq=seq,
        rig_hash=rig_hash,
        report_id=report.hex(),
        capture_ns=capture,
        due_ns=due,
        period_ns=period,
        pos=values[:block].reshape(count, joints),
        vel=values[block : 2 * block].reshape(count, joints),
        root=values[2 * block : 2 * block + 7 * count].reshape(count, 7),
        contacts=np.frombuffer(data, "<u4", count, len(data) - CRC.size - 4 * count),
        torque=values[2 * block + 7 * count :] if flags else None,
        state=_STATES[state],
        clock=_CLOCKS[clock],
    )


def _check_shapes(frame: Frame) -> None:
    shape = frame.pos.shape
    if len(shape) != 2 or not (0 < shape[0] <= MAX_SAMPLES and 0 < shape[1] <= MAX_JOINTS):
        raise FrameError(f"frame: pos {shape}; it must be (samples, joints), 1…{MAX_SAMPLES} and 1…{MAX_JOINTS}")
    count, joints = shape
    if frame.vel.shape != shape or frame.root.shape != (count, 7) or frame.contacts.shape != (count,):
        raise FrameError(
            f"frame: vel {frame.vel.shape}, root {frame.root.shape}, contacts {frame.contacts.shape} beside pos {shape}"
        )
    if frame.torque is not None and frame.torque.shape != (joints,):
        raise FrameError(f"frame: torque {frame.torque.shape} for {joints} joints")


def _check_values(frame: Frame) -> None:
    with np.errstate(over="ignore"):
        for name, array in (("pos", frame.pos), ("vel", frame.vel), ("root", frame.root)):
            flat = array.reshape(-1)
            # One dot product finds NaN (no comparison with it holds), infinity and nonsense; every message pays this.
            if not flat.dot(flat) <= MAX_NORM**2:
                raise FrameError(f"frame: {name} holds NaN, infinity or numbers beyond {MAX_NORM:g} in norm")
    for w, x, y, z in frame.root[:, 3:].tolist():
        if abs(w * w + x * x + y * y + z * z - 1) > 2e-3:
            raise FrameError(f"frame: the root quaternion {w:g} {x:g} {y:g} {z:g} is not of unit length")
    if frame.torque is not None and not (frame.torque.min() >= 0 and frame.torque.max() <= MAX_NORM):
        raise FrameError(f"frame: a torque limit is NaN or not in 0…{MAX_NORM:g} N·m")


def _check_header(frame: Frame) -> None:
    if not 0 < frame.period_ns <= MAX_PERIOD_NS:
        raise FrameError(f"frame: period_ns {frame.period_ns}; it must be in 1…{MAX_PERIOD_NS}")
    if not 0 <= frame.stream < 1 << 32:
        raise FrameError(f"frame: stream {frame.stream} does not fit 32 bits")
    # The or of all is out of range exactly where one of them is.
    if not 0 <= frame.seq | frame.rig_hash | frame.capture_ns | frame.due_ns < 1 << 64:
        raise FrameError("frame: seq, rig_hash, capture_ns or due_ns does not fit 64 bits unsigned")
    if not _REPORT_ID(frame.report_id):
        raise FrameError(f"frame: report_id {frame.report_id!r} is not 16 lower-case hex digits")


_STATES = {int(s): s for s in State}
_CLOCKS = {int(c): c for c in Clock}
_REPORT_ID = re.compile("[0-9a-f]{16}").fullmatch
