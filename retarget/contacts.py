"""When a human foot stands: planted, flat and still."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.features import CONTACT_SPEED
from motiongen.motion import FOOT_JOINTS, Motion, Skeleton
from motiongen.rotation import Array

Flags = NDArray[np.bool_]

# A foot joint stands below the speed of the contact label and this height above where it is on a flat sole. That is
# half the label's height: a foot that is to be pinned flat must really be down. It lets go only above 1.3 times both
# (hysteresis), so that noise about the threshold does not make it flicker.
STAND_HEIGHT = 0.05  # m
RELEASE = 1.3
# Somebody whose lowest foot joint is higher than this is in the air.
SUPPORT_HEIGHT = 0.03  # m
# A stance shorter than this is no step, and a gap shorter than this is no swing.
SHORTEST = 0.1  # s


def supported(motion: Motion) -> Flags:
    """(T,) booleans: some foot joint is no more than SUPPORT_HEIGHT above where it is on a flat sole."""
    return above_floor(motion.skeleton, feet(motion), _floor(motion)).min(1) < SUPPORT_HEIGHT


def pelvis_height(motion: Motion) -> Array:
    """(T,) metres of the pelvis above the floor of the clip (`_floor`)."""
    return motion.root_pos[:, 2] - _floor(motion)


def planted(motion: Motion) -> dict[str, Flags]:
    """(T,) booleans for `left_ankle` and `right_ankle`: ankle and toe of that foot both touch the floor.

    Taken from `motion.contacts` where it has them, else from speed and height.
    """
    touch = motion.contacts if motion.contacts is not None else _touching(motion)
    shortest = round(SHORTEST * motion.fps)
    out = {}
    for i, foot in enumerate(("left_ankle", "right_ankle")):
        both = touch[:, 2 * i] & touch[:, 2 * i + 1]
        out[foot] = _without_short(~_without_short(~both, shortest, inner=True), shortest, inner=False)
    return out


def runs(flags: Flags) -> list[tuple[int, int]]:
    """Start and end (exclusive) of every stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def above_floor(skeleton: Skeleton, feet: Array, floor: float) -> Array:
    """(T, 4) metres of the FOOT_JOINTS, at `feet` (T, 4, 3), over where they are on a flat sole, on a floor at z =
    `floor`.
    """
    return feet[..., 2] - np.tile(skeleton.foot_height, 2) - floor


def slow_and_low(speed: Array, height: Array, ease: float = 1.0) -> Flags:
    """Whether a foot joint at `speed` (m/s) and `height` (m, `above_floor`) stands; with RELEASE as `ease`, whether one
    that stood still does.
    """
    return (speed < ease * CONTACT_SPEED) & (height < ease * STAND_HEIGHT)


def feet(motion: Motion) -> Array:
    """(T, 4, 3) where the FOOT_JOINTS are in the world."""
    return motion.positions()[:, [motion.skeleton.index(name) for name in FOOT_JOINTS]]


def _touching(motion: Motion) -> Flags:
    joints = feet(motion)
    speed = np.zeros(joints.shape[:2])
    if len(motion) > 1:
        speed = np.linalg.norm(np.gradient(joints, 1 / motion.fps, axis=0), axis=-1)
    height = above_floor(motion.skeleton, joints, _floor(motion))
    touch, keep = slow_and_low(speed, height), slow_and_low(speed, height, RELEASE)
    for t in range(1, len(touch)):
        touch[t] |= touch[t - 1] & keep[t]
    return touch


def _floor(motion: Motion) -> float:
    """Where the lowest joint is in the lowest twentieth of the frames: a jump does not move it, nor a handstand."""
    low = above_floor(motion.skeleton, feet(motion), 0.0).min(1)
    return float(np.percentile(np.minimum(low, motion.positions()[..., 2].min(1)), 5))


def _without_short(flags: Flags, shortest: int, *, inner: bool) -> Flags:
    """`flags` less the stretches under `shortest` frames; `inner` spares those that touch the clip's ends."""
    out = flags.copy()
    for start, end in runs(flags):
        at_end = start == 0 or end == len(flags)
        if end - start < shortest and not (inner and at_end):
            out[start:end] = False
    return out
