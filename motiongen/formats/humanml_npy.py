"""`.npy` files of HumanML3D and KIT-ML: features or `new_joints`, told apart by their shape, to a `Motion` and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from motiongen.files import FileError, replacing, require_plausible, require_timing
from motiongen.formats.fit import motion_from_positions
from motiongen.formats.humanml import (
    HUMANML3D,
    KIT_ML,
    LAYOUTS,
    facing_front,
    features_to_positions,
    positions_to_features,
)
from motiongen.formats.kit import kit_positions, kit_to_canonical
from motiongen.motion import SMPL_JOINTS, Motion, Source
from motiongen.rotation import Array

MAX_FRAMES = 1_000_000
_TO_OURS = [2, 0, 1]  # x front, y left, z up out of the file's x left, y up, z front
_TO_FILE = [1, 2, 0]


def read_humanml(path: str | Path) -> Motion:
    """Read HumanML3D's features (T, 263) or joint positions (T, 22, 3), or KIT-ML's (T, 251) or (T, 21, 3).

    HumanML3D is in metres at 20 frames a second; for KIT-ML's unit and its 12.5 frames a second see `formats.kit`.
    Rotations are fitted to the positions (`formats.fit`); the features' own leave the twist of every bone open and
    are not used. Raises FileError where the array has another shape, holds objects or NaN, or the file is cut short;
    OSError where it cannot be opened.
    """
    array = _load(path)
    try:
        require_plausible(array)
        layout = next((each for each in LAYOUTS.values() if array.shape[1:] in ((each.width,), (each.joints, 3))), None)
        if layout is None:
            known = ", ".join(f"(T, {each.width}) or (T, {each.joints}, 3) of {each.name}" for each in LAYOUTS.values())
            raise ValueError(f"an array {array.shape}, expected {known}")
        require_timing(len(array), layout.fps)
        where = features_to_positions(array) if array.ndim == 2 else array.astype(float)
        places = kit_to_canonical(where) if layout is KIT_ML else where[..., _TO_OURS]
        return motion_from_positions(places, layout.fps, Source(f"file {Path(path).name} ({layout.name})"))
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None


def write_humanml(motion: Motion, path: str | Path) -> None:
    """Write `motion` as HumanML3D features (T - 1, 263), float32, at 20 frames a second.

    Bone lengths stay the motion's own; the data set's are those of one body. Raises ValueError where the motion is
    under two frames long at that rate or lacks the 22 joints, OSError where `path` cannot be written.
    """
    _write(positions_to_features(humanml_positions(motion)), path)


def write_kit(motion: Motion, path: str | Path) -> None:
    """Write `motion` as KIT-ML features (T - 1, 251), float32, at 12.5 frames a second; see `formats.kit`.

    Raises ValueError where the motion is under two frames long at that rate or lacks a joint, OSError where `path`
    cannot be written.
    """
    _write(positions_to_features(kit_positions(motion), KIT_ML), path)


def _write(features: Array, path: str | Path) -> None:
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.save(file, features.astype(np.float32), allow_pickle=False)


def humanml_positions(motion: Motion) -> Array:
    """Joint positions (T, 22, 3) as the data set has them: 20 frames a second, y up, metres, the lowest joint on the
    floor, from the origin, facing +z in the first frame. Raises ValueError where a joint is missing.
    """
    rows = [motion.skeleton.index(name) for name in SMPL_JOINTS]
    where = (motion if motion.fps == HUMANML3D.fps else motion.resampled(HUMANML3D.fps)).positions()[:, rows]
    pairs = [(SMPL_JOINTS.index(f"left_{joint}"), SMPL_JOINTS.index(f"right_{joint}")) for joint in ("hip", "shoulder")]
    return facing_front(where, pairs)[..., _TO_FILE]


def _load(path: str | Path) -> np.ndarray:
    """The array in an `.npy` file, mapped, so that a header that promises too much costs no memory."""
    with Path(path).open("rb"):  # what cannot be opened stays an OSError
        pass
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        plain = isinstance(array, np.ndarray) and array.dtype.kind in "fiu"
    except Exception:  # numpy raises anything, SyntaxError included, on a damaged header
        raise FileError(f"{path}: not an .npy file of plain numbers, or damaged") from None
    if not plain or not 1 <= array.ndim <= 3:
        raise FileError(f"{path}: not an .npy file of plain numbers in rows")
    if not 0 < len(array) <= MAX_FRAMES:
        raise FileError(f"{path}: {len(array)} frames, expected 1 to {MAX_FRAMES}")
    return array
