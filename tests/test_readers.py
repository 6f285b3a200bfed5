"""The C and the JavaScript reader of docs/readers read what we write, and refuse what is damaged."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from drivers.frame import Frame, State, encode

READERS = Path(__file__).parent.parent / "docs" / "readers"


def a_frame(torque: bool) -> Frame:
    rng = np.random.default_rng(5)
    count, joints = 3, 5
    root = np.tile([0.1, 0.2, 0.3, 1, 0, 0, 0], (count, 1))
    return Frame(
        stream=0xDEADBEEF,
        seq=(1 << 53) + 7,
        rig_hash=(1 << 64) - 3,
        report_id="0123456789abcdef",
        capture_ns=1_700_000_000_123_456_789,
        due_ns=1_700_000_000_123_456_790,
        period_ns=5_000_000,
        pos=rng.normal(0, 1, (count, joints)),
        vel=rng.normal(0, 1, (count, joints)),
        root=root,
        contacts=np.array([1, 2, 0xFFFFFFFF], np.uint32),
        torque=np.arange(joints) + 0.5 if torque else None,
        state=State.HOLD,
    )


def numbers(frame: Frame) -> list[float]:
    torque = [] if frame.torque is None else frame.torque.tolist()
    return [*frame.pos.ravel().tolist(), *frame.vel.ravel().tolist(), *frame.root.ravel().tolist(), *torque]


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    compiler = shutil.which("cc") or pytest.skip("no C compiler here")
    program = tmp_path_factory.mktemp("c") / "frame"
    strict = ["-std=c11", "-Wall", "-Wextra", "-Werror", "-O2"]
    subprocess.run([compiler, *strict, "-o", str(program), str(READERS / "frame.c")], check=True)
    return [str(program)]


@pytest.fixture(scope="module")
def in_node() -> list[str]:
    node = shutil.which("node") or pytest.skip("no node here")
    return [node, str(READERS / "frame.mjs")]


def read(command: list[str], data: bytes) -> str | None:
    run = subprocess.run(command, input=data, capture_output=True)
    assert (run.returncode, run.stderr) in ((0, b""), (1, b""))
    return run.stdout.decode() if run.returncode == 0 else None


@pytest.mark.parametrize("torque", [False, True])
def test_the_c_reader_reads_what_we_write(in_c: list[str], torque: bool) -> None:
    frame = a_frame(torque)
    head, values = (read(in_c, encode(frame)) or "").splitlines()
    assert [int(v) for v in head.split()] == [frame.stream, frame.seq, 2, 5, 3]
    *floats, c0, c1, c2 = map(float, values.split())
    assert [c0, c1, c2] == frame.contacts.tolist()
    np.testing.assert_array_equal(np.float32(floats), np.float32(numbers(frame)))


@pytest.mark.parametrize("torque", [False, True])
def test_the_javascript_reader_reads_what_we_write(in_node: list[str], torque: bool) -> None:
    frame = a_frame(torque)
    found = json.loads(read(in_node, encode(frame)) or "null")
    assert (found["stream"], int(found["seq"]), int(found["rigHash"])) == (frame.stream, frame.seq, frame.rig_hash)
    times = [int(found[k]) for k in ("captureNs", "dueNs", "periodNs")]
    assert times == [frame.capture_ns, frame.due_ns, frame.period_ns]
    assert (found["reportId"], found["state"], found["contacts"]) == (frame.report_id, 2, frame.contacts.tolist())
    np.testing.assert_array_equal([*found["pos"], *found["vel"], *found["root"], *found["torque"]], numbers(frame))


@pytest.mark.parametrize("reader", ["in_c", "in_node"])
def test_readers_refuse_what_is_damaged(reader: str, request: pytest.FixtureRequest) -> None:
    command, good = request.getfixturevalue(reader), encode(a_frame(False))
    for at in (0, 12, 70, len(good) - 1):
        assert read(command, good[:at] + bytes([good[at] ^ 0x41]) + good[at + 1 :]) is None
    assert read(command, good + b"\0") is None
    assert read(command, b"") is None
