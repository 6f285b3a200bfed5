"""Recordings: whole to the last record before a kill, refused where damaged, and the same motion again."""

import signal
import struct
import subprocess
import sys
import threading
import time
import zlib
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from small_rig import REPORT, free_address, small_rig, swing

from drivers.endpoint import StreamError
from drivers.frame import Frame, State, decode, encode
from drivers.listen import listen
from drivers.messages import Stop, pack
from drivers.publisher import Publisher, frames_of, hello_for, publish
from drivers.receiver import Receiver
from drivers.recorded import hello_in, trajectory_in
from drivers.recording import Channel, Record, Recorder, Recording
from drivers.replay import replay
from rigcast.__main__ import main
from rigcast.view import recorded

RIG = small_rig()
MS = 1_000_000
S = 1000 * MS
ROOT = Path(__file__).parents[1]


def frames(seconds: float = 1.0, stream: int = 7) -> list[Frame]:
    return list(frames_of(swing(RIG, seconds), RIG, REPORT, stream, 50 * S))


def some_records(delay_ns: int = 1000 * S + 2 * MS) -> list[Record]:
    """A hello and a second of frames, which come `delay_ns` after what their sender's clock says."""
    hello = pack(
        msgspec.structs.replace(hello_for(swing(RIG), RIG, REPORT, 7), text="swing", source="test", licence="CC0")
    )
    return [
        Record(Channel.HELLO, 50 * S + delay_ns, hello),
        *(Record(Channel.FRAMES, f.capture_ns + delay_ns, encode(f)) for f in frames()),
    ]


def write(path: Path, records: list[Record]) -> Path:
    with Recorder(path) as out:
        for record in records:
            out.write(record)
    return path


# --- the file


def test_the_file_is_as_the_docs_say(tmp_path):
    path = write(tmp_path / "a.rigrec", [Record(Channel.STOP, 0x0102030405060708, b"abc")])
    data = path.read_bytes()
    utc, monotonic = struct.unpack("<QQ", data[8:24])
    assert data[:8] == b"RIGREC\x01\x00"
    assert abs(utc - time.time_ns()) < 600 * S
    assert 0 <= time.monotonic_ns() - monotonic < 600 * S
    record = bytes.fromhex("03000000 02 0807060504030201") + b"abc"
    assert data[24:] == record + struct.pack("<I", zlib.crc32(record))
    assert (Recording(path).utc_ns, Recording(path).monotonic_ns) == (utc, monotonic)


def test_what_was_written_is_read_again_whatever_it_is(tmp_path):
    records = [*some_records(), Record(Channel.STOP, 0, b""), Record(Channel.FRAMES, 2**64 - 1, bytes(range(256)))]
    recording = Recording(write(tmp_path / "a.rigrec", records))
    assert list(recording) == records
    assert list(recording) == records  # as often as you like
    assert recording.lost == 0


def test_a_file_that_is_there_is_left_alone(tmp_path):
    path = write(tmp_path / "a.rigrec", some_records())
    before = path.read_bytes()
    with pytest.raises(FileExistsError):
        Recorder(path)
    assert path.read_bytes() == before


def test_cut_at_every_byte_the_records_before_are_whole(tmp_path):
    records = [Record(Channel.HELLO, 5, b"hello you"), Record(Channel.FRAMES, 6, b""), Record(Channel.STOP, 7, b"stop")]
    path = write(tmp_path / "a.rigrec", records)
    data = path.read_bytes()
    ends = [24, 24 + 26, 24 + 26 + 17, len(data)]
    for length in range(len(data)):
        path.write_bytes(data[:length])
        if length < 24:
            with pytest.raises(StreamError, match=r"a\.rigrec: not a recording"):
                Recording(path)
            continue
        whole = sum(end <= length for end in ends[1:])
        recording = Recording(path)
        assert list(recording) == records[:whole]
        assert recording.lost == length - ends[whole]


def test_any_flipped_bit_ends_the_reading_before_it(tmp_path):
    records = [Record(Channel.HELLO, 5, b"hello you"), Record(Channel.STOP, 7, b"stop")]
    path = write(tmp_path / "a.rigrec", records)
    data = path.read_bytes()
    for bit in range(24 * 8, len(data) * 8):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        recording = Recording(path)
        assert list(recording) == records[: int(bit // 8 >= 24 + 26)]
        assert recording.lost > 0


def test_a_length_of_four_gigabytes_is_not_believed(tmp_path):
    path = write(tmp_path / "a.rigrec", [])
    path.write_bytes(path.read_bytes() + struct.pack("<IBQ", 2**32 - 1, 0, 0) + b"x" * 100)
    recording = Recording(path)
    assert (list(recording), recording.lost) == ([], 113)


CHILD = """
import sys
from pathlib import Path
from drivers.recording import Channel, Record, Recorder
with Recorder(Path(sys.argv[1])) as out:
    k = 0
    while True:
        out.write(Record(Channel.FRAMES, k, bytes([k % 256]) * (k % 700)))
        k += 1
"""


@pytest.mark.skipif(sys.platform == "win32", reason="kills as POSIX does")
def test_a_killed_recorder_leaves_whole_records(tmp_path):
    path = tmp_path / "a.rigrec"
    with subprocess.Popen([sys.executable, "-c", CHILD, str(path)], cwd=ROOT) as child:
        end = time.monotonic() + 60
        while not path.exists() or path.stat().st_size < 50_000:
            assert time.monotonic() < end
            time.sleep(0.01)
        child.send_signal(signal.SIGKILL)
    records = list(Recording(path))
    assert len(records) > 100
    assert records == [Record(Channel.FRAMES, k, bytes([k % 256]) * (k % 700)) for k in range(len(records))]


# --- what it shows


def test_the_trajectory_is_the_one_that_was_streamed():
    found = trajectory_in(some_records(), RIG)
    before = swing(RIG)
    assert (found.fps, found.joints, len(found)) == (50.0, before.joints, len(before))
    np.testing.assert_allclose(found.qpos, before.qpos, atol=1e-6)
    assert [label.text for label in found.labels] == ["swing"]
    assert (found.source.generator, found.source.licence) == ("test", "CC0")


def test_lost_frames_are_filled_in_and_damaged_old_and_double_ones_left_out():
    hello, *rest = some_records()
    lossy = [r for k, r in enumerate(rest) if k % 5 != 3]
    bad = [Record(Channel.FRAMES, rest[20].time_ns, rest[20].data[:-1] + b"\x00"), rest[2], rest[10]]
    found = trajectory_in([hello, *lossy[:20], *bad, *lossy[20:]], RIG)
    np.testing.assert_allclose(found.qpos, swing(RIG).qpos, atol=0.01)  # the chord of 40 ms of this swing: 0.0016


def test_blocks_that_look_ahead_make_the_same_trajectory():
    hello, *_ = some_records()
    one = [f for f in frames() if f.state == State.PLAY]

    def block(k: int) -> Frame:
        ahead = [one[min(j, len(one) - 1)] for j in range(k, k + 4)]
        columns = ("pos", "vel", "root", "contacts")
        return replace(one[k], **{c: np.concatenate([getattr(f, c) for f in ahead]) for c in columns})

    blocks = [Record(Channel.FRAMES, one[k].capture_ns, encode(block(k))) for k in range(0, len(one) - 3, 2)]
    found = trajectory_in([hello, *blocks], RIG)
    np.testing.assert_allclose(found.qpos[:48], swing(RIG).qpos[:48], atol=1e-6)


def test_quaternions_of_either_sign_turn_the_same_way():
    hello, *rest = some_records()
    turned = []
    for k, record in enumerate(rest):
        frame = decode(record.data)
        half = 0.01 * k
        root = np.array([[0, 0, 0, np.cos(half), 0, 0, np.sin(half)]]) * (1, 1, 1, *[(-1) ** k] * 4)
        turned.append(replace(record, data=encode(replace(frame, root=root))))
    found = trajectory_in([hello, *turned], RIG)
    yaw = 2 * np.unwrap(np.arctan2(found.qpos[:, 6], found.qpos[:, 3]))
    np.testing.assert_allclose(np.diff(yaw), 0.02, atol=1e-5)


def test_no_hello_no_frame_or_another_rig_is_one_line():
    hello, *rest = some_records()
    with pytest.raises(StreamError, match="no hello"):
        trajectory_in(rest, RIG)
    with pytest.raises(StreamError, match=r"no frame for rig 'small'$"):
        trajectory_in([hello], RIG)
    other = replace(RIG, joints=(*RIG.joints[:2], replace(RIG.joints[2], upper=1.4)))
    with pytest.raises(StreamError, match=rf"no frame for rig 'small': .*{RIG.hash:016x}.*{other.hash:016x}"):
        trajectory_in([hello, *rest], other)
    still = [replace(r, data=encode(replace(decode(r.data), state=State.HOLD))) for r in rest]
    with pytest.raises(StreamError, match="says play"):
        trajectory_in([hello, *still], RIG)


def test_the_view_shows_each_pose_at_its_time_and_starts_over(tmp_path):
    path, now = write(tmp_path / "a.rigrec", some_records()), [0]
    poses = recorded(path, RIG, lambda: now[0])
    for at in (0.0, 0.1, 0.5, 0.99, 1.06 + 1.0 + 0.1):
        now[0] = int(at * S)
        expected = swing(RIG).qpos[int(at * 50 + 1e-9) if at < 2 else 5, 7:]
        np.testing.assert_allclose(poses()[2], expected, atol=1e-6)


# --- from the wire and back to it


def test_a_stream_is_recorded_and_replayed(tmp_path):
    address, path, stop = free_address(), tmp_path / "a.rigrec", threading.Event()

    def work():
        with Recorder(path) as out:
            for record in listen(address, stop.is_set, lambda trouble: None):
                out.write(record)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        sent = publish(swing(RIG, 0.6), RIG, REPORT, address, wait_s=20)
    finally:
        time.sleep(0.3)
        stop.set()
        thread.join()
    recording = Recording(path)
    came = [decode(r.data) for r in recording if r.channel == Channel.FRAMES]
    assert [f.seq for f in came] == list(range(came[0].seq, sent.frames))  # all from the first on
    assert len(came) > 20
    assert hello_in(recording).rig == "small"

    with Publisher(hello_in(recording), address) as publisher, Receiver(address, rig_hash=RIG.hash) as receiver:
        seen, done = [], []
        thread = threading.Thread(target=lambda: done.append(replay(recording, publisher, 20.0)))
        thread.start()
        while thread.is_alive():
            if (frame := receiver.poll(time.monotonic_ns())) is not None:
                seen.append(frame)
            time.sleep(0.001)
    [result] = done
    assert (result.frames, result.stops, result.left_out, result.heard) == (len(came), 0, 0, True)
    assert len(seen) > 5
    by_seq = {f.seq: f for f in came}
    for frame in seen:
        np.testing.assert_array_equal(frame.pos, by_seq[frame.seq].pos)
    assert len({f.stream for f in seen}) == 1
    assert seen[0].stream != came[0].stream
    assert receiver.gate.refused["stale"] <= len(came) // 4  # made now, not then


class FakeClock:
    """Time that passes only where somebody sleeps."""

    def __init__(self) -> None:
        self.ns = 7 * S

    def now_ns(self) -> int:
        return self.ns

    def sleep_until_ns(self, when_ns: int) -> None:
        self.ns = max(self.ns, when_ns)


class Ear:
    """Stands in for a Publisher; notes what is sent, and when."""

    def __init__(self, clock: FakeClock) -> None:
        self.clock, self.sent, self.stopped, self.ticks = clock, [], [], 0

    def wait_for_subscriber(self, timeout_s: float) -> bool:
        return False

    def send(self, frame: Frame) -> None:
        self.sent.append((self.clock.ns, frame))

    def tick(self) -> None:
        self.ticks += 1

    def stop(self, reason: str) -> None:
        self.stopped.append((self.clock.ns, reason))

    def states(self) -> list:
        return []

    def ended(self) -> str:
        return ""


def test_a_replay_keeps_the_times_the_gaps_and_the_stop_and_leaves_out_damage():
    hello, *rest = some_records()
    late = [replace(r, time_ns=r.time_ns + (200 * MS if k == 10 else 0)) for k, r in enumerate(rest)]
    second = [Record(Channel.FRAMES, rest[-1].time_ns + 5 * S, encode(replace(decode(rest[0].data), stream=8)))]
    stop = Record(Channel.STOP, second[0].time_ns + S, pack(Stop("enough")))
    wrong = [Record(Channel.FRAMES, late[3].time_ns, b"RIGF"), Record(Channel.STOP, late[3].time_ns, b"")]
    clock = FakeClock()
    ear = Ear(clock)
    done = replay([hello, *late[:3], *wrong, *late[4:], *second, stop], ear, clock=clock)
    assert (done.frames, done.stops, done.left_out) == (len(rest), 1, 2)
    first = hello.time_ns
    kept = [*late[:3], *late[4:]]
    for (at, frame), record in zip(ear.sent[:-1], kept, strict=True):
        assert at >= 7 * S + record.time_ns - first  # and never before
        assert (frame.capture_ns, frame.seq) == (7 * S + record.time_ns - first, decode(record.data).seq)
    assert len({frame.stream for _, frame in ear.sent}) == 2
    assert not {frame.stream for _, frame in ear.sent} & {7, 8}
    assert ear.stopped == [(7 * S + stop.time_ns - first, "enough")]
    assert ear.ticks >= 8  # the hello goes on in the silence between


# --- MCAP, read by its own library


def test_mcap_holds_the_joints_by_name_the_root_and_the_damage(tmp_path):
    pytest.importorskip("mcap", reason="needs the mcap package")
    from mcap.reader import make_reader

    from drivers.mcap import McapRecorder

    path = tmp_path / "a.mcap"
    records = [*some_records(), Record(Channel.FRAMES, 3, b"junk"), Record(Channel.STOP, 4, pack(Stop("enough")))]
    with McapRecorder(path, utc_ns=1_700_000_000 * S, monotonic_ns=0) as out:
        for record in records:
            out.write(record)
    with open(path, "rb") as file:
        said = [(s.name, c.topic, m, msgspec.json.decode(m.data)) for s, c, m in make_reader(file).iter_messages()]
    joints = [(m, what) for name, _, m, what in said if name == "rigcast.Joints"]
    assert len(joints) == len(frames())
    for (message, what), frame in zip(joints, frames(), strict=True):
        assert message.log_time == 1_700_000_000 * S + frame.capture_ns + 1000 * S + 2 * MS
        assert [j["name"] for j in what["joints"]] == ["a", "b", "c"]
        np.testing.assert_allclose([j["position"] for j in what["joints"]], frame.pos[0], rtol=1e-6)
    [*_, root] = [what for name, *_, what in said if name == "foxglove.PoseInFrame"]
    assert root["pose"]["orientation"] == {"x": 0, "y": 0, "z": 0, "w": 1}
    assert [what["bytes"] for name, *_, what in said if name == "rigcast.Damaged"] == [4]
    assert [what["reason"] for _, topic, _, what in said if topic == "/stop"] == ["enough"]
    assert [what["text"] for _, topic, _, what in said if topic == "/hello"] == ["swing"]


# --- the verbs


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["record", "a.docx"], "a.docx: unknown suffix; a recording is .rigrec or .mcap"),
        (["record", "there.rigrec"], "there.rigrec: File exists"),
        (["replay", "none.rigrec", "--publish", "ipc://x"], "none.rigrec: No such file"),
        (["replay", "there.rigrec"], "say --publish ENDPOINT or --out FILE.mcap"),
        (["replay", "there.rigrec", "--publish", "ipc://x"], "no hello"),
        (["replay", "junk.rigrec", "--out", "b.mcap"], "junk.rigrec: not a recording"),
        (["view", "junk.rigrec"], "junk.rigrec: not a recording"),
        (["view", "there.rigrec"], "no frame for rig 'puppet'"),
        (["play", "there.rigrec"], "no hello"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(args, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "there.rigrec", [])
    (tmp_path / "junk.rigrec").write_bytes(b"hello" * 20)
    assert main(args) == 2
    said = capsys.readouterr().err
    assert said.startswith("rigcast: ")
    assert said.count("\n") == 1
    assert words in said


def test_nothing_on_the_wire_is_exit_1(tmp_path, capsys):
    path = tmp_path / "a.rigrec"
    assert main(["record", str(path), "--endpoint", free_address(), "--seconds", "0.3"]) == 1
    assert "nothing came" in capsys.readouterr().out
    assert list(Recording(path)) == []
