"""`rigcast bridge` and `rigcast mirror` as the commands they are, with readers and senders of others at their ends."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import zmq
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message_builder import OscMessageBuilder
from small_rig import REPORT, free_address, swing
from test_bridge import decoded
from test_inbox import free_port

from drivers.frame import State
from drivers.publisher import Publisher
from drivers.receiver import Receiver
from drivers.samples import frames_of, hello_for
from drivers.sonic import ROBOT
from drivers.vmc import BONES, NEEDED
from retarget.menagerie import menagerie_file
from retarget.rig import Rig, load_rig
from rigcast.__main__ import main

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
LONG_S = 120.0


@contextmanager
def rigcast(*args: str) -> Iterator[subprocess.Popen[str]]:
    """The command, ended at the latest with the context."""
    command = [sys.executable, "-m", "rigcast", *args]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def again_and_again(do: Callable[[], None], seconds: float) -> Iterator[None]:
    """`do` each so many `seconds`, in a thread, while the context lasts."""
    over = threading.Event()

    def run() -> None:
        while not over.wait(seconds):
            do()

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextmanager
def streamed(rig: Rig, address: str) -> Iterator[None]:
    """A stream of `rig`, at its height, whose first joint swings."""
    move = swing(rig, 600.0)
    move.qpos[:, 2] = rig.nominal.height
    frames = frames_of(move, rig, REPORT, 1, time.monotonic_ns())
    with Publisher(hello_for(move, rig, REPORT, 1), address) as publisher:

        def send() -> None:
            for frame in frames:
                publisher.send(frame)
                if frame.due_ns > time.monotonic_ns():
                    return

        with again_and_again(send, 0.01):
            yield


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < end, "nothing came"


def test_a_bridge_tells_lines_and_bones() -> None:
    rig, address, port = load_rig("puppet"), free_address(), free_port()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ear, streamed(rig, address):
        ear.bind(("127.0.0.1", port))
        ear.settimeout(LONG_S)
        with rigcast("bridge", address, "--lines", "--vmc", f"127.0.0.1:{port}") as bridge:
            heard = [m for _ in range(2) for m in OscBundle(ear.recv(2000))]
            bones = {m.params[0]: m.params[1:] for m in heard if m.address == "/VMC/Ext/Bone/Pos"}
            assert bones.keys() == BONES.keys()
            assert bones["Hips"][1] > 0.5  # as high as a person's, though the puppet is half a metre tall
            assert np.linalg.norm(bones["LeftHand"][3:]) == pytest.approx(1)
            assert bridge.stdout is not None
            lines = [json.loads(bridge.stdout.readline()) for _ in range(4)]
            assert [line["index"] for line in lines] == [0, 1, 2, 3]
            assert (lines[0]["report_id"], list(lines[0]["joints"])) == (REPORT, list(rig.joint_names()))
            bridge.send_signal(signal.SIGINT)
            _, err = bridge.communicate(timeout=LONG_S)
    assert bridge.returncode == 0
    assert "moments told" in err


@pytest.mark.skipif(not menagerie_file("unitree_g1/g1.xml").is_absolute(), reason="no robot models: rigcast[robots]")
def test_a_bridge_tells_sonic_and_a_mirror_hears_it() -> None:
    source, between, address = (free_address() for _ in range(3))
    sonic = between.replace("tcp", "sonic")
    with (
        streamed(load_rig(ROBOT), source),
        rigcast("bridge", source, "--rig", ROBOT, "--sonic", between) as bridge,
        zmq.Context() as context,
        context.socket(zmq.SUB) as ear,
    ):
        ear.connect(between)
        ear.subscribe(b"pose")
        assert ear.poll(LONG_S * 1000)
        assert decoded(ear.recv())["joint_pos"].shape == (1, 29)
        with rigcast("mirror", sonic, address, "--rig", "puppet") as mirror:
            assert mirror.stderr is not None
            lines = [mirror.stderr.readline() for _ in range(2)]
            assert f"mirrors {sonic}" in lines[0]
            assert f"{between} is mirrored" in lines[1]
            mirror.send_signal(signal.SIGTERM)
            mirror.communicate(timeout=LONG_S)
            assert mirror.returncode == 0
        bridge.send_signal(signal.SIGTERM)
        assert bridge.wait(LONG_S) == 0


def spoken(bone: str, turn: tuple[float, float, float, float]) -> bytes:
    builder = OscMessageBuilder("/VMC/Ext/Bone/Pos")
    for value in (bone, 0.0, 1.0 if bone == "Hips" else 0.0, 0.0, *turn):
        builder.add_arg(value)
    return builder.build().dgram


def test_a_mirror_shows_what_a_performer_does_and_rests_without_one() -> None:
    rig, address, port = load_rig("puppet"), free_address(), free_port()
    down = float(np.sin(0.5))
    with (
        rigcast("mirror", f"vmc://:{port}", address) as mirror,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        Receiver(address, rig_hash=rig.hash) as receiver,
    ):
        assert mirror.stderr is not None
        assert f"puppet on {address} mirrors vmc://:{port}" in mirror.stderr.readline()
        rest = rig.pose_vector(rig.nominal)
        seen: list[State] = []
        away = [0.0]

        def look() -> None:
            time.sleep(0.005)
            if (frame := receiver.poll(time.monotonic_ns())) is not None:
                seen.append(frame.state)
                assert frame.checked
                away.append(float(np.abs(frame.pos[0] - rest).max()))

        def show() -> None:
            for bone in NEEDED:
                turn = (0.0, 0.0, down, np.cos(0.5)) if bone == "LeftUpperArm" else (0.0, 0.0, 0.0, 1.0)
                mouth.sendto(spoken(bone, turn), ("127.0.0.1", port))
            stranger.sendto(b"hello", ("127.0.0.1", port))

        until(lambda: look() or seen)
        assert set(seen) == {State.HOLD}  # there is nobody yet
        with again_and_again(show, 1 / 30):
            until(lambda: look() or max(away) > 0.05)
        seen.clear()
        until(lambda: look() or (len(seen) > 2 and seen[-1] == State.HOLD))
        assert away[-1] < 1e-6
        mirror.send_signal(signal.SIGTERM)
        out, err = mirror.communicate(timeout=LONG_S)
    assert mirror.returncode == 0
    assert "is mirrored" in err
    assert "is not heard" in err
    assert "to rest" in err  # for nobody is there, or the machine is too busy
    assert "frames" in out
    assert "poses" in out


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["bridge"], "bridge to whom?"),
        (["bridge", "--sonic", "tcp://127.0.0.1:5999"], "unitree_g1"),
        (["bridge", "--vmc", "39539"], "'39539': give HOST:PORT"),
        (["bridge", "--vmc", "127.0.0.1:0"], "give HOST:PORT"),
        (["mirror", "vmc://*:39539"], "--sender IP, or --insecure"),
        (["mirror", "vmc://:0", "tcp://*:7755"], "no key in"),
        (["mirror", "vmc://:0", "--mount", "free"], "on a stand, not free"),
        (["mirror", "tcp://127.0.0.1:5555"], "source 'tcp://127.0.0.1:5555': give vmc://:39539"),
    ],
)
def test_mistakes_are_one_line(
    args: list[str],
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: object,
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert main(args) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
