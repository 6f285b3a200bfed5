"""HumanML3D's `.npy` files: 263-d features or `new_joints`, told apart by their shape, to a `Motion` and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from motiongen.files import FileError, replacing, require_plausible
from motiongen.fit import motion_from_positions
from motiongen.humanml import HUMANML3D, KIT_ML, features_to_positions, positions_to_features
from motiongen.motion import SMPL_JOINTS, Motion, Source
from motiongen.rotation import Array, quat_rotate, yaw_quat

MAX_FRAMES = 1_000_000
_TO_OURS = [2, 0, 1]  # x front, y left, z up out of the file's x left, y up, z front
_TO_FILE = [1, 2, 0]


def read_humanml(path: str | Path) -> Motion:
    """Read features (T, 263) or joint positions (T, 22, 3) at 20 frames a second, metres, y up, facing +z.

    Rotations are fitted to the positions (`motiongen.fit`); the features' own leave the twist of every bone open and
    are not used. Raises FileError where the array has another shape, holds objects or NaN, or the file is cut short;
    OSError where it cannot be opened.
    """
    array = _load(path)
    joints = len(SMPL_JOINTS)
    try:
        require_plausible(array)
        if array.shape[1:] == (HUMANML3D.width,):
            where = features_to_positions(array)
        elif array.shape[1:] == (joints, 3):
            where = array.astype(float)
        elif array.shape[1:] in ((KIT_ML.width,), (KIT_ML.joints, 3)):
            raise ValueError("KIT-ML has another skeleton; motiongen.humanml gives its joint positions, not a motion")
        else:
            raise ValueError(f"an array {array.shape}, expected features (T, 263) or joint positions (T, {joints}, 3)")
        return motion_from_positions(where[..., _TO_OURS], HUMANML3D.fps, Source(f"file {Path(path).name}"))
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None


def write_humanml(motion: Motion, path: str | Path) -> None:
    """Write `motion` as HumanML3D features (T - 1, 263), float32, at 20 frames a second.

    Bone lengths stay the motion's own; the data set's are those of one body. Raises ValueError where the motion is
    under two frames long at that rate or lacks the 22 joints, OSError where `path` cannot be written.
    """
    features = positions_to_features(humanml_positions(motion)).astype(np.float32)
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.save(file, features, allow_pickle=False)


def humanml_positions(motion: Motion) -> Array:
    """Joint positions (T, 22, 3) as the data set has them: 20 frames a second, y up, metres, the lowest joint on the
    floor, from the origin, facing +z in the first frame. Raises ValueError where a joint is missing.
    """
    rows = [motion.skeleton.index(name) for name in SMPL_JOINTS]
    where = (motion if motion.fps == HUMANML3D.fps else motion.resampled(HUMANML3D.fps)).positions()[:, rows]
    hips, shoulders = (
        [SMPL_JOINTS.index(f"{side}_{joint}") for side in ("left", "right")] for joint in ("hip", "shoulder")
    )
    left = where[0, hips[0]] - where[0, hips[1]] + where[0, shoulders[0]] - where[0, shoulders[1]]
    where = quat_rotate(yaw_quat(np.arctan2(left[0], left[1])), where)
    start = np.array([where[0, 0, 0], where[0, 0, 1], where[..., 2].min()])
    return (where - start)[..., _TO_FILE]


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
