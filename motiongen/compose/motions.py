"""One motion of several: the upper body of one on the legs of another, or one after another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from motiongen.compose.parts import PARTS, joints_of
from motiongen.compose.seams import find_loop, find_seam, joined, on_skeleton
from motiongen.measure.swings import smoothed
from motiongen.motion import SMPL_JOINTS, Label, Motion, Source
from motiongen.rotation import Array, quat_conj, quat_continuous, quat_mul, quat_normalize, quat_to_rotvec, slerp

SWAY_S = 2.0  # s over which the carrying body is averaged: no strides are left, a turn around a corner is
BLEND_S = 0.4  # s in which a part goes over to the other clip where that begins or ends in the middle
SEAM_S = 0.6  # s in which one motion goes over into the next: a step takes about as long
HAND = 0.08  # m from the wrist to the middle of the hand

_STILL = np.array([1.0, 0.0, 0.0, 0.0])
_CHEST = SMPL_JOINTS.index("spine3")
_BONES = (("pelvis", "spine3"), ("spine3", "neck"), ("neck", "head"))


def overlay(lower: Motion, upper: Motion, parts: Sequence[str] = ("upper_body",), *, start_s: float = 0.0) -> Motion:
    """`lower` with the named parts of the body (see `compose.parts`) moving as in `upper`, from `start_s` on.

    The result is as long as `lower`, on its skeleton and at its frames a second; root, pelvis and every joint that is
    not named stay exactly as they are. Where `upper` begins after, or ends before, `lower`, the parts go over from and
    to the movements of `lower` within 0.4 s. Trunk and head are turned as in `upper` on a body without the sway of the
    strides, so that the pelvis of a walker does not tilt what is carried; arms hang on the chest that is there. The
    labels are those of both, of `upper` for the named parts.

    Raises ValueError for parts that are unknown or reach below the spine, another skeleton than SMPL's 22 joints, or a
    `start_s` that is not within `lower`.
    """
    joints = joints_of(parts)
    if below := set(joints) & set(PARTS["lower_body"]):
        raise ValueError(f"only parts above the pelvis can be laid over another clip, not {SMPL_JOINTS[min(below)]}")
    for motion in (lower, upper):
        _need_smpl(motion)
    if not 0 <= start_s <= lower.duration:
        raise ValueError(f"the upper clip must start within the lower's {lower.duration:.2f} s, not at {start_s:g} s")
    upper = upper.resampled(lower.fps) if upper.fps != lower.fps else upper
    first = round(start_s * lower.fps)
    rows = np.clip(np.arange(len(lower)) - first, 0, len(upper) - 1)  # held while it blends in and out
    carried = _carried(lower, upper, rows, joints)
    share = _share(len(lower), first, first + len(upper) - 1, lower.fps)
    quat = lower.joint_quat.copy()
    for joint in joints:
        quat[:, joint] = slerp(lower.joint_quat[:, joint], carried[:, joint], share)
    end_s = min(start_s + upper.duration, lower.duration)
    said = tuple(
        Label(start_s + label.start_s, min(start_s + label.end_s, end_s), label.text, tuple(parts))
        for label in upper.labels
        if start_s + label.start_s < end_s
    )
    return replace(
        lower,
        joint_quat=quat_continuous(quat),
        labels=(*lower.labels, *said),
        source=composed_of((lower, upper), "+"),
    )


def sequence(motions: Sequence[Motion], *, blend_s: float = SEAM_S) -> Motion:
    """One motion after another, each turned and moved to where the one before it has come to.

    On the skeleton and at the frames a second of the first. A motion that stands at its end or beginning is there as a
    whole, one on its way may lose a stride to where the next fits best: a foot that stands in both stays on its spot,
    the other steps over, all else is inertialized over `blend_s` (see `compose.seams`). Labels keep their times.

    Raises ValueError for no motions, `blend_s` not above 0, another skeleton than SMPL's 22 joints, and motions that
    do not go over into each other.
    """
    if not motions:
        raise ValueError("a sequence needs one motion or more")
    if not blend_s > 0:
        raise ValueError(f"blend_s must be above 0, not {blend_s:g}")
    out, since = motions[0], 0  # the last part of `out` begins in its frame `since`: no seam reaches further back
    for motion in motions:
        _need_smpl(motion)
    for motion in motions[1:]:
        then = on_skeleton(motion.resampled(out.fps) if motion.fps != out.fps else motion, out.skeleton)
        seam = find_seam(_cut(out, since), then, blend_s)
        seam = replace(seam, end=seam.end + since)
        begins = (seam.end - seam.start) / out.fps  # of the next, what was cut off included
        cut_s = seam.end / out.fps
        labels = (*_within(out.labels, 0.0, 0.0, cut_s), *_within(then.labels, begins, cut_s, np.inf))
        since = seam.end
        out = replace(joined(out, then, seam, blend_s), labels=labels)
    return replace(out, source=composed_of(motions, ">")) if len(motions) > 1 else out


def looped(motion: Motion, seconds: float, *, blend_s: float = SEAM_S) -> Motion:
    """A gait going on until it is at least `seconds` long, from where it resembles itself most.

    Labels reach to the end. Raises ValueError where nothing in it comes again.
    """
    _need_smpl(motion)
    out, labels = motion, motion.labels
    while out.duration < seconds:
        seam = find_loop(motion, blend_s)
        out = joined(out, motion, replace(seam, end=seam.end + len(out) - len(motion)), blend_s)
    return replace(out, labels=tuple(replace(label, end_s=out.duration) for label in labels))


def composed_of(motions: Sequence[Motion], sign: str) -> Source:
    """The source of what was made of `motions`, with every licence that it is under."""
    licences = dict.fromkeys(motion.source.licence for motion in motions if motion.source.licence)
    return Source(sign.join(motion.source.generator for motion in motions), licence="; ".join(licences))


def clearance(motion: Motion) -> float:
    """Metres from the middle of the nearer hand to the line through pelvis, chest, neck and head, where least."""
    at = motion.positions()
    least = np.inf
    for side in ("left", "right"):
        elbow, wrist = (at[:, SMPL_JOINTS.index(f"{side}_{name}")] for name in ("elbow", "wrist"))
        fore = wrist - elbow
        hand = wrist + HAND * fore / np.linalg.norm(fore, axis=1, keepdims=True)
        for start, end in _BONES:
            a, b = at[:, SMPL_JOINTS.index(start)], at[:, SMPL_JOINTS.index(end)]
            along = np.sum((hand - a) * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1)
            near = a + np.clip(along, 0, 1)[:, None] * (b - a)
            least = min(least, float(np.linalg.norm(hand - near, axis=1).min()))
    return least


def sharpest(motion: Motion) -> float:
    """The largest angular acceleration of a joint on its parent, in rad/s²."""
    speed = quat_to_rotvec(quat_mul(quat_conj(motion.joint_quat[:-1]), motion.joint_quat[1:])) * motion.fps
    if len(speed) < 2:
        return 0.0
    return float(np.linalg.norm(np.diff(speed, axis=0), axis=-1).max() * motion.fps)


def _need_smpl(motion: Motion) -> None:
    if motion.skeleton.names != SMPL_JOINTS:
        raise ValueError(f"composing needs the {len(SMPL_JOINTS)} joints of SMPL, not {motion.skeleton.names}")


def _cut(motion: Motion, start: int) -> Motion:
    return replace(motion, root_pos=motion.root_pos[start:], joint_quat=motion.joint_quat[start:], contacts=None)


def _within(labels: Sequence[Label], shift_s: float, start_s: float, end_s: float) -> tuple[Label, ...]:
    """`labels` moved by `shift_s`, as far as they then lie between `start_s` and `end_s`."""
    moved = (replace(label, start_s=label.start_s + shift_s, end_s=label.end_s + shift_s) for label in labels)
    cut = (replace(label, start_s=max(label.start_s, start_s), end_s=min(label.end_s, end_s)) for label in moved)
    return tuple(label for label in cut if label.start_s < label.end_s)


def _carried(lower: Motion, upper: Motion, rows: NDArray[np.int_], joints: tuple[int, ...]) -> Array:
    """Local turns (T, 22, 4) of `upper` in its frames `rows`, trunk or head steadied against the sway of `lower`."""
    out = upper.joint_quat[rows]
    torso, head = PARTS["torso"], PARTS["head"]
    if torso[0] in joints:
        out[:, torso] = _steadied(lower.joint_quat[:, 0], upper.joint_quat[:, 0], rows, out[:, torso], lower.fps)
    elif head[0] in joints:
        chests = [motion.global_quat()[:, _CHEST] for motion in (lower, upper)]
        out[:, head] = _steadied(chests[0], chests[1], rows, out[:, head], lower.fps)
    return out


def _steadied(under: Array, own: Array, rows: NDArray[np.int_], chain: Array, fps: float) -> Array:
    """Local turns (T, n, 4) of a `chain` of joints that hangs on `under` (T, 4) and is to end as it did on `own`.

    "As it did": relative to the body averaged over strides. Of what the body under it sways beside its average, each
    joint takes back an equal part.
    """
    own_steady, steady = _averaged(own, fps), _averaged(under, fps)
    wanted = quat_mul(steady, quat_mul(quat_conj(own_steady), own)[rows])  # what the chain is to hang on …
    back = quat_mul(quat_conj(under), wanted)  # … seen from what it does hang on
    out, world, before = np.empty_like(chain), _STILL, under
    for i in range(chain.shape[1]):
        world = quat_mul(world, chain[:, i])
        turn = quat_mul(under, quat_mul(slerp(_STILL, back, (i + 1) / chain.shape[1]), world))
        out[:, i] = quat_mul(quat_conj(before), turn)
        before = turn
    return out


def _averaged(turn: Array, fps: float) -> Array:
    return quat_normalize(smoothed(quat_continuous(turn), fps, SWAY_S))


def _share(count: int, first: int, last: int, fps: float) -> Array:
    """(T,) how much of the upper clip, which is there from frame `first` to `last`, is shown: 0 … 1."""
    ramp = max(1.0, BLEND_S * fps)
    frame = np.arange(count)
    near = np.clip(1 - np.maximum(first - frame, frame - last) / ramp, 0, 1)
    return near * near * (3 - 2 * near)
