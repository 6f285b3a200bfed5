"""BVH in: any channel order; skeletons known by name are brought to the canonical 22 joints of SMPL.

A BVH file may draw its zero pose any way it likes: in Bandai-Namco's every bone lies along ±x. The table of a skeleton
says, joint by joint, where the file's local axes point when the person stands in a T-pose; with that the joint frames
are turned to the canonical ones (all along the world's axes in the T-pose) and bone lengths stay as they are.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion, Skeleton, Source
from motiongen.rotation import Array, axis_angle_to_quat, matrix_to_quat, quat_continuous, quat_mul, quat_to_matrix

MAX_FRAMES = 1_000_000
MAX_JOINTS = 1_000


class BvhError(ValueError):
    """A BVH file that cannot be read; the message names the file and what is wrong."""


@dataclass(frozen=True)
class RawBvh:
    """A BVH file as written: `offsets` (J, 3) and `positions` (T, J, 3) in the file's unit, `quats` (T, J, 4) local."""

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: Array
    positions: Array
    quats: Array
    fps: float


@dataclass(frozen=True)
class SkeletonTable:
    """How a file's skeleton maps to the canonical one.

    `joints`: canonical name → name in the file; a canonical joint without one is put half-way along the bone that
    skips it. `axes`: name in the file → three letters for where its x, y, z point in the T-pose: F(ront), B(ack),
    L(eft), R(ight), U(p), D(own). `pitch`: radians, nose down, by which a joint's frame is turned about the left axis
    after that. `unit`: metres per unit of the file. The file's world is y up, facing z.
    """

    joints: dict[str, str]
    axes: dict[str, str]
    pitch: dict[str, float]
    unit: float
    licence: str
    foot_height: tuple[float, float]


# Foot and toe pitch: the mean over planted, level feet of the data set itself, so that a flat sole is the identity.
_FOOT_PITCH, _TOE_PITCH = 0.693, 0.400

BANDAI_NAMCO = SkeletonTable(
    joints={
        "pelvis": "Hips", "spine1": "Spine", "spine3": "Chest", "neck": "Neck", "head": "Head",
        "left_collar": "Shoulder_L", "left_shoulder": "UpperArm_L", "left_elbow": "LowerArm_L", "left_wrist": "Hand_L",
        "right_collar": "Shoulder_R", "right_shoulder": "UpperArm_R", "right_elbow": "LowerArm_R",
        "right_wrist": "Hand_R", "left_hip": "UpperLeg_L", "left_knee": "LowerLeg_L", "left_ankle": "Foot_L",
        "left_foot": "Toes_L", "right_hip": "UpperLeg_R", "right_knee": "LowerLeg_R", "right_ankle": "Foot_R",
        "right_foot": "Toes_R",
    },
    axes={
        "Hips": "URF", "Spine": "UFL", "Chest": "UFL", "Neck": "UFL", "Head": "UFL",
        "Shoulder_L": "LUF", "UpperArm_L": "LUF", "LowerArm_L": "LUF", "Hand_L": "LUF",
        "Shoulder_R": "LDB", "UpperArm_R": "LDB", "LowerArm_R": "LDB", "Hand_R": "LDB",
        "UpperLeg_L": "DLF", "LowerLeg_L": "DLF", "Foot_L": "FLU", "Toes_L": "FLU",
        "UpperLeg_R": "ULB", "LowerLeg_R": "ULB", "Foot_R": "BLD", "Toes_R": "BLD",
    },
    pitch={"Foot_L": _FOOT_PITCH, "Foot_R": _FOOT_PITCH, "Toes_L": _TOE_PITCH, "Toes_R": _TOE_PITCH},
    unit=0.01,
    licence="CC BY-NC 4.0 (Bandai-Namco Research Motiondataset)",
    foot_height=(0.117, 0.042),
)  # fmt: skip
# What `motiongen.bvh_write` writes: a T-pose whose joint frames all lie along the file's axes.
SMPL = SkeletonTable(
    joints={name: name for name in SMPL_JOINTS},
    axes=dict.fromkeys(SMPL_JOINTS, "LUF"),
    pitch={},
    unit=0.01,
    licence="",
    foot_height=(0.117, 0.042),
)
TABLES = {"bandai-namco": BANDAI_NAMCO, "smpl": SMPL}

_DIRECTIONS = {"F": (1, 0, 0), "B": (-1, 0, 0), "L": (0, 1, 0), "R": (0, -1, 0), "U": (0, 0, 1), "D": (0, 0, -1)}
_Y_UP_TO_Z_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # x, y, z of ours from z, x, y
_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def read_bvh(path: str | Path) -> Motion:
    """Read a BVH file whose skeleton is known and return it on the canonical 22 joints, in metres, z up.

    Raises BvhError where the file is not BVH, is cut short, holds NaN, zero frames or a frame time that is not above
    0, or has a skeleton that is not in `TABLES`; OSError where it cannot be opened.
    """
    raw = read_raw(path)
    for table in TABLES.values():
        if set(table.joints.values()) <= set(raw.names):
            return _canonical(raw, table, Path(path))
    known = "; ".join(f"{name} ({', '.join(t.joints.values())})" for name, t in TABLES.items())
    raise BvhError(f"{path}: unknown skeleton ({', '.join(raw.names[:6])}, …); known are {known}")


def read_raw(path: str | Path) -> RawBvh:
    """Read a BVH file as it is: names, offsets, positions and local rotations in the file's own frames and unit.

    Raises BvhError and OSError as `read_bvh` does.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise BvhError(f"{path}: not a BVH file (not text: byte {error.start})") from None
    head, found, tail = text.partition("MOTION")
    if not found or not head.lstrip().startswith("HIERARCHY"):
        raise BvhError(f"{path}: not a BVH file (no HIERARCHY and MOTION)")
    names, parents, offsets, channels = _hierarchy(head, path)
    frame_time, values = _motion(tail, sum(map(len, channels)), path)
    positions, quats = _unpack(values, offsets, channels)
    return RawBvh(names, parents, offsets, positions, quats, 1.0 / frame_time)


def _hierarchy(head: str, path: str | Path) -> tuple[tuple[str, ...], tuple[int, ...], Array, list[list[str]]]:
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[list[str]] = []
    stack: list[int] = []  # -1 stands for an end site
    current = -1
    words = iter(head.split())
    next(words)
    try:
        for word in words:
            if word in ("ROOT", "JOINT"):
                names.append(next(words))
                parents.append(stack[-1] if stack else -1)
                offsets.append([0.0, 0.0, 0.0])
                channels.append([])
                current = len(names) - 1
                if len(names) > MAX_JOINTS:
                    raise BvhError(f"{path}: more than {MAX_JOINTS} joints")
            elif word == "End":
                next(words)
                current = -1
            elif word == "{":
                stack.append(current)
            elif word == "}":
                stack.pop()
            elif word == "OFFSET":
                offset = [float(next(words)) for _ in range(3)]
                if stack[-1] >= 0:
                    offsets[stack[-1]] = offset
            elif word == "CHANNELS":
                channels[stack[-1]] = [next(words) for _ in range(int(next(words)))]
            else:
                raise BvhError(f"{path}: {word!r} in the hierarchy, expected ROOT, JOINT, End, OFFSET or CHANNELS")
    except (StopIteration, IndexError, ValueError) as error:
        if isinstance(error, BvhError):
            raise
        raise BvhError(f"{path}: the hierarchy is cut short or malformed") from None
    if not names or stack or len(set(names)) != len(names) or parents.count(-1) != 1:
        raise BvhError(f"{path}: the hierarchy must be one tree of named joints with matching braces")
    for channel in (c for each in channels for c in each):
        if channel[1:] not in ("position", "rotation") or channel[0] not in _AXES:
            raise BvhError(f"{path}: unknown channel {channel!r}, expected Xposition … Zrotation")
    return tuple(names), tuple(parents), np.array(offsets), channels


def _motion(tail: str, width: int, path: str | Path) -> tuple[float, Array]:
    words = tail.split(maxsplit=5)  # Frames: N Frame Time: dt values
    if len(words) < 5 or words[0] != "Frames:" or words[2:4] != ["Frame", "Time:"]:
        raise BvhError(f"{path}: MOTION must be followed by 'Frames: N' and 'Frame Time: seconds'")
    try:
        frames, frame_time = int(words[1]), float(words[4])
    except ValueError:
        raise BvhError(f"{path}: frames {words[1]!r} and frame time {words[4]!r} must be numbers") from None
    if not 0 < frames <= MAX_FRAMES:
        raise BvhError(f"{path}: {frames} frames, expected 1 to {MAX_FRAMES}")
    if not (np.isfinite(frame_time) and frame_time > 0):
        raise BvhError(f"{path}: frame time {words[4]} must be above 0 seconds")
    body = words[5].split() if len(words) > 5 else []
    if len(body) != frames * width:
        raise BvhError(f"{path}: {len(body)} values, but {frames} frames of {width} channels need {frames * width}")
    try:
        values = np.array(body, dtype=float).reshape(frames, width)
    except ValueError as error:
        raise BvhError(f"{path}: {error}") from None
    if not np.isfinite(values).all():
        raise BvhError(f"{path}: frame {int(np.argmin(np.isfinite(values).all(1)))} holds NaN or infinity")
    return frame_time, values


def _unpack(values: Array, offsets: Array, channels: list[list[str]]) -> tuple[Array, Array]:
    positions = np.repeat(offsets[None], len(values), axis=0)
    quats = np.zeros((len(values), len(channels), 4))
    quats[..., 0] = 1.0
    column = 0
    for j, names in enumerate(channels):
        for name in names:
            if name.endswith("position"):
                positions[:, j, "XYZ".index(name[0])] = values[:, column]
            else:
                turn = axis_angle_to_quat(_AXES[name[0]], np.radians(values[:, column]))
                quats[:, j] = quat_mul(quats[:, j], turn)
            column += 1
    return positions, quats


def _rest_frames(table: SkeletonTable) -> dict[str, Array]:
    """Matrix (3, 3) by file name, whose columns are the joint's local axes in canonical coordinates in the T-pose."""
    frames = {}
    for name, letters in table.axes.items():
        axes = np.array([_DIRECTIONS[c] for c in letters], float).T
        pitch = quat_to_matrix(axis_angle_to_quat([0.0, 1.0, 0.0], table.pitch.get(name, 0.0)))
        frames[name] = pitch @ axes
    return frames


def _canonical(raw: RawBvh, table: SkeletonTable, path: Path) -> Motion:
    rest = _rest_frames(table)
    turn, where = _forward(raw)
    turns: dict[str, Array] = {}
    offsets = np.zeros((len(SMPL_JOINTS), 3))
    for j, name in enumerate(SMPL_JOINTS):
        if name in table.joints:
            file_name = table.joints[name]
            turns[name] = _Y_UP_TO_Z_UP @ turn[:, raw.names.index(file_name)] @ rest[file_name].T
            if j:
                parent = _nearest_mapped(SMPL_PARENTS[j], table)
                bone = raw.positions[:, raw.names.index(file_name)].mean(axis=0) * table.unit
                offsets[j] = rest[table.joints[parent]] @ bone
    for j, name in enumerate(SMPL_JOINTS):
        if name not in table.joints:
            child = SMPL_PARENTS.index(j)
            offsets[j] = offsets[child] = offsets[child] / 2
            turns[name] = turns[SMPL_JOINTS[SMPL_PARENTS[j]]]
    matrices = np.stack([turns[n] for n in SMPL_JOINTS], axis=1)
    local = matrices.copy()
    for j, above in enumerate(SMPL_PARENTS):
        if above >= 0:
            local[:, j] = np.swapaxes(matrices[:, above], -1, -2) @ matrices[:, j]
    root = where[:, raw.names.index(table.joints["pelvis"])] @ _Y_UP_TO_Z_UP.T * table.unit
    skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, offsets, table.foot_height)
    quat = quat_continuous(matrix_to_quat(local))
    return Motion(root, quat, raw.fps, skeleton, source=Source(f"file {path.name}", licence=table.licence))


def _nearest_mapped(joint: int, table: SkeletonTable) -> str:
    while SMPL_JOINTS[joint] not in table.joints:
        joint = SMPL_PARENTS[joint]
    return SMPL_JOINTS[joint]


def _forward(raw: RawBvh) -> tuple[Array, Array]:
    """World rotations (T, J, 3, 3) and positions (T, J, 3) in the file's frame and unit."""
    local = quat_to_matrix(raw.quats)
    turn, where = local.copy(), raw.positions.copy()
    for j, parent in enumerate(raw.parents):
        if parent >= 0:
            turn[:, j] = turn[:, parent] @ local[:, j]
            where[:, j] = where[:, parent] + np.einsum("tij,tj->ti", turn[:, parent], raw.positions[:, j])
    return turn, where
