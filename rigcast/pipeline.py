"""The line that every verb wires: text → Motion → Trajectory → Report → files, a preview, the wire."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from motiongen.files import FileError, motion_from_arrays, read_npz
from motiongen.motion import Motion
from retarget.files import trajectory_from_arrays
from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from rigcast.times import Times
from sim.report import Report

if TYPE_CHECKING:
    from sim.simulate import Rollout

READABLE = (".bvh", ".npz")


@dataclass(frozen=True)
class Take:
    """One motion at the end of the line. `motion` is None where the line began with a trajectory."""

    motion: Motion | None
    trajectory: Trajectory
    report: Report
    rollout: Rollout
    rig: Rig


def read(path: Path) -> Motion | Trajectory:
    """What is in a `.bvh` or one of our `.npz` files.

    Raises FileError or BvhError (both ValueError) where it cannot be understood, OSError where it cannot be opened.
    """
    if path.suffix == ".bvh":
        from motiongen.bvh import read_bvh

        return read_bvh(path)
    if path.suffix != ".npz":
        raise FileError(
            f"{path}: cannot read {path.suffix or 'a file without suffix'}; known are {', '.join(READABLE)}"
        )
    kind, arrays = read_npz(path)
    if kind == "motion":
        return motion_from_arrays(arrays, path)
    if kind == "trajectory":
        return trajectory_from_arrays(arrays, path)
    raise FileError(f"{path}: holds a {kind}, expected a motion or a trajectory")


def take(what: Motion | Trajectory, rig: Rig, mount: Mount | None, times: Times) -> Take:
    """Retarget a motion (a trajectory is taken as it is) and put it through physics.

    Raises ValueError where a trajectory was made for another rig.
    """
    with times.stage("import physics"):
        from sim.checks import judge
    if isinstance(what, Motion):
        with times.stage("import kinematics"):
            from retarget.retarget import retarget
        with times.stage("retarget"):
            trajectory = retarget(what, rig, mount=mount)
    else:
        trajectory = what
    with times.stage("check"):
        report, rollout = judge(trajectory, rig, mount=mount)
    return Take(what if isinstance(what, Motion) else None, trajectory, report, rollout, rig)
