"""Trajectory files: `.npz` of our own without loss, and `.csv` for everything else that plots or plays joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from motiongen.files import FileError, notes_from_json, notes_to_json, read_kind, replacing, require_timing, write_npz
from retarget.trajectory import Trajectory

CSV_ROOT = ("time_s", "root_x_m", "root_y_m", "root_z_m", "root_qw", "root_qx", "root_qy", "root_qz")
_CONTACT = "contact:"


def save_trajectory(trajectory: Trajectory, path: str | Path) -> None:
    """Write `trajectory` without loss. Raises OSError where `path` cannot be written."""
    arrays: dict[str, Any] = {
        "qpos": trajectory.qpos,
        "fps": float(trajectory.fps),
        "rig": trajectory.rig,
        "joints": np.array(trajectory.joints),
        "notes": notes_to_json(trajectory.labels, trajectory.source),
    }
    if trajectory.aim is not None:
        arrays["aim"] = trajectory.aim
    arrays |= {_CONTACT + foot: touching for foot, touching in trajectory.contacts.items()}
    write_npz(path, "trajectory", arrays)


def load_trajectory(path: str | Path) -> Trajectory:
    """Read what `save_trajectory` wrote.

    Raises FileError where the file is damaged, foreign, of another kind or version, or holds NaN, no frames or a frame
    rate that is not above 0; OSError where it cannot be opened.
    """
    arrays = read_kind(path, "trajectory")
    try:
        labels, source = notes_from_json(str(arrays["notes"]))
        joints = tuple(map(str, arrays["joints"]))
        contacts = {n.removeprefix(_CONTACT): arrays[n].astype(bool) for n in arrays if n.startswith(_CONTACT)}
        fps, rig = float(arrays["fps"]), str(arrays["rig"])
        require_timing(len(arrays["qpos"]), fps)
        return Trajectory(arrays["qpos"], fps, rig, joints, contacts, labels, source, arrays.get("aim"))
    except KeyError as error:
        raise FileError(f"{path}: damaged trajectory file ({error} is missing)") from None
    except (ValueError, TypeError, AttributeError) as error:
        raise FileError(f"{path}: {error}") from None


def write_csv(trajectory: Trajectory, path: str | Path) -> None:
    """Write one row a frame: time in seconds, root position (m) and quaternion (w x y z), joints by name in radians.

    The header states each column's unit (`CSV_ROOT`, then `<joint>_rad`). Raises OSError where `path` cannot be
    written.
    """
    time = np.arange(len(trajectory)) / trajectory.fps
    header = ",".join([*CSV_ROOT, *(f"{name}_rad" for name in trajectory.joints)])
    with replacing(path) as temporary:
        np.savetxt(temporary, np.column_stack([time, trajectory.qpos]), "%.9g", ",", header=header, comments="")
