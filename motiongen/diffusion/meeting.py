"""Joints of which several passes speak at the same time, turned from what one says to what the other says.

Mixed as numbers, the six of an arm that hangs and the six of a raised one can come near to nothing, which stands for
any turn: the arm flips within a frame. Mixed as quaternions they are a way from one to the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.mixing import Span
from motiongen.features import TURNS
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS
from motiongen.nn import Floats
from motiongen.rotation import (
    Array,
    matrix_from_6d,
    matrix_to_6d,
    matrix_to_quat,
    quat_conj,
    quat_continuous,
    quat_mul,
    quat_normalize,
    quat_to_matrix,
)


@dataclass(frozen=True)
class Meeting:
    """The frames `start` … `stop` − 1, in which the spans `voices` speak of the same joints: of joint j in frame i,
    voice k has the share `share[k, i, j]`."""

    start: int
    stop: int
    voices: tuple[int, ...]
    share: Floats


def meetings(spans: Sequence[Span], share: Sequence[Floats]) -> list[Meeting]:
    """Where two or more of `spans` have a share (stop − start, 140) in the turn of a joint."""
    total = max(span.stop for span in spans)
    turns = np.zeros((len(spans), total, len(SMPL_JOINTS)), np.float32)
    for k, span in enumerate(spans):
        turns[k, span.start : span.stop] = share[k][:, TURNS.start : TURNS.stop : 6]
    several = (turns > 0).sum(0) > 1
    speaking = [
        tuple(np.flatnonzero((turns[:, i] > 0)[:, several[i]].any(1)).tolist()) if several[i].any() else ()
        for i in range(total)
    ]
    out, start = [], 0
    for voices, frames in groupby(speaking):
        stop = start + len(list(frames))
        if voices:
            out.append(Meeting(start, stop, voices, turns[list(voices), start:stop]))
        start = stop
    return out


def mixed_turns(said: Sequence[NDArray[np.floating]], share: NDArray[np.floating]) -> Array:
    """The mean of orientations `said` n × (T, 132), which need not be orthonormal, by `share` (n, T, 22): (T, 132).

    A mean of unit quaternions. Which of the two that stand for a turn is meant follows from the joints: none is thought
    to be turned on its parent by more than half a circle more in one than in the other. The result is as long as the
    numbers that it is the mean of, since what a network is not sure of it says with short ones.
    """
    six = np.stack(said).reshape(len(said), len(said[0]), len(SMPL_JOINTS), 6)
    quat = _alike(matrix_to_quat(matrix_from_6d(six)))
    # A little of the foremost, so that there is a mean of opposites too, and of joints of which none of these speaks.
    mean = quat_normalize((share[..., None] * quat).sum(0) + 1e-6 * quat[share.argmax(0), *np.indices(share.shape[1:])])
    length = (share * np.linalg.norm(six, axis=-1)).sum(0) / (np.sqrt(2) * np.maximum(share.sum(0), 1e-6))
    return (matrix_to_6d(quat_to_matrix(mean)) * length[..., None]).reshape(len(mean), -1)


def _alike(turn: Array) -> Array:
    """Orientations (n, T, 22, 4) with signs that make them continuous in time, and on the side of the first's."""
    out = np.empty_like(turn)
    for joint, parent in enumerate(SMPL_PARENTS):
        local = turn[:, :, joint] if parent < 0 else quat_mul(quat_conj(turn[:, :, parent]), turn[:, :, joint])
        local = np.swapaxes(quat_continuous(np.swapaxes(local, 0, 1)), 0, 1)
        side = np.where((local * local[:1]).sum((1, 2)) < 0, -1.0, 1.0)
        local = local * side[:, None, None]
        out[:, :, joint] = local if parent < 0 else quat_mul(out[:, :, parent], local)
    return out
