"""The gate's speed: a whole report beside a bare `mj_step` loop on the same targets, and trials on two threads.

    python benchmarks/physics.py [--quick] [--json] [--gate]

Times of reports and loops are seconds of processor time, in turns; those of trials are seconds on the clock, since
threads are what they measure, and mean little while other programs run.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import mujoco
import numpy as np
from lines import Line, gate, text

from motiongen.gestures.catalogue import perform
from retarget.retarget import retarget
from retarget.rig import Mount, Rig, load_rig
from retarget.trajectory import Trajectory
from sim.checks import judge
from sim.scene import TIMESTEP, build_scene
from sim.simulate import SETTLE

RIGS = ("puppet", "humanoid")
SECONDS = 10.0
GESTURES = ("wave", "bow", "squat", "twist")
TURNS, QUICK_TURNS = 7, 3
TRIALS, QUICK_TRIALS = 10, 4
FASTER, OVERHEAD, TWO_THREADS = 10.0, 0.30, 1.3  # targets: times real time, share of the bare loop, times one thread


@dataclass(frozen=True)
class Speed:
    """One rig on one mount, motion of `seconds`: middle times in s, over turns, and the ratio of their sums by turn."""

    rig: str
    mount: str
    seconds: float
    report_s: float
    bare_s: float
    overhead: float

    @property
    def times_real_time(self) -> float:
        return self.seconds / self.report_s


@dataclass(frozen=True)
class Full:
    """Trials of one rig: seconds on the clock with one thread and with two."""

    rig: str
    trials: int
    one_thread_s: float
    two_threads_s: float


def motion_for(rig: Rig, mount: Mount) -> Trajectory:
    """Gestures one after the other, cut at ten seconds."""
    parts = [retarget(perform(name), rig, mount=mount) for name in GESTURES]
    fps = parts[0].fps
    count = round(SECONDS * fps) + 1
    qpos = np.concatenate([p.qpos for p in parts])[:count]
    contacts = {foot: np.concatenate([p.contacts[foot] for p in parts])[:count] for foot in parts[0].contacts}
    return Trajectory(qpos, fps, rig.name, rig.joint_names(), contacts)


def bare(trajectory: Trajectory, rig: Rig, mount: Mount) -> None:
    """The same steps, targets and way of the harness, in a loop that does nothing else."""
    scene = build_scene(rig, mount, trajectory.qpos[0])
    data = mujoco.MjData(scene.model)
    scene.place(data, trajectory.qpos[0])
    settle, per_frame = round(SETTLE / TIMESTEP), round(1 / trajectory.fps / TIMESTEP)
    joints = len(rig.joints)
    data.ctrl[:joints] = trajectory.joint_pos[0]
    data.mocap_pos[:], data.mocap_quat[-1:] = trajectory.qpos[0, :3], trajectory.qpos[0, 3:7]
    for _ in range(settle):
        mujoco.mj_step(scene.model, data)
    for pose in trajectory.qpos:
        data.ctrl[:joints] = pose[7:]
        data.mocap_pos[:], data.mocap_quat[-1:] = pose[:3], pose[3:7]
        for _ in range(per_frame):
            mujoco.mj_step(scene.model, data)


def speed(name: str, mount: Mount, turns: int) -> Speed:
    """A report and the bare loop in turns, after one of each that is not counted."""
    rig = load_rig(name)
    trajectory = motion_for(rig, mount)
    reports, loops = [], []
    for turn in range(turns + 1):
        report = processor_s(lambda: judge(trajectory, rig, mount=mount))
        loop = processor_s(lambda: bare(trajectory, rig, mount))
        if turn:
            reports.append(report)
            loops.append(loop)
    return Speed(
        rig=name,
        mount=mount,
        seconds=trajectory.duration,
        report_s=statistics.median(reports),
        bare_s=statistics.median(loops),
        overhead=statistics.median(r / b for r, b in zip(reports, loops, strict=True)) - 1,
    )


def full(name: str, trials: int) -> Full:
    """Trials on the rig's own feet."""
    rig = load_rig(name)
    trajectory = motion_for(rig, "free")
    took = []
    for threads in (1, 2):
        start = time.perf_counter()
        judge(trajectory, rig, mount="free", trials=trials, threads=threads)
        took.append(time.perf_counter() - start)
    return Full(name, trials, *took)


def processor_s(what: Callable[[], object]) -> float:
    start = time.process_time()
    what()
    return time.process_time() - start


def lines_of(speeds: list[Speed], fulls: list[Full]) -> list[Line]:
    lines = []
    for s in speeds:
        where = f"{s.rig} on {s.mount}, {s.seconds:.0f} s"
        lines.append(Line("report", f"{where}: times real time", s.times_real_time, FASTER, at_least=True))
        lines.append(Line("report", f"{where}: over the bare loop", s.overhead, OVERHEAD, at_least=False))
    for f in fulls:
        ratio = f.one_thread_s / f.two_threads_s
        lines.append(Line("trials", f"{f.rig} free, {f.trials} trials: two threads", ratio, TWO_THREADS, at_least=True))
    return lines


def main() -> int:
    """Print the tables; exit 1 with `--gate` where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--quick", action="store_true", help="the puppet alone, fewer turns: under a minute on one core"
    )
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    options = parser.parse_args()
    rigs = RIGS[:1] if options.quick else RIGS
    turns, trials = (QUICK_TURNS, QUICK_TRIALS) if options.quick else (TURNS, TRIALS)
    speeds = [speed(rig, mount, turns) for rig in rigs for mount in dict.fromkeys(("free", load_rig(rig).mount))]
    fulls = [full(rig, trials) for rig in rigs]
    lines = lines_of(speeds, fulls)
    if options.json:
        found = {"speeds": [asdict(s) for s in speeds], "trials": [asdict(f) for f in fulls]}
        print(json.dumps({**found, "lines": [{**asdict(line), "holds": line.holds} for line in lines]}, indent=2))
    else:
        for s in speeds:
            print(f"{s.rig:<9} {s.mount:<6} report {s.report_s:.3f} s, bare loop {s.bare_s:.3f} s of processor time")
        for f in fulls:
            rate = f.trials * SECONDS / f.two_threads_s
            print(
                f"{f.rig:<9} {f.trials} trials: {f.one_thread_s:.1f} s, on two threads {f.two_threads_s:.1f} s "
                f"({rate:.1f} × real time) on {os.cpu_count()} cores"
            )
        print(*map(text, lines), sep="\n")
    return gate(lines, options.gate)


if __name__ == "__main__":
    sys.exit(main())
