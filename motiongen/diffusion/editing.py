"""Part of somebody's clip drawn anew: some of its frames, some parts of the body, or some parts in some frames.

The clip goes to the network at 30 frames a second and at the size of its skeleton, in crops around what is to be drawn.
What comes back is brought to the clip's own rate and size and put into it; all else of the clip stays what it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from motiongen.compose.leg_ik import leg_bones
from motiongen.compose.parts import PARTS, joints_of
from motiongen.diffusion.draw import Drawing, draw, whole
from motiongen.diffusion.finish import slip, smoothed_over_five
from motiongen.diffusion.keeping import Kept, arriving, eased, settled
from motiongen.diffusion.planting import planted
from motiongen.diffusion.ranges import RangeError, kept_frames, runs
from motiongen.diffusion.said import Said
from motiongen.diffusion.samplers import Denoiser
from motiongen.diffusion.weights import Weights
from motiongen.features import CONTACTS, FPS, HEIGHT, PLANAR, features_to_motion, motion_to_features
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion, Skeleton
from motiongen.nn import Floats
from motiongen.rotation import (
    Array,
    matrix_from_6d,
    matrix_to_6d,
    matrix_to_quat,
    quat_conj,
    quat_continuous,
    quat_mul,
    quat_rotate,
    quat_to_matrix,
    yaw_of_quat,
    yaw_quat,
)

CONTEXT = 60  # frames of the clip on either side that the network sees
EASE_S = 0.2
_LENGTHS = [PLANAR.start, PLANAR.start + 1, HEIGHT]


@dataclass(frozen=True)
class Edit:
    """What of `clip` is drawn anew: the `joints` in the frames `free` (T,). Where the pelvis is among them, so is the
    way that it goes."""

    clip: Motion
    free: NDArray[np.bool_]
    joints: tuple[int, ...]


def edit_of(clip: Motion, keep: str, parts: Sequence[str]) -> Edit:
    """What `keep` (see `motiongen.diffusion.ranges`) and `parts` (of `motiongen.compose.parts`) leave to draw.

    Without `keep` that is all frames, without `parts` the whole body. Raises RangeError where neither is given or a
    range is bad, ValueError for unknown parts and for another skeleton than the 22 joints of SMPL.
    """
    if clip.skeleton.names != SMPL_JOINTS:
        raise ValueError(f"editing needs the {len(SMPL_JOINTS)} joints of SMPL, not {clip.skeleton.names}")
    if not keep and not parts:
        raise RangeError("nothing says what to draw anew: frames to keep (0:1s,3s:) or parts of the body (left_arm)")
    joints = joints_of(parts) if parts else tuple(range(len(SMPL_JOINTS)))
    kept = kept_frames(keep, len(clip), clip.fps) if keep else np.zeros(len(clip), bool)
    return Edit(clip, ~kept, joints)


def edited(model: Weights, edit: Edit, said: Said, seed: int, how: Drawing) -> Motion:
    """The clip of `edit` with what is free in it drawn by `model`, told `said` (one condition).

    On the clip's skeleton, at its rate, with its labels and source; contacts are dropped.
    """
    clip = edit.clip
    larger = _leg(model) / sum(leg_bones(clip.skeleton, "left"))
    kept = _kept(edit, larger)
    out = np.array(kept.features)
    for number, (start, stop) in enumerate(_crops(~kept.frames)):
        out[start:stop] = _drawn(model, kept.cut(start, stop), said, seed + number, how)
    out[:, _LENGTHS] /= larger
    drawn = features_to_motion(out, clip.skeleton)
    if set(PARTS["legs"]) <= set(kept.joints):
        drawn = planted(drawn, out[:, CONTACTS], ~kept.frames)
    anchor = int(kept.frames.argmax()) if 0 in kept.joints else 0  # where the path is the clip's
    return _composed(edit, drawn, anchor)


def _skeleton(model: Weights) -> Skeleton:
    return Skeleton(SMPL_JOINTS, SMPL_PARENTS, model.offsets.astype(float))


def _leg(model: Weights) -> float:
    thigh, shin = leg_bones(_skeleton(model), "left")
    return thigh + shin


def _kept(edit: Edit, larger: float) -> Kept:
    """The clip as the network sees it, its lengths `larger` times what they are."""
    at_30 = edit.clip.resampled(FPS)
    features = motion_to_features(at_30).astype(float)
    features[:, _LENGTHS] *= larger
    at = np.clip(np.arange(len(at_30)) * edit.clip.fps / FPS, 0, len(edit.free) - 1)
    free = edit.free[np.floor(at).astype(int)] | edit.free[np.ceil(at).astype(int)]
    return Kept(features, ~free, edit.joints, quat_to_matrix(at_30.joint_quat))


def _crops(free: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Stretches with all that is `free` (T,) and, around it, what the network is to see."""
    seen = np.zeros_like(free)
    for start, stop in runs(free):
        seen[max(0, start - CONTEXT) : stop + CONTEXT] = True
    return runs(seen)


def _drawn(model: Weights, kept: Kept, said: Said, seed: int, how: Drawing) -> Array:
    """Features (T, 140) of a crop."""
    count = len(kept.frames)

    def constrain(denoise: Denoiser) -> Denoiser:
        def constrained(x: Floats, t: float) -> Floats:
            x0 = denoise(x, t)
            x0[0, :count] = (settled(x0[0, :count] * model.std + model.mean, kept) - model.mean) / model.std
            return x0

        return constrained

    x = draw(model, whole(model, said, count), [count], [seed], how, constrain)
    features = (x[0, :count] * model.std + model.mean).astype(float)
    return _finished(features, kept, _skeleton(model))


def _finished(features: Array, kept: Kept, skeleton: Skeleton) -> Array:
    """Smoothed, and with the slip of feet off the path as far as it still arrives; see `motiongen.diffusion.finish`."""
    features = settled(np.where(kept.frames[:, None], features, smoothed_over_five(features)), kept)
    if 0 in kept.joints:
        free = ~kept.frames[:, None]
        features[:, PLANAR] -= free * slip(features_to_motion(features, skeleton), features[:, CONTACTS])
        features = arriving(features, kept)
    return features


def _composed(edit: Edit, drawn: Motion, anchor: int) -> Motion:
    """The clip with what `drawn`, at 30 frames a second, has for its free frames and joints; `anchor` is a frame of it
    that is kept."""
    clip, kept = edit.clip, ~edit.free
    at = np.arange(len(clip), dtype=float) * FPS / clip.fps
    raw = _cubic(_in_world(_placed(drawn, clip.resampled(FPS), anchor)), at)
    ease = max(2, round(EASE_S * clip.fps))
    world = eased(raw, _in_world(clip), kept, ease)
    turn = matrix_to_quat(matrix_from_6d(world[:, 3:].reshape(len(clip), -1, 6)))
    quat = np.array(clip.joint_quat)
    for j, parent in enumerate(SMPL_PARENTS):
        if j in edit.joints:
            quat[:, j] = turn[:, j] if parent < 0 else quat_mul(quat_conj(turn[:, parent]), turn[:, j])
        else:  # hangs on what may have been turned
            turn[:, j] = quat[:, j] if parent < 0 else quat_mul(turn[:, parent], quat[:, j])
    quat[kept] = clip.joint_quat[kept]
    root = world[:, :3] if 0 in edit.joints else clip.root_pos
    return replace(clip, root_pos=root, joint_quat=quat_continuous(quat), contacts=None)


def _placed(drawn: Motion, clip: Motion, frame: int) -> Motion:
    """`drawn` turned about the vertical and moved, so that in `frame` it is where `clip` is."""
    turn = yaw_quat(yaw_of_quat(clip.joint_quat[frame, 0]) - yaw_of_quat(drawn.joint_quat[frame, 0]))
    quat = np.array(drawn.joint_quat)
    quat[:, 0] = quat_mul(turn, quat[:, 0])
    shift = (clip.root_pos[frame] - quat_rotate(turn, drawn.root_pos[frame])) * [1, 1, 0]
    return replace(drawn, root_pos=quat_rotate(turn, drawn.root_pos) + shift, joint_quat=quat)


def _in_world(motion: Motion) -> Array:
    """Place of the pelvis and orientation of all joints in the world, (T, 3 + 22·6)."""
    turn = matrix_to_6d(quat_to_matrix(motion.global_quat()))
    return np.concatenate([motion.root_pos, turn.reshape(len(motion), -1)], axis=1)


def _cubic(values: Array, at: Array) -> Array:
    """`values` (T, n) between its frames, at `at` (N,), by Catmull and Rom's cubic (1974): speeds are continuous."""
    padded = np.concatenate([values[:1], values, values[-1:], values[-1:]])
    low = np.clip(np.floor(at).astype(int), 0, len(values) - 1)
    u = np.clip(at - low, 0.0, 1.0)[:, None]
    a, b, c, d = (padded[low + i] for i in range(4))
    return b + 0.5 * u * (c - a + u * (2 * a - 5 * b + 4 * c - d + u * (3 * (b - c) + d - a)))
