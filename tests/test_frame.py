"""The wire format against bytes put together by hand, and against everything that is not a frame."""

import binascii
import struct
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.frame import HEADER, MAX_BYTES, UNCHECKED, Clock, Frame, FrameError, State, decode, encode
from drivers.messages import Hello, RigState, Stop, pack, unpack

POS = [[0.5, -0.25], [0.75, -0.5]]
VEL = [[1.0, 2.0], [3.0, 4.0]]
ROOT = [[1, 2, 3, 1, 0, 0, 0], [4, 5, 6, 0, 0, 0, 1]]


def a_frame(**changes):
    fields = {
        "stream": 0x01020304,
        "seq": 0x1122334455667788,
        "rig_hash": 0xA1A2A3A4A5A6A7A8,
        "report_id": "00deadbeef00ff01",
        "capture_ns": 1_000_000_007,
        "due_ns": 1_000_000_009,
        "period_ns": 20_000_000,
        "pos": np.array(POS, np.float32),
        "vel": np.array(VEL, np.float32),
        "root": np.array(ROOT, np.float32),
        "contacts": np.array([3, 1], np.uint32),
        "torque": np.array([1.5, 2.5], np.float32),
    }
    return Frame(**{**fields, **changes})


def golden() -> bytes:
    """The frame of `a_frame`, field by field as docs/wire.md lists them."""
    out = bytes.fromhex("52494746 01 01 01 01 04030201 0200 0200")
    out += bytes.fromhex("8877665544332211 a8a7a6a5a4a3a2a1 00deadbeef00ff01")
    out += struct.pack("<QQQ", 1_000_000_007, 1_000_000_009, 20_000_000)
    out += struct.pack("<4f", 0.5, -0.25, 0.75, -0.5)
    out += struct.pack("<4f", 1, 2, 3, 4)
    out += struct.pack("<14f", 1, 2, 3, 1, 0, 0, 0, 4, 5, 6, 0, 0, 0, 1)
    out += struct.pack("<2f", 1.5, 2.5)
    out += struct.pack("<2I", 3, 1)
    return out + struct.pack("<I", binascii.crc32(out))


def patched(offset: int, data: bytes) -> bytes:
    """The golden bytes with `data` at `offset` and a CRC that fits them."""
    body = golden()[:-4]
    body = body[:offset] + data + body[offset + len(data) :]
    return body + struct.pack("<I", binascii.crc32(body))


def test_golden_bytes():
    assert encode(a_frame()) == golden()
    assert HEADER.size == 64
    frame = decode(golden())
    assert (frame.stream, frame.seq, frame.rig_hash) == (0x01020304, 0x1122334455667788, 0xA1A2A3A4A5A6A7A8)
    assert (frame.report_id, frame.checked) == ("00deadbeef00ff01", True)
    assert (frame.capture_ns, frame.due_ns, frame.period_ns) == (1_000_000_007, 1_000_000_009, 20_000_000)
    assert (frame.state, frame.clock) == (State.PLAY, Clock.MONOTONIC)
    np.testing.assert_array_equal(frame.pos, POS)
    np.testing.assert_array_equal(frame.vel, VEL)
    np.testing.assert_array_equal(frame.root, ROOT)
    np.testing.assert_array_equal(frame.torque, [1.5, 2.5])
    np.testing.assert_array_equal(frame.contacts, [3, 1])


@given(
    joints=st.integers(1, 128),
    samples=st.integers(1, 256),
    torque=st.booleans(),
    state=st.sampled_from(State),
    clock=st.sampled_from(Clock),
    seed=st.integers(0, 99),
)
@settings(max_examples=30, deadline=None)
def test_round_trip(joints, samples, torque, state, clock, seed):
    rng = np.random.default_rng(seed)
    root = np.tile([0, 0, 1, 1, 0, 0, 0], (samples, 1)).astype(np.float32)
    before = a_frame(
        pos=rng.normal(size=(samples, joints)),
        vel=rng.normal(size=(samples, joints)),
        root=root,
        contacts=rng.integers(0, 2**32, samples, np.uint32),
        torque=rng.random(joints) if torque else None,
        state=state,
        clock=clock,
        report_id=UNCHECKED,
    )
    data = encode(before)
    after = decode(data)
    assert len(data) <= MAX_BYTES
    assert (after.state, after.clock, after.checked) == (state, clock, False)
    np.testing.assert_array_equal(after.pos, before.pos)
    np.testing.assert_array_equal(after.contacts, before.contacts)
    assert (after.torque is None) is not torque
    assert encode(after) == data


@given(bit=st.integers(0, 8 * len(golden()) - 1))
@settings(max_examples=300, deadline=None)
def test_any_flipped_bit_is_refused(bit):
    data = bytearray(golden())
    data[bit // 8] ^= 1 << bit % 8
    with pytest.raises(FrameError):
        decode(bytes(data))


@given(cut=st.integers(0, len(golden()) - 1))
@settings(deadline=None)
def test_truncated_is_refused(cut):
    with pytest.raises(FrameError, match=r"bytes|CRC"):
        decode(golden()[:cut])


@given(data=st.binary(max_size=400))
@settings(deadline=None)
def test_foreign_bytes_are_refused(data):
    with pytest.raises(FrameError):
        decode(data)


@pytest.mark.parametrize(
    ("offset", "data", "message"),
    [
        (0, b"RIGG", "magic"),
        (4, b"\x02", "version 2"),
        (5, b"\x04", "state 4"),
        (6, b"\x00", "clock 0"),
        (7, b"\x03", "flags"),
        (12, b"\x00\x00", "0 joints"),
        (12, b"\xff\xff", "65535 joints"),
        (14, b"\x00\x00", "0 samples"),
        (14, b"\xff\xff", "65535 samples"),
        (12, b"\x03\x00", "bytes instead of"),
        (56, bytes(8), "period_ns 0"),
        (64, struct.pack("<f", float("nan")), "pos"),
        (64, struct.pack("<f", float("inf")), "pos"),
        (80, struct.pack("<f", 1e30), "vel"),
        (96 + 12, struct.pack("<f", 0.5), "quaternion"),
        (96 + 56, struct.pack("<f", -1.0), "torque"),
    ],
)
def test_a_wrong_field_with_a_right_crc_is_refused(offset, data, message):
    with pytest.raises(FrameError, match=message) as caught:
        decode(patched(offset, data))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pos": np.zeros(2)}, r"pos \(2,\)"),
        ({"pos": np.zeros((2, 129))}, "129"),
        ({"vel": np.zeros((2, 3))}, r"vel \(2, 3\)"),
        ({"torque": np.zeros(3)}, r"torque \(3,\)"),
        ({"report_id": "00DEADBEEF00FF01"}, "report_id"),
        ({"seq": -1}, "64 bits"),
        ({"due_ns": 1 << 64}, "64 bits"),
        ({"stream": 1 << 32}, "32 bits"),
    ],
)
def test_a_wrong_frame_cannot_be_built(changes, message):
    with pytest.raises(FrameError, match=message):
        a_frame(**changes)


HELLO = Hello("small", 2**64 - 1, ("a",), (-1.0,), (1.0,), (3.0,), 30.0, 7, "0" * 16, "wave", "model", "CC BY-NC 4.0")
STATE = RigState("small", 5, "following", "", 9, 10, (0.5,), (0.1,), (30.0,), (12.0,))


@pytest.mark.parametrize("message", [HELLO, STATE, Stop("a hand in the way")])
def test_messages_round_trip(message):
    assert unpack(pack(message), type(message)) == message


def changed(message, **changes) -> bytes:
    fields = msgspec.msgpack.decode(pack(message))
    fields.update(changes)
    return msgspec.msgpack.encode(fields)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        golden(),
        pack(Stop("x")),
        pack(HELLO)[:-1],
        pack(HELLO) + b"\x00",
        changed(HELLO, type="rigcast.hello.2"),
        changed(HELLO, joints=["a", "b"]),
        changed(HELLO, lower=[float("nan")]),
        changed(HELLO, rig_hash=-1),
        changed(HELLO, rig_hash="1"),
        changed(HELLO, rate_hz=0.0),
        changed(HELLO, report_id="xyz"),
        changed(HELLO, rig="x" * 5000),
    ],
)
def test_foreign_messages_are_refused(data):
    with pytest.raises(FrameError, match="hello") as caught:
        unpack(data, Hello)
    assert "\n" not in str(caught.value)


def test_a_field_of_a_later_version_is_ignored():
    assert unpack(changed(HELLO, mood="cheerful"), Hello) == HELLO


def test_importing_any_part_loads_neither_torch_nor_mujoco():
    root = Path(__file__).parents[1]
    names = ["drivers", *(f"drivers.{p.stem}" for p in (root / "drivers").glob("*.py") if p.stem != "__init__")]
    code = f"import sys, {', '.join(names)}; print(*[m for m in ('torch', 'mujoco', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert len(names) > 10
    assert done.stdout.strip() == ""
