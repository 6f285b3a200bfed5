"""The line that every verb wires: text → Motion → Trajectory → Report → files, a preview, the wire."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from motiongen.files import FileError, npz_names
from motiongen.motion import Motion
from retarget.files import load_trajectory
from retarget.rig import Mount, Rig, load_rig
from retarget.robot_csv import Style, read_robot_csv
from retarget.trajectory import Trajectory
from rigcast.times import Times
from sim.report import Report

if TYPE_CHECKING:
    from sim.simulate import Rollout

READABLE = (".bvh", ".npz", ".npy", ".csv", ".rigrec")
MOST_THREADS = 8  # of trials: each keeps seconds of every step in memory
DEFAULT_RIG = "puppet"


@dataclass(frozen=True)
class Take:
    """One motion at the end of the line. `motion` is None where the line began with a trajectory."""

    motion: Motion | None
    trajectory: Trajectory
    report: Report
    rollout: Rollout
    rig: Rig


def read(path: Path, rig: str | None = None, style: Style = "ours", fps: float | None = None) -> Motion | Trajectory:
    """What is in a file of human motion or of a rig's trajectory, by its suffix and, where that says little, content.

    `rig`, `style` and `fps` are for `.csv`, which says little of its own. Raises FileError, BvhError (both
    ValueError) where it cannot be understood, RigError for an unknown rig, OSError where it cannot be
    opened.
    """
    if path.suffix not in READABLE:
        raise FileError(
            f"{path}: cannot read {path.suffix or 'a file without suffix'}; known are {', '.join(READABLE)}"
        )
    if path.suffix != ".csv" and (style != "ours" or fps is not None):
        raise FileError(f"{path}: --style and --fps are for .csv files")
    if path.suffix == ".csv":
        body = load_rig(rig or DEFAULT_RIG)
        return read_robot_csv(path, style, body.name, body.joint_names(), fps)
    if path.suffix == ".rigrec":
        return _recorded(path, rig)
    if path.suffix == ".npz" and "qpos" in npz_names(path):
        return load_trajectory(path)
    from motiongen.formats.reading import read_motion

    return read_motion(path)


def _recorded(path: Path, rig: str | None) -> Trajectory:
    from drivers.endpoint import StreamError
    from drivers.recorded import hello_in, trajectory_in
    from drivers.recording import Recording

    try:
        recording = Recording(path)
        return trajectory_in(recording, load_rig(rig or hello_in(recording).rig))
    except StreamError as error:
        raise FileError(str(error)) from None


def take(
    what: Motion | Trajectory,
    rig: Rig,
    mount: Mount | None,
    times: Times,
    *,
    fix: bool = False,
    trials: int = 0,
    seed: int = 0,
) -> Take:
    """Retarget a motion (a trajectory is taken as it is) and put it through physics, `trials` more times if asked for.

    With `fix` what fails there is mended, see `sim.fix`. Raises ValueError where a trajectory is of another rig.
    """
    from drivers.measured import as_measured

    with times.stage("import physics"):
        from sim.fix import judge_mended
    if isinstance(what, Motion):
        with times.stage("import kinematics"):
            from retarget import loops
            from retarget.retarget import retarget
        with times.stage("retarget" if loops.kept() else "compile the solver, once, and retarget"):
            trajectory = retarget(what, rig, mount=mount)
    else:
        trajectory = what
    with times.stage("check"):
        threads = min(os.cpu_count() or 1, MOST_THREADS)
        trajectory, report, rollout = judge_mended(
            trajectory, as_measured(rig), mount=mount, fix=fix, trials=trials, seed=seed, threads=threads
        )
    return Take(what if isinstance(what, Motion) else None, trajectory, report, rollout, rig)
