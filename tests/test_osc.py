"""OSC against python-osc, both ways, and against bytes that are no OSC."""

from __future__ import annotations

import random

import pytest
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage
from pythonosc.osc_message_builder import OscMessageBuilder

from drivers.osc import Message, OscError, bundle, messages_in

BONE = Message("/VMC/Ext/Bone/Pos", ("Hips", 0.5, 1.0, -0.25, 0.0, 0.0, 0.0, 1.0))


def built(message: Message) -> OscMessage:
    """`message` as python-osc makes it."""
    builder = OscMessageBuilder(message.address)
    for value in message.args:
        builder.add_arg(value)
    return builder.build()


@pytest.mark.parametrize("messages", [[], [BONE], [Message("/a", ()), BONE, Message("/héé", (3, -1, "ä" * 7, 0.5))]])
def test_what_we_say_is_read_by_others(messages: list[Message]) -> None:
    heard = [OscMessage(each.dgram) for each in OscBundle(bundle(messages))]
    assert [(m.address, tuple(m.params)) for m in heard] == [(m.address, m.args) for m in messages]


def test_what_others_say_is_read() -> None:
    odd = Message("/odd", (True, False, 2**40, 7, "", "abc", "abcd", 0.5))
    inner, outer = OscBundleBuilder(IMMEDIATELY), OscBundleBuilder(IMMEDIATELY)
    inner.add_content(built(odd))
    outer.add_content(built(BONE))
    outer.add_content(inner.build())
    assert messages_in(outer.build().dgram) == [BONE, odd]
    assert messages_in(built(odd).dgram) == [odd]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "does not end"),
        (b"abc\0", "no address"),
        (b"/a\0\0", "does not end"),
        (b"/a\0\0abc\0", "no type tags"),
        (b"/a\0\0,f\0\0\0\0", "cut short"),
        (b"/a\0\0,b\0\0\0\0\0\0", "type tag 'b'"),
        (b"/a\0\0,\0\0\0abcd", "left over"),
        (b"/\xff\0\0,\0\0\0", "UTF-8"),
        (b"#bundle\0", "time tag"),
        (b"#bundle\0" + bytes(8) + b"\xff\xff\xff\xfc" + b"/a\0\0,\0\0\0", "4294967292 bytes where 8 are left"),
        (b"#bundle\0" + bytes(8) + bytes(4), "0 bytes"),
        (bundle([BONE])[:-2], "68 bytes where 66 are left"),
        (bytes(70_000), "65507 at most"),
    ],
)
def test_what_is_no_osc_is_one_clear_line(data: bytes, words: str) -> None:
    with pytest.raises(OscError, match=words) as caught:
        messages_in(data)
    assert "\n" not in str(caught.value)


def test_bundles_in_bundles_end_somewhere() -> None:
    data = bundle([BONE])
    for _ in range(5):
        data = b"#bundle\0" + bytes(8) + len(data).to_bytes(4, "big") + data
    with pytest.raises(OscError, match="deeper than 4"):
        messages_in(data)


def test_damaged_bytes_are_read_or_refused() -> None:
    rng, good, read = random.Random(1), bundle([BONE, Message("/t", (1, 2.0, "x"))]), 0
    for _ in range(5000):
        data = bytearray(good)
        for _ in range(rng.randint(1, 3)):
            at = rng.randrange(len(data))
            data[at : at + rng.randint(0, 2)] = rng.randbytes(rng.randint(0, 3))
        try:
            messages_in(bytes(data))
        except OscError:
            continue
        read += 1
    assert 0 < read < 4000
