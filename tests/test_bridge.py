"""A stream in the forms of others, read as they read it."""

from __future__ import annotations

import json
from contextlib import ExitStack

import numpy as np
import pytest
import zmq
from small_rig import free_address, small_rig
from test_buffer import FakeReceiver
from test_stream import FakeClock

from drivers.endpoint import StreamError
from drivers.sonic import HEADER_BYTES
from rigcast.bridge import Moment, _sonic, line, run

RIG = small_rig()
# Where each of MuJoCo's joints is in Isaac Lab's order, as published with a BVH sender for the same controller.
PLACE_IN_ISAAC = [
    0,
    3,
    6,
    9,
    13,
    17,
    1,
    4,
    7,
    10,
    14,
    18,
    2,
    5,
    8,
    11,
    15,
    19,
    21,
    23,
    25,
    27,
    12,
    16,
    20,
    22,
    24,
    26,
    28,
]


def decoded(message: bytes) -> dict[str, np.ndarray]:
    """The fields of a message, as its readers take it apart: topic, header of 1280 bytes, fields in turn."""
    assert message[:4] == b"pose"
    header = json.loads(message[4 : 4 + HEADER_BYTES].rstrip(b"\0"))
    assert (header["v"], header["endian"], header["count"], HEADER_BYTES) == (1, "le", len(header["fields"]), 1280)
    at, found = 4 + HEADER_BYTES, {}
    for field in header["fields"]:
        kind = np.dtype({"f32": "<f4", "i64": "<i8"}[field["dtype"]])
        size = int(np.prod(field["shape"])) * kind.itemsize
        found[field["name"]] = np.frombuffer(message[at : at + size], kind).reshape(field["shape"])
        at += size
    assert at == len(message)
    return found


def test_a_bridge_tells_what_a_rig_would_do_and_nothing_while_there_is_nothing() -> None:
    clock = FakeClock()
    receiver, moments = FakeReceiver((0.4, 1.2)), []
    when = []

    def out(moment: Moment) -> None:
        moments.append(moment)
        when.append((clock.ns / 1e9 - 100) if moment.index else 0.0)

    told = run(receiver, [out], lambda: clock.ns > 102e9, clock)
    assert told == len(moments)
    assert [m.index for m in moments] == list(range(told))
    assert not [t for t in when if 0.75 < t < 1.15]  # it held
    expected = 0.2 + 0.2 * (1 - np.cos(2 * np.pi * np.array(when[1:15])))
    np.testing.assert_allclose([m.pos[0] for m in moments[1:15]], expected, atol=0.01)
    said = json.loads(json.dumps(line(moments[0], RIG)))
    assert (list(said["joints"]), len(said["root"]), said["seq"]) == (["a", "b", "c"], 7, moments[0].seq)


def test_sonic_messages_arrive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.sonic.require_g1", lambda rig: None)
    address = free_address()
    moment = Moment(5, 9, "0" * 16, np.zeros(29), np.zeros(29), np.array([0, 0, 0, 1.0, 0, 0, 0]))
    with ExitStack() as stack, zmq.Context() as context, context.socket(zmq.SUB) as ear:
        tell = _sonic(stack, address, RIG, insecure=False)
        ear.connect(address)
        ear.subscribe(b"pose")
        for _ in range(200):
            tell(moment)
            if ear.poll(50):
                break
        assert decoded(ear.recv())["frame_index"].tolist() == [5]
    with ExitStack() as stack, pytest.raises(StreamError, match="--insecure"):
        _sonic(stack, "tcp://*:5999", RIG, insecure=False)
