"""A BVH file as it is written: any tree, any channel order, in its own frames and unit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motiongen.files import LARGEST, require_plausible, require_timing
from motiongen.rotation import Array, axis_angle_to_quat, quat_mul

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


_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


def read_raw(path: str | Path) -> RawBvh:
    """Read a BVH file as it is: names, offsets, positions and local rotations in the file's own frames and unit.

    Raises BvhError where the file is not BVH, is cut short, holds NaN, zero frames or a frame time that is not above
    0; OSError where it cannot be opened.
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
    if not (np.abs(offsets) <= LARGEST).all():
        raise BvhError(f"{path}: an OFFSET is NaN, infinity or above {LARGEST:g}")
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
        require_timing(frames, 1.0 / frame_time)
        values = np.array(body, dtype=float).reshape(frames, width)
        require_plausible(values)
    except ValueError as error:
        raise BvhError(f"{path}: {error}") from None
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
