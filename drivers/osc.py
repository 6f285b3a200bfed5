"""Open Sound Control 1.0: messages of numbers and texts, alone or in bundles, as UDP datagrams carry them.

Everything is padded to four bytes and big-endian. Nothing is allocated from a length before it is checked.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import dataclass

BUNDLE = b"#bundle\0"
AT_ONCE = (1).to_bytes(8, "big")  # the time tag that means now
MOST_BYTES = 65_507  # of a datagram
MOST_DEEP = 4  # bundles within bundles
FIXED = {"i": ">i", "f": ">f", "h": ">q", "d": ">d"}
WITHOUT_BYTES = {"T": True, "F": False}

Argument = int | float | str | bool


class OscError(ValueError):
    """Bytes that are no OSC; one line says what is wrong with them."""


@dataclass(frozen=True)
class Message:
    """`args` for the thing at `address`, such as "/VMC/Ext/Bone/Pos"."""

    address: str
    args: tuple[Argument, ...]


def bundle(messages: Iterable[Message]) -> bytes:
    """One datagram that says all of `messages` at once; ints have 32 bits, floats are of single precision.

    Raises struct.error for an int that 32 bits do not hold.
    """
    packed = [_packed(message) for message in messages]
    return BUNDLE + AT_ONCE + b"".join(len(each).to_bytes(4, "big") + each for each in packed)


def messages_in(data: bytes) -> list[Message]:
    """The messages of a datagram, in order. Raises OscError where any of it is off."""
    if len(data) > MOST_BYTES:
        raise OscError(f"OSC: {len(data)} bytes; a datagram has {MOST_BYTES} at most")
    return list(_messages(data, MOST_DEEP))


def _packed(message: Message) -> bytes:
    tags, body = ",", b""
    for value in message.args:
        if isinstance(value, str):
            tags, body = tags + "s", body + _padded(value)
        elif isinstance(value, int):
            tags, body = tags + "i", body + struct.pack(">i", value)
        else:
            tags, body = tags + "f", body + struct.pack(">f", value)
    return _padded(message.address) + _padded(tags) + body


def _padded(text: str) -> bytes:
    data = text.encode()
    return data + bytes(4 - len(data) % 4)


def _messages(data: bytes, deep: int) -> Iterable[Message]:
    if not data.startswith(BUNDLE):
        yield _message(data)
        return
    if deep == 0:
        raise OscError(f"OSC: bundles within bundles, deeper than {MOST_DEEP}")
    at = len(BUNDLE) + len(AT_ONCE)
    if len(data) < at:
        raise OscError("OSC: a bundle without a time tag")
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        at += 4
        if size % 4 or not 0 < size <= len(data) - at:
            raise OscError(f"OSC: an element of {size} bytes where {max(len(data) - at, 0)} are left")
        yield from _messages(data[at : at + size], deep - 1)
        at += size


def _message(data: bytes) -> Message:
    address, at = _text(data, 0)
    if not address.startswith("/"):
        raise OscError(f"OSC: {address[:40]!r} is no address: it must begin with /")
    tags, at = _text(data, at)
    if not tags.startswith(","):
        raise OscError(f"OSC: {address[:40]}: no type tags")
    args: list[Argument] = []
    for tag in tags[1:]:
        if tag in WITHOUT_BYTES:
            args.append(WITHOUT_BYTES[tag])
        elif tag == "s":
            text, at = _text(data, at)
            args.append(text)
        elif tag in FIXED:
            value, at = _fixed(data, at, FIXED[tag])
            args.append(value)
        else:
            raise OscError(f"OSC: {address[:40]}: type tag {tag!r}; read are s {' '.join((*FIXED, *WITHOUT_BYTES))}")
    if at != len(data):
        raise OscError(f"OSC: {address[:40]}: {len(data) - at} bytes are left over")
    return Message(address, tuple(args))


def _text(data: bytes, at: int) -> tuple[str, int]:
    end = data.find(b"\0", at)
    after = end + 4 - (end - at) % 4
    if end < 0 or after > len(data):
        raise OscError("OSC: a text that does not end")
    try:
        return data[at:end].decode(), after
    except UnicodeDecodeError:
        raise OscError("OSC: a text that is no UTF-8") from None


def _fixed(data: bytes, at: int, kind: str) -> tuple[int | float, int]:
    after = at + struct.calcsize(kind)
    if after > len(data):
        raise OscError("OSC: a number that is cut short")
    value: int | float = struct.unpack_from(kind, data, at)[0]
    return value, after
