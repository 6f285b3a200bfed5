"""Robot motion as `.csv`, in the styles people have: one row a frame, root position (m), root quaternion, joints (rad).

A file without a header does not say its quaternion's order, its joints or its rate. So the style is named, never
guessed, and what the style leaves open comes from the rig and the caller.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from motiongen.files import LARGEST, FileError, replacing, require_timing
from motiongen.motion import Source
from motiongen.rotation import Array, slerp
from retarget.files import CSV_ROOT, write_csv
from retarget.trajectory import Trajectory

Style = Literal["ours", "unitree", "kimodo", "gmr"]
MAX_BYTES = 1 << 28
_TO_XYZW = [0, 1, 2, 4, 5, 6, 3]


@dataclass(frozen=True)
class Headless:
    """A style without header and time: the order of its root quaternion, and its rate where the style fixes one."""

    quat: Literal["wxyz", "xyzw"]
    fps: float | None


# unitree: Unitree's LAFAN1 retargeting data set. kimodo: MuJoCo's qpos as it is. gmr: what GMR keeps in its pickles
# (root_pos, root_rot, dof_pos), as a table; its rate is that of the clip it was made from.
HEADLESS = {"unitree": Headless("xyzw", 30.0), "kimodo": Headless("wxyz", 30.0), "gmr": Headless("xyzw", None)}
STYLES: tuple[Style, ...] = ("ours", "unitree", "kimodo", "gmr")


def read_robot_csv(path: str | Path, style: Style, rig: str, joints: tuple[str, ...], fps: float | None) -> Trajectory:
    """Read a `.csv` of `style` as a trajectory of `rig`, whose joints are `joints`; headless files have them in order.

    `fps`: the rate of a headless file, or None for the style's own; `ours` has the time in it and takes none. Raises
    FileError where the header, the columns or the joints do not fit, a cell is no number, a quaternion is not of unit
    length (tolerance 0.01; what is within is normalised), or the rate is open; OSError where `path` cannot be opened.
    """
    try:
        lines = _lines(path)
        if style == "ours":
            if fps is not None:
                raise ValueError("a file with a time column has its own rate; leave --fps out")
            qpos, rate = _with_header(lines, rig, joints)
        else:
            given = HEADLESS[style].fps if fps is None else fps
            if given is None:
                raise ValueError(f"style {style} does not fix the frames a second; give --fps")
            qpos, rate = _headless(lines, HEADLESS[style], joints), given
        norm = np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
        if not (np.abs(norm - 1) < 0.01).all():
            raise ValueError(f"the root quaternion of frame {int(np.abs(norm - 1).argmax())} is not of unit length")
        qpos[:, 3:7] /= norm
        require_timing(len(qpos), rate)
        return Trajectory(qpos, rate, rig, joints, source=Source(f"file {Path(path).name} ({style})"))
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None


def write_robot_csv(trajectory: Trajectory, path: str | Path, style: Style) -> None:
    """Write `trajectory` in `style`, resampled where the style fixes the rate.

    A headless style loses the joints' names, and `gmr` the rate. Raises OSError where `path` cannot be written.
    """
    if style == "ours":
        write_csv(trajectory, path)
        return
    what = HEADLESS[style]
    qpos = trajectory.qpos if what.fps is None else _resampled(trajectory, what.fps)
    if what.quat == "xyzw":
        qpos = qpos[:, _TO_XYZW + list(range(7, qpos.shape[1]))]
    with replacing(path) as temporary:
        np.savetxt(temporary, qpos, "%.9g", ",")


def _with_header(lines: list[str], rig: str, joints: tuple[str, ...]) -> tuple[Array, float]:
    """Rows in the order of `joints`, and the rate that the time column has."""
    head = lines[0].split(",")
    names = [n.removesuffix("_rad") for n in head[len(CSV_ROOT) :]]
    if tuple(head[: len(CSV_ROOT)]) != CSV_ROOT:
        raise ValueError(f"no header {','.join(CSV_ROOT)}; name the file's --style: {', '.join(STYLES)}")
    if sorted(names) != sorted(joints):
        odd = sorted(set(names) ^ set(joints)) or sorted(names)
        raise ValueError(f"the joints are not those of {rig}: {', '.join(odd[:8])}; name the --rig of the file")
    table = _numbers(lines[1:], len(head), 2)
    step = np.diff(table[:, 0])
    if len(step) == 0 or step.mean() <= 0 or np.abs(step - step.mean()).max() > 0.1 * step.mean():
        raise ValueError("time_s must hold two or more frames, evenly spaced")
    order = [len(CSV_ROOT) + names.index(joint) for joint in joints]
    return table[:, [*range(1, len(CSV_ROOT)), *order]], round(1 / step.mean(), 6)


def _headless(lines: list[str], what: Headless, joints: tuple[str, ...]) -> Array:
    qpos = _numbers(lines, 7 + len(joints), 1)
    if what.quat == "xyzw":
        qpos[:, _TO_XYZW] = qpos[:, :7].copy()
    return qpos


def _numbers(lines: list[str], width: int, first: int) -> Array:
    """Rows (T, width) of finite numbers; `first` is the first line's number in the file, for messages."""
    rows = []
    for number, line in enumerate(lines, start=first):
        cells = line.split(",")
        if len(cells) != width:
            raise ValueError(f"line {number} has {len(cells)} columns, expected {width}")
        try:
            rows.append([float(cell) for cell in cells])
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from None
        if not (np.abs(rows[-1]) <= LARGEST).all():
            raise ValueError(f"line {number} holds NaN, infinity or a number above {LARGEST:g}")
    if not rows:
        raise ValueError("no rows of numbers")
    return np.array(rows)


def _lines(path: str | Path) -> list[str]:
    with Path(path).open("rb") as file:
        content = file.read(MAX_BYTES + 1)
    if len(content) > MAX_BYTES:
        raise ValueError(f"over {MAX_BYTES} bytes")
    try:
        return content.decode("utf-8").split() or [""]
    except UnicodeDecodeError as error:
        raise ValueError(f"not a .csv file (not text: byte {error.start})") from None


def _resampled(trajectory: Trajectory, fps: float) -> Array:
    """Rows of qpos at `fps`: the root's rotation by slerp, the rest linear."""
    at = np.arange(round(trajectory.duration * fps) + 1) * trajectory.fps / fps
    low = np.clip(at.astype(int), 0, len(trajectory) - 1)
    high = np.minimum(low + 1, len(trajectory) - 1)
    u = np.clip(at - low, 0, 1)[:, None]
    qpos = trajectory.qpos[low] + u * (trajectory.qpos[high] - trajectory.qpos[low])
    qpos[:, 3:7] = slerp(trajectory.root_quat[low], trajectory.root_quat[high], u[:, 0])
    return qpos
