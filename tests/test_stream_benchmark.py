"""The stream's benchmark counts what it says it counts, and its gate names what falls short."""

import sys

import pytest
from stream import TARGETS, a_frame, damage, shortfalls, throughput

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


def test_no_damaged_frame_is_accepted_and_one_that_were_is_counted(monkeypatch):
    assert damage(300) == {"damaged_frames": 300, "wrong_frames": 0}
    monkeypatch.setattr("drivers.gate.decode", lambda data: a_frame(int.from_bytes(data[:2], "little"), 0, len(data)))
    assert damage(300)["wrong_frames"] > 0


def test_every_way_moves_messages():
    found = throughput(300, 1)
    assert min(found[f"{way}_per_cpu_s"] for way in ("bare", "ours", "curve")) > 0


def test_the_gate_names_what_falls_short():
    good = {"a": {name: target for name, (_, target) in TARGETS.items()}}
    assert shortfalls(good) == []
    assert shortfalls({"a": {**good["a"], "wrong_frames": 1}}) == ["wrong_frames is 1; the target is <= 0"]
    assert shortfalls({"a": {**good["a"], "throughput_ratio": 0.7}}) == [
        "throughput_ratio is 0.7; the target is >= 0.8"
    ]
