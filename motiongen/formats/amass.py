"""AMASS `.npz`: SMPL-H and SMPL-X body poses to a `Motion` and back, without the SMPL model.

A pose is axis × angle (rad) per joint relative to its parent, in frames that lie along x left, y up, z front in the
T-pose; the world is z up, in metres. The files hold no bone lengths: those come with the licensed body model. The
body here is `motiongen.smpl.SMPL_SKELETON`, whatever betas and gender say, so that the angles are exact and the
positions are those of that body.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from motiongen.files import FileError, load_arrays, replacing, require_plausible, require_timing
from motiongen.formats.ground import on_floor
from motiongen.motion import SMPL_JOINTS, Motion, Source
from motiongen.rotation import matrix_to_quat, quat_conj, quat_continuous, quat_mul, quat_to_rotvec, rotvec_to_quat
from motiongen.smpl import SMPL_SKELETON

WIDTHS = {66: "SMPL body", 72: "SMPL", 156: "SMPL-H", 165: "SMPL-X"}
RATES = ("mocap_framerate", "mocap_frame_rate")
MAX_FRAMES = 1_000_000
_TO_OURS, _TO_FILE = [2, 0, 1], [1, 2, 0]
_OURS_IN_SMPL = matrix_to_quat(np.eye(3)[:, [2, 0, 1]])  # from x front, y left, z up to x left, y up, z front


def is_amass(names: tuple[str, ...]) -> bool:
    """Whether an `.npz` with arrays of these names is AMASS's."""
    return {"poses", "trans"} <= set(names) and "kind" not in names


def read_amass(path: str | Path) -> Motion:
    """Read the 22 body joints of an AMASS file; hands and face are left out.

    The height of the whole clip is moved so that the lowest foot joint of the clip is where it is on a flat sole: where
    `trans` lies in the body depends on the model. Raises FileError where arrays are missing, have other shapes, hold
    objects or NaN; OSError where the file cannot be opened.
    """
    arrays = load_arrays(path, wanted=("poses", "trans", *RATES))
    try:
        poses, trans, fps = _checked(arrays)
        body = poses[:, : 3 * len(SMPL_JOINTS)].reshape(len(poses), len(SMPL_JOINTS), 3)
        local = rotvec_to_quat(body[..., _TO_OURS])
        root = rotvec_to_quat(poses[:, :3])
        local[:, 0] = quat_mul(root, _OURS_IN_SMPL)
        draft = Motion(trans, quat_continuous(local), fps, SMPL_SKELETON, source=Source(f"file {Path(path).name}"))
    except ValueError as error:
        raise FileError(f"{path}: {error}") from None
    return on_floor(draft)


def write_amass(motion: Motion, path: str | Path) -> None:
    """Write `motion` as SMPL-H poses (T, 156) with still hands, `trans` at the pelvis, neutral gender, betas 0.

    Bone lengths, labels and contacts have no place there. Raises ValueError where the motion lacks a body joint,
    OSError where `path` cannot be written.
    """
    quat = motion.joint_quat[:, [motion.skeleton.index(name) for name in SMPL_JOINTS]]
    poses = np.zeros((len(motion), 52, 3))
    poses[:, : len(SMPL_JOINTS)] = quat_to_rotvec(quat)[..., _TO_FILE]
    poses[:, 0] = quat_to_rotvec(quat_mul(quat[:, 0], quat_conj(_OURS_IN_SMPL)))
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            poses=poses.reshape(len(motion), -1),
            trans=motion.root_pos,
            mocap_framerate=float(motion.fps),
            betas=np.zeros(16),
            gender="neutral",
        )


def _checked(arrays: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray, float]:
    """Poses (T, n), trans (T, 3) and frames a second; raises ValueError naming what is wrong."""
    rates = [arrays[name] for name in RATES if name in arrays]
    if "poses" not in arrays or "trans" not in arrays or not rates:
        raise ValueError(f"an AMASS file needs poses, trans and {' or '.join(RATES)}; it has {', '.join(arrays)}")
    poses, trans = arrays["poses"], arrays["trans"]
    if poses.ndim != 2 or poses.shape[1] not in WIDTHS or trans.shape != (len(poses), 3) or rates[0].size != 1:
        known = ", ".join(f"{width} ({name})" for width, name in WIDTHS.items())
        raise ValueError(f"poses {poses.shape}, trans {trans.shape}; expected (T, n) and (T, 3), n one of {known}")
    if any(a.dtype.kind not in "fiu" for a in (poses, trans, rates[0])):
        raise ValueError("poses, trans and the frame rate must be numbers")
    if len(poses) > MAX_FRAMES:
        raise ValueError(f"{len(poses)} frames, expected at most {MAX_FRAMES}")
    require_plausible(np.hstack([poses, trans]))
    fps = float(rates[0].item())
    require_timing(len(poses), fps)
    return poses.astype(float), trans.astype(float), fps
