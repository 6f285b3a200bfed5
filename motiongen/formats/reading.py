"""Any file of human motion, by its suffix and, where that says little, its content."""

from __future__ import annotations

from pathlib import Path

from motiongen.files import FileError, load_motion, npz_names
from motiongen.motion import Motion

MOTION_FILES = (".bvh", ".npy", ".npz")


def read_motion(path: Path) -> Motion:
    """The human motion in a `.bvh`, an `.npz` (ours or AMASS) or a HumanML3D or KIT-ML `.npy` file.

    Raises FileError or another ValueError where it cannot be understood, OSError where it cannot be opened.
    """
    if path.suffix == ".bvh":
        from motiongen.formats.bvh import read_bvh

        return read_bvh(path)
    if path.suffix == ".npy":
        from motiongen.formats.humanml_npy import read_humanml

        return read_humanml(path)
    if path.suffix == ".npz":
        from motiongen.formats.amass import is_amass, read_amass

        return read_amass(path) if is_amass(npz_names(path)) else load_motion(path)
    raise FileError(
        f"{path}: no human motion is read from {path.suffix or 'a file without suffix'}; known are "
        + ", ".join(MOTION_FILES)
    )
