"""The command line, mostly in this process: exit codes, one line for each mistake, and what lands where."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from motions import stand

from drivers.frame import UNCHECKED, Frame
from drivers.publisher import publish
from drivers.receiver import Receiver
from motiongen.files import load_motion, save_motion
from motiongen.generator import Familiarity, PromptError
from motiongen.motion import Label, Motion, Source
from retarget.files import load_trajectory, save_trajectory
from retarget.rig import load_rig
from retarget.trajectory import Trajectory
from rigcast.__main__ import VERBS, main
from rigcast.demo import play_on_emulated_bus
from rigcast.listing import failsafe
from rigcast.view import pose_due

ROOT = Path(__file__).parent.parent
WEIGHTS = ROOT / "motiongen" / "weights" / "mdm.safetensors"


def still(seconds: float = 0.4, fps: float = 50.0) -> Trajectory:
    """The puppet in its nominal pose on its stand, nodding a little: the gate lets it pass."""
    rig = load_rig("puppet")
    frames = round(seconds * fps) + 1
    qpos = np.zeros((frames, 7 + len(rig.joints)))
    qpos[:, 2] = rig.nominal.height + rig.stand_clearance
    qpos[:, 3] = 1
    qpos[:, 7:] = rig.pose_vector(rig.nominal)
    qpos[:, 7 + rig.joint_names().index("head_pan")] += 0.05 * np.sin(np.linspace(0, np.pi, frames))
    return Trajectory(qpos, fps, "puppet", rig.joint_names(), labels=(Label(0, seconds, "nod"),), source=Source("test"))


def thrashing() -> Trajectory:
    """From limit to limit in one frame: no servo follows that."""
    calm = still()
    limits = np.array([(j.lower, j.upper) for j in load_rig("puppet").joints])
    qpos = calm.qpos.copy()
    qpos[:, 7:] = limits[:, 0]
    qpos[::2, 7:] = limits[:, 1]
    return replace(calm, qpos=qpos)


@pytest.fixture
def calm(tmp_path: Path) -> Path:
    save_trajectory(still(), tmp_path / "calm.npz")
    return tmp_path / "calm.npz"


@pytest.fixture
def wild(tmp_path: Path) -> Path:
    save_trajectory(thrashing(), tmp_path / "wild.npz")
    return tmp_path / "wild.npz"


class FakeGenerator:
    """Knows standing; everything else is strange to it."""

    name, licence = "fake", "CC0"

    def familiarity(self, text: str) -> Familiarity:
        return Familiarity("stand" in text, 0.9, ("stand", "sit"))

    def generate(self, text: str, *, seconds: float | None, seed: int, guidance: float | None) -> Motion:
        motion = stand(seconds or 1.0)
        return replace(
            motion, source=Source(self.name, seed=seed, licence=self.licence), labels=(Label(0, motion.duration, text),)
        )


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigcast.say.load_generator", lambda name: FakeGenerator())


def free_endpoint() -> str:
    """A TCP endpoint whose five ports are free just now."""
    for _ in range(50):
        with socket.socket() as first:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
        try:
            rest = [socket.create_server(("127.0.0.1", port + k)) for k in range(5)]
        except OSError:
            continue
        for each in rest:
            each.close()
        return f"tcp://127.0.0.1:{port}"
    raise RuntimeError("no five free ports in a row")


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What was said on stderr, which must be one line of ours."""
    said = capsys.readouterr().err
    assert said.startswith("rigcast: ")
    assert said.count("\n") == 1
    return said


# ---- Help and mistakes


def test_overview_lists_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    said = capsys.readouterr().out
    assert all(f"  {verb} " in said for verb in VERBS)
    assert main([]) == 2


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*verb.split(), "--help"])
    assert ended.value.code == 0
    assert f"usage: rigcast {verb}" in capsys.readouterr().out


def test_it_runs_as_a_module_and_tells_its_version() -> None:
    run = subprocess.run([sys.executable, "-m", "rigcast", "--version"], capture_output=True, text=True, cwd=ROOT)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.count(".") == 2


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["sing"], "unknown verb 'sing'; there are say, edit, play"),
        (["bus", "fly"], "unknown verb 'bus fly'"),
        (["say", ""], "the text is empty"),
        (["say", "  \n "], "the text is empty"),
        (["say", "x" * 10_000], "10000 characters"),
        (["say", "wave", "--seconds", "-1"], "-1"),
        (["say", "wave", "--rig", "nobody"], "no rig 'nobody'; known are"),
        (["say", "wave", "--generator", "nobody"], "no generator 'nobody'; there are mdm"),
        (["say", "wave", "--out", "wave.docx"], "unknown suffix; known are"),
        (["say", "wave", "--out", ".npz"], "unknown suffix; known are"),
        (["say", "wave", "--out", "nowhere/wave.npz"], "no folder nowhere"),
        (["say", "wave", "--out", "a.npz", "--out", "./a.npz"], "given twice"),
        (["say", "wave", "--publish", "udp://x"], "endpoint 'udp://x'"),
        (["play", "none.bvh"], "none.bvh: No such file"),
        (["play", "none.npz"], "none.npz: No such file"),
        (["check", "notes.txt"], "notes.txt: cannot read .txt; known are"),
        (["drive", "--port", "/dev/not-there", "--endpoint", "tcp://127.0.0.1:47001"], "/dev/not-there"),
        (["view", "nonsense"], "endpoint 'nonsense'"),
        (["bus", "emulate", "--rig", "nobody"], "no rig 'nobody'"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(
    args: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("hello")
    assert main(args) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("rigcast: ")
    assert words in said
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


def test_a_wrong_option_is_named_and_exit_2(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["say", "wave", "--view", "cinema"])
    assert ended.value.code == 2
    said = capsys.readouterr()
    assert "cinema" in said.err + said.out
    assert "native" in said.err + said.out


BVH = "HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "not a BVH file"),
        (BVH, "not a BVH file"),
        (BVH + "MOTION\nFrames: 0\nFrame Time: 0.1\n", "0 frames"),
        (BVH + "MOTION\nFrames: 1\nFrame Time: 0\n0 0 0\n", "frame time 0"),
        (BVH + "MOTION\nFrames: 2\nFrame Time: 0.1\n0 0 0\n", "3 values"),
        (BVH + "MOTION\nFrames: 1\nFrame Time: 0.1\n0 nan 0\n", "NaN"),
        (BVH + "MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n", "unknown skeleton"),
    ],
)
def test_a_bad_bvh_is_one_line_and_exit_2(
    content: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "x.bvh").write_text(content)
    assert main(["play", str(tmp_path / "x.bvh")]) == 2
    assert words in one_line(capsys)


def test_a_folder_that_cannot_be_written_is_found_first(
    calm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)  # root may write anywhere
    assert main(["play", str(calm), "--out", str(tmp_path / "b.csv")]) == 2
    assert "not writable" in one_line(capsys)


@pytest.mark.parametrize(("module", "extra"), [("mujoco", "sim"), ("scipy", "sim")])
def test_a_missing_extra_is_named(
    module: str, extra: str, calm: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(*_: object, **__: object) -> None:
        raise ModuleNotFoundError(f"No module named '{module}.core'", name=f"{module}.core")

    monkeypatch.setattr("rigcast.pipeline.take", missing)
    assert main(["check", str(calm)]) == 2
    assert f'pip install "rigcast[{extra}]"' in one_line(capsys)


# ---- check and play


def test_check_passes_fails_and_tells_why(calm: Path, wild: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(calm)]) == 0
    assert "pass" in capsys.readouterr().out
    assert main(["check", str(wild), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)["report"]
    assert report["ok"] is False
    assert any(not c["ok"] and c["advice"] for c in report["checks"])


def test_what_fails_is_neither_written_nor_streamed(
    wild: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", str(wild), "--out", str(tmp_path / "w.csv"), "--publish", free_endpoint()]) == 1
    assert "--unchecked" in one_line(capsys)
    assert not (tmp_path / "w.csv").exists()
    assert main(["play", str(wild), "--out", str(tmp_path / "w.csv"), "--unchecked"]) == 0
    assert (tmp_path / "w.csv").exists()


def test_a_trajectory_has_no_human_motion_to_write(
    calm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", str(calm), "--out", str(tmp_path / "m.bvh")]) == 2
    assert "human motion" in one_line(capsys)


def test_a_trajectory_of_another_rig_is_refused(calm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_trajectory(replace(still(), rig="somebody"), calm)
    assert main(["check", str(calm)]) == 2
    assert "no rig 'somebody'" in one_line(capsys)
    assert main(["check", str(calm), "--rig", "puppet"]) == 2
    assert "somebody" in one_line(capsys)


def test_a_picture_is_written(calm: Path, tmp_path: Path) -> None:
    assert main(["play", str(calm), "--out", str(tmp_path / "p.png")]) == 0
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")


# ---- say


def test_say_writes_each_form(fake: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ("a.npz", "a.motion.npz", "a.bvh", "a.csv", "a.json")
    outs = [word for name in names for word in ("--out", str(tmp_path / name))]
    assert main(["say", "stand still", "--seed", "5", "--json", "--unchecked", *outs]) == 0
    told = json.loads(capsys.readouterr().out)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)
    assert (told["text"], told["known"], told["source"]["seed"]) == ("stand still", True, 5)
    assert {"generate", "retarget", "check", "write .bvh"} <= told["seconds"].keys()
    trajectory = load_trajectory(tmp_path / "a.npz")
    assert (trajectory.rig, len(trajectory), trajectory.source.licence) == ("puppet", told["frames"], "CC0")
    assert load_motion(tmp_path / "a.motion.npz").labels[0].text == "stand still"
    assert json.loads((tmp_path / "a.json").read_text())["report_id"] == told["report"]["report_id"]


def test_an_unfamiliar_text_warns_and_strict_refuses(fake: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["say", "solve a cubic equation", "--strict"]) == 1
    assert "nearest: stand, sit" in one_line(capsys)
    main(["say", "solve a cubic equation", "--unchecked"])
    assert "nearest: stand, sit" in capsys.readouterr().err


def test_say_prints_the_licence(fake: None, capsys: pytest.CaptureFixture[str]) -> None:
    main(["say", "stand", "--unchecked"])
    assert "licence: CC0" in capsys.readouterr().out


def test_play_takes_motion_from_both_kinds_of_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_motion(stand(), tmp_path / "m.npz")
    assert main(["play", str(tmp_path / "m.npz"), "--unchecked", "--out", str(tmp_path / "m.bvh")]) == 0
    assert main(["play", str(tmp_path / "m.bvh"), "--unchecked", "--out", str(tmp_path / "t.csv")]) == 0
    assert (tmp_path / "t.csv").read_text().startswith("time_s,root_x_m")


@pytest.mark.skipif(not WEIGHTS.exists(), reason="the generator's weights are not in this checkout")
def test_say_generates_for_real(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    args = ["say", "wave with the right hand", "--seconds", "2", "--seed", "1", "--unchecked", "--json"]
    assert main([*args, "--out", str(tmp_path / "a.npz")]) == 0
    assert "CC BY-NC" in json.loads(capsys.readouterr().out)["source"]["licence"]
    assert main([*args, "--out", str(tmp_path / "b.npz")]) == 0
    np.testing.assert_array_equal(load_trajectory(tmp_path / "a.npz").qpos, load_trajectory(tmp_path / "b.npz").qpos)


# ---- The wire


@pytest.mark.parametrize("unchecked", [False, True])
def test_frames_carry_the_report_unless_unchecked(
    unchecked: bool, calm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    endpoint = free_endpoint()
    ids: set[str] = set()
    ended = threading.Event()

    def listen() -> None:
        with Receiver(endpoint, rig_hash=load_rig("puppet").hash, preview=True) as receiver:
            while not ended.is_set():
                if (frame := receiver.poll(time.monotonic_ns())) is not None:
                    ids.add(frame.report_id)
                time.sleep(0.002)

    listener = threading.Thread(target=listen)
    listener.start()
    try:
        assert main(["play", str(calm), "--publish", endpoint, "--json", *["--unchecked"] * unchecked]) == 0
    finally:
        ended.set()
        listener.join()
    told = json.loads(capsys.readouterr().out)
    assert told["published"]["heard"]
    assert ids == {UNCHECKED if unchecked else told["report"]["report_id"]}


def test_a_busy_port_is_one_line(calm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        assert main(["play", str(calm), "--publish", f"tcp://127.0.0.1:{taken.getsockname()[1]}"]) == 2
    assert "busy" in one_line(capsys)


def stream_soon(endpoint: str, report_id: str) -> threading.Thread:
    thread = threading.Thread(
        target=publish, args=(still(), load_rig("puppet"), report_id, endpoint), kwargs={"wait_s": 10.0}
    )
    thread.start()
    return thread


def test_drive_follows_a_checked_stream(capsys: pytest.CaptureFixture[str]) -> None:
    endpoint = free_endpoint()
    thread = stream_soon(endpoint, "1234567890abcdef")
    assert main(["drive", "--port", "sim", "--endpoint", endpoint, "--json"]) == 0
    thread.join()
    told = json.loads(capsys.readouterr().out)
    assert told["mode"] == "safe"
    assert told["followed"] > 0
    assert max(told["rms_error"]) < 0.1


def test_view_films_what_is_on_the_wire(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    thread = stream_soon(endpoint, UNCHECKED)
    assert main(["view", endpoint, "--film", str(tmp_path / "f.gif"), "--seconds", "0.6"]) == 0
    thread.join()
    assert (tmp_path / "f.gif").read_bytes().startswith(b"GIF8")


def test_view_without_a_stream_is_exit_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["view", free_endpoint(), "--film", str(tmp_path / "f.gif"), "--seconds", "0.1"]) == 1
    assert "no frame" in one_line(capsys)
    assert not (tmp_path / "f.gif").exists()


def test_a_frame_of_several_samples_shows_the_one_that_is_due() -> None:
    pos = np.arange(6.0).reshape(3, 2)
    frame = Frame(
        stream=1,
        seq=0,
        rig_hash=2,
        report_id=UNCHECKED,
        capture_ns=1000,
        due_ns=1000,
        period_ns=100,
        pos=pos,
        vel=0 * pos,
        root=np.tile([0, 0, 1, 1, 0, 0, 0], (3, 1)),
        contacts=np.zeros(3),
    )
    shown = [pose_due(frame, now)[2][0] for now in (0, 1000, 1099, 1100, 1250, 9999)]
    assert shown == [0, 0, 0, 2, 4, 4]


def test_the_page_says_what_the_command_would(fake: None, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: dict[str, Any] = {}
    monkeypatch.setattr("sim.play_web.play_web", lambda preview, **how: shown.update(how, first=preview))
    assert main(["say", "stand still", "--rig", "humanoid", "--mount", "stand", "--seconds", "2", "--view", "web"]) == 0
    assert (shown["first"].title, shown["unchecked"], shown["port"]) == ("stand still", False, 8080)
    told: list[str] = []
    second = shown["say"]("  fly   away ", 7, told.append)
    assert (second.title, second.rig.name, second.mount) == ("fly away", "humanoid", "stand")
    assert second.origin == "from fake, seed 7; licence: CC0"
    assert "is far from what mdm was trained on; nearest: stand, sit" in told[0]
    with pytest.raises(PromptError, match="the text is empty"):
        shown["say"](" ", 7, told.append)


def test_strict_holds_on_the_page_too(fake: None, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: dict[str, Any] = {}
    monkeypatch.setattr("sim.play_web.play_web", lambda preview, **how: shown.update(how))
    assert main(["say", "stand still", "--strict", "--view", "web"]) == 0
    with pytest.raises(PromptError, match="'fly' is far from what mdm was trained on"):
        shown["say"]("fly", 0, print)


def test_a_file_is_shown_without_a_line_to_type(calm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: dict[str, Any] = {}
    monkeypatch.setattr("sim.play_web.play_web", lambda preview, **how: shown.update(how, first=preview))
    assert main(["play", str(calm), "--view", "web", "--port", "8123"]) == 0
    assert (shown["first"].title, shown["say"], shown["port"]) == ("nod", None, 8123)


@pytest.mark.skipif(sys.platform != "linux", reason="displays are an X11 and Wayland matter")
def test_what_cannot_be_shown_is_said_before_any_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rigcast.say.load_generator", lambda name: pytest.fail("it was begun"))
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert main(["say", "stand", "--view", "native"]) == 2
    said = one_line(capsys)
    assert "no display" in said
    assert said.strip().endswith("use --view web, or write a film with --out FILE.mp4 or .gif")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["say", "stand", "--view", "web", "--port", str(port)]) == 2
    assert one_line(capsys) == f"rigcast: port {port} is taken; choose another with --port\n"


# ---- Listings, the bus, the demo


def test_the_demo_plays_on_the_emulated_bus() -> None:
    told = play_on_emulated_bus(still(), load_rig("puppet"), "1234567890abcdef")
    assert (told["mode"], len(told["joints"])) == ("safe", 20)
    assert told["followed"] > 0
    assert max(told["rms_error"]) < 0.1


def test_a_rig_without_a_failsafe_is_told_to_have_a_switch() -> None:
    puppet = load_rig("puppet")
    for protocol in ("dynamixel1", "feetech", "lx16a", "maestro", "ssc32"):
        rig = replace(puppet, buses=(replace(puppet.buses[0], protocol=protocol),))
        assert failsafe(rig) == "no hardware failsafe: fit a power switch"


def test_listings(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rigs", "--json"]) == 0
    says = {row["name"]: row["where the computer dies"] for row in json.loads(capsys.readouterr().out)}
    assert (says["puppet"], says["humanoid"]) == ("servos stop, keep torque", "no servos")
    assert main(["generators"]) == 0
    assert "mdm" in capsys.readouterr().out


def test_the_emulated_bus_prints_its_port_and_ends_on_sigterm() -> None:
    command = [sys.executable, "-m", "rigcast", "bus", "emulate"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as bus:
        assert bus.stdout is not None
        port = bus.stdout.readline().strip()
        assert Path(port).is_char_device()
        bus.terminate()
        assert bus.wait(10) == 0
