"""`rigcast serve` and `send` as processes: a gesture, a refusal, a page of figures, a stop, a clean end."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from small_rig import free_address

from drivers.metrics import Metric, MetricsPage, rendered
from drivers.receiver import Receiver
from retarget.rig import load_rig
from rigcast.__main__ import main

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
READY_S = 60.0


def told(capsys: pytest.CaptureFixture[str]) -> list[dict]:
    """The answers that `send --json` has printed."""
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


class Watcher(threading.Thread):
    """Keeps every frame that a rig would have followed."""

    def __init__(self, address: str) -> None:
        super().__init__()
        self.frames, self.over, self._address = [], threading.Event(), address

    def run(self) -> None:
        with Receiver(self._address, rig_hash=load_rig("puppet").hash, buffer_s=0.1) as receiver:
            while not self.over.is_set():
                if (frame := receiver.poll(time.monotonic_ns())) is not None:
                    self.frames.append(frame)
                time.sleep(0.002)


def test_from_prompt_to_stream_and_to_the_end(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    address = free_address()
    command = [sys.executable, "-m", "rigcast", "serve", address, "--generator", "gestures", "--metrics", "0"]
    watcher = Watcher(address)
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as service:
        try:
            assert service.stderr is not None
            figures = service.stderr.readline().split()[-1]
            assert "puppet is idle" in service.stderr.readline()
            watcher.start()
            send = ["send", "--endpoint", address, "--json"]
            assert main([*send, "nod"]) == 0
            answers = told(capsys)
            assert [a["event"] for a in answers] == ["queued", "making", "ready", "playing", "played"]
            passed = answers[2]["report_id"]
            assert all(check["ok"] for check in answers[2]["checks"])
            assert main([*send, "make me a sandwich"]) == 1
            assert (told(capsys)[-1]["event"], main([*send, "--status"])) == ("rejected", 0)
            assert told(capsys)[0]["mode"] == "idle"
            end = time.monotonic() + READY_S
            while (
                'rigcast_prompts_total{outcome="rejected"} 1.0' not in urllib.request.urlopen(figures).read().decode()
            ):
                assert time.monotonic() < end
                time.sleep(0.1)
            assert main([*send, "--stop"]) == 0
            assert main([*send, "nod"]) == 1
            assert "said stop" in told(capsys)[-1]["detail"]
            service.send_signal(signal.SIGTERM)
            out, _ = service.communicate(timeout=READY_S)
        finally:
            watcher.over.set()
            service.kill()
    watcher.join()
    assert service.returncode == 0
    assert "1 played, 1 rejected" in out
    seen = [frame.report_id for frame in watcher.frames]
    assert passed in seen
    assert seen[-1] != passed
    steps = [(b.pos - a.pos)[0] / (b.seq - a.seq) for a, b in zip(watcher.frames, watcher.frames[1:], strict=False)]
    velocity = np.array([joint.velocity for joint in load_rig("puppet").joints])
    assert (np.abs(steps) * 50 <= velocity + 1e-3).all()


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["send"], "say one thing"),
        (["send", "wave", "--stop"], "say one thing"),
        (["send", ""], "the text is empty"),
        (["send", "wave", "--seconds", "0.2"], "0.2 seconds"),
        (["serve", "--rate", "2000"], "rate 2000 Hz"),
        (["serve", "--rig", "nobody"], "nobody"),
        (["serve", "tcp://*:5599"], "rigcast keys new"),
    ],
)
def test_mistakes_are_one_line(
    args: list[str], words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert main(args) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


def test_nobody_there_is_said(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rigcast.send.SILENCE_S", 0.2)
    assert main(["send", "wave", "--endpoint", free_address()]) == 2
    assert "nobody answered" in capsys.readouterr().err


# --- the page


def test_the_page_is_in_the_format_of_prometheus() -> None:
    metrics = (
        Metric("x_total", "counter", "How many.", (({}, 3),)),
        Metric("t", "gauge", "Warmth.", (({"a": 'say "hi"\\\n', "b": ""}, 1.5), ({"a": "", "b": ""}, float("inf")))),
    )
    # As in the published example of the format: escapes for backslash, quote and line feed; +Inf.
    assert rendered(metrics).splitlines() == [
        "# HELP x_total How many.",
        "# TYPE x_total counter",
        "x_total 3.0",
        "# HELP t Warmth.",
        "# TYPE t gauge",
        't{a="say \\"hi\\"\\\\\\n",b=""} 1.5',
        't{a="",b=""} +Inf',
    ]
    parser = pytest.importorskip("prometheus_client.parser", reason="prometheus_client is not installed")
    families = list(parser.text_string_to_metric_families(rendered(metrics)))
    assert [f.name for f in families] == ["x", "t"]
    assert families[1].samples[0].labels == {"a": 'say "hi"\\\n', "b": ""}


def test_the_page_is_served_on_this_machine_alone() -> None:
    with MetricsPage(0, lambda: "x 1.0\n") as page:
        at = f"http://127.0.0.1:{page.port}"
        with urllib.request.urlopen(f"{at}/metrics") as answer:
            assert (answer.read(), answer.headers["Content-Type"]) == (
                b"x 1.0\n",
                "text/plain; version=0.0.4; charset=utf-8",
            )
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(f"{at}/etc/passwd")
