"""`rigcast demo`: the whole line without hardware, and one table of what happened.

The servo bus and the driver run as processes of their own, as they would on a rig: `rigcast bus emulate` and `rigcast
drive`; this one says, checks, films and streams.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from tyro.conf import Positional

from motiongen.generator import load_generator
from retarget.rig import Rig, load_rig
from retarget.trajectory import Trajectory
from rigcast import show
from rigcast.outputs import write
from rigcast.pipeline import take
from rigcast.times import Times
from sim.report import Report

if TYPE_CHECKING:
    from rich.table import Table

RIG, TEXT, SECONDS, SEED = "puppet", "a person waves with the right hand", 4.0, 1
READY_S = 30.0  # for a process to start on a slow machine


def demo(folder: Positional[Path] = Path("demo"), /) -> int:
    """Generate a wave, check it, film it, stream it to an emulated bus of servos, and print one table of it all.

    Args:
        folder: Where wave.mp4 and wave.png go.
    """
    times = Times()
    rig = load_rig(RIG)
    with times.stage("load generator"):
        model = load_generator()
    with times.stage("generate"):
        motion = model.generate(TEXT, seconds=SECONDS, seed=SEED)
    wave = take(motion, rig, None, times)
    print(f'"{TEXT}": {show.size_line(wave)}\n{show.origin_line(wave)}')
    if not wave.report.ok:
        show.console().print(show.report_table(wave.report))
        return 1
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("wave.mp4", "wave.png"):
        with times.stage(f"write {name}"):
            write(wave, folder / name)
        print(f"wrote {folder / name}")
    with times.stage("stream and drive"):
        driven = play_on_emulated_bus(wave.trajectory, rig, wave.report.report_id)
    show.console().print(table(times.seconds, wave.report, driven))
    return 0 if driven["mode"] == "safe" and driven["followed"] else 1


def play_on_emulated_bus(trajectory: Trajectory, rig: Rig, report_id: str) -> dict[str, Any]:
    """Stream `trajectory` to a driver on an emulated bus; what the driver told when the stream had ended."""
    from drivers.publisher import publish

    with tempfile.TemporaryDirectory() as room:
        endpoint = f"ipc://{room}/stream"
        with _rigcast("bus", "emulate", "--rig", RIG) as bus:
            port = _line(bus.stdout)
            with _rigcast(
                "drive", "--rig", RIG, "--port", port, "--endpoint", endpoint, "--trusted", "--json"
            ) as driver:
                said = ""
                while said != "waiting":
                    said = _line(driver.stderr, said)
                publish(trajectory, rig, report_id, endpoint, wait_s=READY_S)
                out, _ = driver.communicate(timeout=READY_S)
    told: dict[str, Any] = json.loads(out)
    return told


@contextmanager
def _rigcast(*args: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "rigcast", *args]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


def _line(stream: IO[str] | None, before: str = "") -> str:
    line = stream.readline() if stream else ""
    if not line:
        raise RuntimeError(f"a process of the demo ended before its time ({before or 'it said nothing'})")
    return line.strip()


def table(seconds: dict[str, float], report: Report, driven: dict[str, Any]) -> Table:
    """Seconds of each stage, the report, and the error of each servo."""
    rows = show.new_table("what", "found", "at most", "unit", title="rigcast demo")
    for column in (1, 2):
        rows.columns[column].justify = "right"
    for stage, spent in seconds.items():
        rows.add_row(stage, f"{spent:.2f}", "", "s")
    rows.add_row("all", f"{sum(seconds.values()):.2f}", "60", "s", end_section=True)
    for check in report.checks:
        rows.add_row(f"report: {check.name}", check.found, f"{check.limit:.4g}", check.unit)
    rows.add_row(f"report {report.report_id}", "pass" if report.ok else "fail", "", "", end_section=True)
    for joint, error in zip(driven["joints"], driven["rms_error"], strict=True):
        rows.add_row(f"servo error: {joint}", f"{error:.4f}", "", "rad rms")
    worst = max(driven["rms_error"])
    rows.add_row("servo error: worst", f"{worst:.4f}", "", "rad rms")
    rows.add_row("cycles followed", str(driven["followed"]), "", f"of {driven['cycles']}")
    return rows
