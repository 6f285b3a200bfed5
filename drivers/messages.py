"""The messages beside the frames: `Hello` tells who streams, `Stop` latches, `RigState` is the way back.

MessagePack maps (msgspec), each with a `type` that names it and its version. Fields may be added in later versions and
are then ignored here; a missing, ill-typed or out-of-range field is a FrameError.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from drivers.frame import MAX_JOINTS, FrameError

MAX_MESSAGE_BYTES = 65_536
OPEN_LOOP = "open_loop"  # the controller of a stream that is followed as it is

U64 = Annotated[int, msgspec.Meta(ge=0)]  # MessagePack has no larger ones
Text = Annotated[str, msgspec.Meta(max_length=1000)]
Names = Annotated[tuple[Text, ...], msgspec.Meta(max_length=MAX_JOINTS)]
Numbers = Annotated[tuple[float, ...], msgspec.Meta(max_length=MAX_JOINTS)]
Mode = Literal["waiting", "following", "hold", "safe", "stopped", "tripped"]


class Hello(msgspec.Struct, frozen=True, tag="rigcast.hello.1", tag_field="type"):
    """Who streams, for which rig. `lower`, `upper` (nj,) rad; `velocity` (nj,) rad/s at most; `rate_hz` samples/s.

    `text` is what was asked for; `source` says what made the motion, `licence` what its data allow. `controller`: what
    must run beside the stream, as its report says; where that is not `open_loop` the frames themselves carry no report,
    so that nothing moves which has not read this.
    """

    rig: Text
    rig_hash: U64
    joints: Names
    lower: Numbers
    upper: Numbers
    velocity: Numbers
    rate_hz: Annotated[float, msgspec.Meta(gt=0, le=1e6)]
    stream: Annotated[int, msgspec.Meta(ge=0, lt=1 << 32)]
    report_id: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{16}$")]
    text: Text = ""
    source: Text = ""
    licence: Text = ""
    controller: Text = OPEN_LOOP

    def __post_init__(self) -> None:
        _same_length("hello", len(self.joints), self.lower, self.upper, self.velocity)


class Stop(msgspec.Struct, frozen=True, tag="rigcast.stop.1", tag_field="type"):
    """Torque off, now. A rig that has read one stays stopped until a person re-arms it at the rig."""

    reason: Text


class RigState(msgspec.Struct, frozen=True, tag="rigcast.state.1", tag_field="type"):
    """What a rig measured. All (nj,) in the rig's joint order: rad, A, °C, V; empty where the rig cannot measure it.

    `command` rad is where the joints were told to be when it was measured, empty while the torque is off. `seq` is the
    frame it last followed, `time_ns` its own CLOCK_MONOTONIC, `reason` why it left "following". `frame_ns` is the
    capture time of that frame on the sender's clock and `heard_ns` when it came, on the rig's; 0 where none has come.
    `run`: 32 random bits, one value per run of the driver.
    """

    rig: Text
    rig_hash: U64
    mode: Mode
    reason: Text
    seq: U64
    time_ns: U64
    position: Numbers
    current: Numbers = ()
    temperature: Numbers = ()
    voltage: Numbers = ()
    frame_ns: U64 = 0
    heard_ns: U64 = 0
    run: Annotated[int, msgspec.Meta(ge=0, lt=1 << 32)] = 0
    command: Numbers = ()

    def __post_init__(self) -> None:
        measured = [v for v in (self.current, self.temperature, self.voltage, self.command) if v]
        _same_length("state", len(self.position), self.position, *measured)


Message = TypeVar("Message", Hello, Stop, RigState)


def pack(message: msgspec.Struct) -> bytes:
    """One message part."""
    return msgspec.msgpack.encode(message)


def unpack(data: bytes, kind: type[Message]) -> Message:
    """The message of type `kind` in `data`; raises FrameError where it is not exactly one."""
    found: Message = decoded(data, kind, kind.__name__.lower())
    return found


def news_in(data: bytes) -> Hello | RigState:
    """What came on the hello socket: who streams, or what a rig has told the publisher; raises FrameError."""
    found: Hello | RigState = decoded(data, Hello | RigState, "hello")
    return found


def decoded(data: bytes, kind: Any, name: str) -> Any:
    """The message of type `kind`, or of one type of a union, in `data`; raises FrameError, which begins with `name`."""
    try:
        return msgspec.msgpack.decode(data, type=kind)
    except (msgspec.DecodeError, msgspec.ValidationError, UnicodeDecodeError) as error:
        said = "".join(c if c.isprintable() else "?" for c in str(error)[:200])  # it may quote what was sent
        raise FrameError(f"{name}: {said}") from None


def _same_length(what: str, joints: int, *columns: tuple[float, ...]) -> None:
    for column in columns:
        if len(column) != joints or not all(map(math.isfinite, column)):
            raise ValueError(f"{what}: {len(column)} numbers for {joints} joints, or one that is not finite")
