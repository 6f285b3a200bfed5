"""Feet that stand, held where they stand by bending the legs: for a path that may not be changed to suit the feet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from motiongen.compose.leg_ik import sinking, with_ankles
from motiongen.diffusion.ranges import runs
from motiongen.motion import FOOT_JOINTS, Motion
from motiongen.rotation import Array, quat_continuous

_SURE = 0.5  # from this on a foot is taken to touch the floor
_MOST = 0.2  # m that a foot is moved: where it slid farther, a leg might not reach, and it goes on sliding the rest


def planted(motion: Motion, touch: Array, free: NDArray[np.bool_]) -> Motion:
    """`motion` with the ankles moved, in its frames `free` (T,), so that what touches the floor stays where it is.

    `touch` (T, 4), 0…1, in the order of `FOOT_JOINTS`. A foot that stood when the free frames began stays there, one
    that stands when they end comes to stand there, and any other is held in the middle of where it slid. Between, a
    foot goes from one place to the next. The pelvis sinks where a leg is too short.

    Raises ValueError where a foot is out of reach at any height.
    """
    feet = motion.positions()[:, [motion.skeleton.index(name) for name in FOOT_JOINTS]]
    ankles = feet[:, ::2].copy()
    for side in (0, 1):
        pair = slice(2 * side, 2 * side + 2)
        ankles[:, side, :2] += _offset(feet[:, pair, :2], touch[:, pair] > _SURE, free)
    sunk = replace(motion, root_pos=motion.root_pos - np.outer(sinking(motion, ankles), [0.0, 0.0, 1.0]))
    return replace(sunk, joint_quat=quat_continuous(with_ankles(sunk, ankles)))


def _offset(foot: Array, touch: NDArray[np.bool_], free: NDArray[np.bool_]) -> Array:
    """(T, 2) in metres by which a foot, its ankle and toe at `foot` (T, 2, 2), is to be moved."""
    stays = touch[1:] & touch[:-1]
    step = (np.diff(foot, axis=0) * stays[..., None]).sum(1) / np.maximum(stays.sum(1), 1)[:, None]
    out, placed = np.zeros((len(foot), 2)), ~free
    for start, stop in runs(stays.any(1) & (free[1:] | free[:-1])):
        rows = slice(start, stop + 1)  # frames: a step leads to the next one
        slid = np.concatenate([np.zeros((1, 2)), np.cumsum(step[start:stop], axis=0)])
        if free[start] and free[stop]:
            slid -= slid.mean(0)
        elif free[start]:
            slid -= slid[-1]
        elif not free[stop]:  # it must come to stand elsewhere than it stood: it slides there evenly
            slid -= np.linspace(0, 1, len(slid))[:, None] * slid[-1]
        far = np.linalg.norm(slid, axis=1).max()
        out[rows], placed[rows] = -slid * min(1.0, _MOST / max(far, 1e-9)), True
    for start, stop in runs(~placed):
        before = out[start - 1] if start else out[min(stop, len(out) - 1)]
        after = out[stop] if stop < len(out) else before
        u = np.arange(1, stop - start + 1)[:, None] / (stop - start + 1)
        out[start:stop] = before + (after - before) * u * u * (3 - 2 * u)
    return out
