"""How what is drawn meets what is kept: eased into kept frames, its path led to them, kept joints hung on drawn ones.

All of it changes the estimate of the clean features at every denoising pass (MDM, Sec. 3, Editing: inpainting), so that
the network lays the rest out around it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from motiongen.features import CONTACTS, FPS, PLANAR, TURNS, YAW, root_path
from motiongen.motion import FOOT_JOINTS, SMPL_JOINTS, SMPL_PARENTS
from motiongen.rotation import Array, matrix_from_6d, matrix_to_6d, quat_rotate, yaw_quat

EASE = 24  # frames in which what is drawn may differ from where it would have gone, to meet what is kept
_ROOT = slice(0, 3)
_THIRD = np.array([-1.0, 3.0, -3.0, 1.0])


@dataclass(frozen=True)
class Kept:
    """What is kept of a clip of T frames at 30 a second: `features` (T, 140) of the clip, in which the frames `frames`
    (T,) are kept whole, and in the others all joints but `joints`, turned on their parents as in `local` (T, 22, 3, 3).

    Where the pelvis is among the `joints`, the way that it goes is drawn too.
    """

    features: Array
    frames: NDArray[np.bool_]
    joints: tuple[int, ...]
    local: Array

    def cut(self, start: int, stop: int) -> Kept:
        """The frames `start` … `stop` − 1."""
        rows = slice(start, stop)
        return Kept(self.features[rows], self.frames[rows], self.joints, self.local[rows])


def settled(drawn: Array, kept: Kept) -> Array:
    """Features (T, 140) as near to `drawn` as what is kept allows."""
    out = np.array(kept.features)
    turns = [slice(TURNS.start + 6 * j, TURNS.start + 6 * j + 6) for j in kept.joints]
    touch = [CONTACTS.start + i for i, name in enumerate(FOOT_JOINTS) if SMPL_JOINTS.index(name) in kept.joints]
    columns = np.concatenate([*(np.arange(s.start, s.stop) for s in turns), touch]).astype(int)
    if 0 in kept.joints:
        steps = kept.frames & np.append(kept.frames[1:], kept.frames[-1])  # the way from a frame to the next
        out[:, _ROOT] = eased(drawn[:, _ROOT], kept.features[:, _ROOT], steps, EASE)
        columns = np.append(columns, _ROOT.stop)
    out[:, columns] = eased(drawn[:, columns], kept.features[:, columns], kept.frames, EASE)
    if 0 in kept.joints:
        out[:, _ROOT] = arriving(out, kept)[:, _ROOT]
    return _hung(out, kept)


def eased(drawn: Array, known: Array, kept: NDArray[np.bool_], most: int) -> Array:
    """`known` (T, n) where `kept` (T,), else `drawn` (T, n), changed in the `most` frames nearest to a kept one so that
    it goes over into that in place, speed and acceleration.

    A least-squares problem in third differences, the least jerk (Flash & Hogan 1985): of the outcome in stretches of
    four frames that hold a kept one, of the change in all others, so that what moves there still does. What is `drawn`
    in kept frames does not matter.
    """
    out = np.where(kept[:, None], known, drawn)
    nearby = np.convolve(kept, np.ones(2 * most + 1), "same")[: len(kept)] > 0
    rows = np.flatnonzero(nearby & ~kept)
    fours = np.arange(len(kept) - 3)[:, None] + np.arange(4)
    fours = fours[np.isin(fours, rows).any(1)]
    if len(fours):
        third = np.zeros((len(fours), len(kept)))
        np.put_along_axis(third, fours, _THIRD[None], axis=1)
        wanted = -(third @ out) * kept[fours].any(1)[:, None]
        out[rows] += np.linalg.lstsq(third[:, rows], wanted, rcond=None)[0]
    return out


def arriving(features: Array, kept: Kept) -> Array:
    """`features` (T, 140) with the rates of the root changed between kept frames, until its path leads from one to the
    next: heading first, then place.

    The least change, most of it in the middle (Wang et al. 2022, DDNM: the null space of a linear constraint, here with
    weights).
    """
    out = np.array(features)
    known = np.flatnonzero(kept.frames)
    yaw, place = root_path(kept.features)
    for a, b in pairwise(known):
        if b - a == 1:
            continue
        steps = slice(a, b)
        near = np.minimum(np.arange(1, b - a + 1), np.arange(b - a, 0, -1))  # steps to the nearer kept frame
        share = np.minimum(near / EASE, 1.0)
        share /= share.sum()
        short = yaw[b] - yaw[a] - out[steps, YAW].sum() / FPS
        out[steps, YAW] += FPS * share * ((short + np.pi) % (2 * np.pi) - np.pi)
        turned = yaw[a] + np.concatenate([[0.0], np.cumsum(out[steps, YAW])[:-1]]) / FPS
        heading = yaw_quat(turned)
        planar = np.concatenate([out[steps, PLANAR], np.zeros((b - a, 1))], axis=1)
        missing = FPS * (place[b] - place[a]) * [1, 1, 0] - quat_rotate(heading, planar).sum(0)
        back = quat_rotate(heading * [1, -1, -1, -1], missing)
        out[steps, PLANAR] += share[:, None] * back[:, :2]
    return out


def _hung(features: Array, kept: Kept) -> Array:
    """`features` with the joints that are kept turned on their parents as they were, however those are turned now."""
    moved = set(kept.joints)
    turn = matrix_from_6d(features[:, TURNS].reshape(len(features), len(SMPL_JOINTS), 6))
    for j, parent in enumerate(SMPL_PARENTS):
        if j not in moved and parent in moved:
            turn[:, j] = turn[:, parent] @ kept.local[:, j]
            moved.add(j)
    out = np.array(features)
    free = ~kept.frames
    out[free, TURNS] = matrix_to_6d(turn).reshape(len(features), -1)[free]
    return out
