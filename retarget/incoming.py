"""Frames of a motion as they come, at the rate of the stream and without corners: what `Motion.resampled` and smoothing
make of a clip, for one whose end nobody knows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from motiongen.motion import Motion, cut
from motiongen.rotation import quat_continuous, quat_normalize
from retarget.timeline import BINOMIAL

ROUNDING = 1e-6  # frames
HALF = len(BINOMIAL) // 2  # frames that smoothing needs on either side


@dataclass(frozen=True)
class Incoming:
    """How many frames have come (`received`, at the motion's own rate) and gone out to smoothing (`sampled`, at the
    stream's); the `last` one that came, and the newest 2 · HALF that smoothing still needs.
    """

    received: int = 0
    sampled: int = 0
    last: Motion | None = None
    corners: Motion | None = None


def taken(state: Incoming, motion: Motion, fps: float, *, smooth: bool) -> tuple[Incoming, Motion | None]:
    """The state after the frames of `motion`, and the frames at `fps` that are certain now; None where there are none.

    A frame between two of the motion waits for the later of them. `smooth` takes the corners away that sampling makes
    there, which costs HALF frames of delay.
    """
    known = motion if state.last is None else joined(state.last, motion)
    received, begin = state.received + len(motion), state.sampled
    end = int((received - 1) * fps / motion.fps + ROUNDING) + 1
    last = cut(motion, len(motion) - 1, len(motion))
    state = replace(state, received=received, sampled=max(begin, end), last=last)
    if end <= begin:
        return state, None
    at = np.arange(begin, end) * motion.fps / fps - (received - len(known))
    new = known.sampled(np.clip(at, 0, len(known) - 1), fps)
    if not smooth:
        return state, new
    before = [cut(new, 0, 1)] * HALF if state.corners is None else [state.corners]  # held, as at a clip's ends
    new = joined(*before, new)
    return replace(state, corners=cut(new, max(len(new) - 2 * HALF, 0), len(new))), _without_corners(new)


def joined(*motions: Motion) -> Motion:
    """One after the other; the rate and all else are the last one's."""
    flags = [m.contacts for m in motions if m.contacts is not None]
    return replace(
        motions[-1],
        root_pos=np.concatenate([m.root_pos for m in motions]),
        joint_quat=np.concatenate([m.joint_quat for m in motions]),
        contacts=np.concatenate(flags) if flags else None,
    )


def _without_corners(motion: Motion) -> Motion | None:
    """`motion` under a binomial window, less the HALF frames at either end that it does not cover."""
    count = len(motion) - 2 * HALF
    if count < 1:
        return None
    quat = quat_continuous(motion.joint_quat)
    pos = sum(w * motion.root_pos[i : i + count] for i, w in enumerate(BINOMIAL))
    mean = sum(w * quat[i : i + count] for i, w in enumerate(BINOMIAL))
    flags = None if motion.contacts is None else motion.contacts[HALF : HALF + count]
    return replace(motion, root_pos=pos, joint_quat=quat_normalize(mean), contacts=flags)
