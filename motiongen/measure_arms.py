"""What arms, head and trunk do: waves, raised hands, claps, nods, head shakes, bows."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from motiongen.measure_legs import runs
from motiongen.motion import Motion
from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate, yaw_of_quat, yaw_quat
from motiongen.swings import smoothed, turnings

WAVE, PERHAPS_WAVE = 0.06, 0.04  # m from side to side; a hand that is held up drifts by less than 0.03
BELOW = 0.45  # m under the shoulder that a waving hand may be: shy and old people wave at the hip
SWING_S = 0.95  # a swing to one side, of hand or head, that takes longer is a gesture of its own
PERHAPS_SWING_S = 1.3  # though a lazy wave may
RAISED = 0.10  # m over the shoulder, after as much below: an arm stretched level is not a raised hand
NOD = np.radians(9)  # the head bobs by 2–5 degrees as people walk
SHAKE = np.radians(13)  # glances while walking stay below
NOD_S = 0.75  # a head that is down for longer is looking there
PALMS = 0.15  # m between the wrists of hands that meet
CLAP = 0.08  # m that hands part between claps; rubbed hands part by less
CLAP_S = 0.6  # hands that stay together longer are folded
BOW = np.radians(12)  # breath and gait pitch the chest by less than 6 degrees
UPRIGHT = 0.10  # m that the pelvis may sink in a bow: lower, it is a squat


def waves(motion: Motion, at: Array, side: str) -> tuple[int, int]:
    """How often the hand of `side`, over its elbow, swings in and out again, sideways more than up.

    Counted where the hand is innermost: on its way up and down it passes the outside anyhow. The second count takes
    smaller, slower and steeper swings for waves as well: where the two differ, neither is sure.
    """
    index, fps = motion.skeleton.index, motion.fps
    shoulder, elbow, wrist = (at[:, index(f"{side}_{name}")] for name in ("shoulder", "elbow", "wrist"))
    up = (wrist[:, 2] > elbow[:, 2]) & (wrist[:, 2] > shoulder[:, 2] - BELOW)
    hand = smoothed(_in_heading(motion, wrist - shoulder), fps)
    out = hand[:, 1] if side == "left" else -hand[:, 1]

    def count(least: float, seconds: float, level: float) -> int:
        found = 0
        for first, last in runs(up):
            for t in turnings(out[first : last + 1], fps, least):
                swing = np.ptp(hand[first + t.first : first + t.last + 1], axis=0)
                found += bool(not t.high and t.seconds < seconds and swing[1] > level * swing[2])
        return found

    return count(WAVE, SWING_S, 1.0), count(PERHAPS_WAVE, PERHAPS_SWING_S, 0.7)


def raises(motion: Motion, at: Array, side: str) -> int:
    """How often the hand of `side` goes from below its shoulder to over it."""
    index = motion.skeleton.index
    over = at[:, index(f"{side}_wrist"), 2] - at[:, index(f"{side}_shoulder"), 2]
    states = np.where(over > RAISED, 1, np.where(over < -RAISED, -1, 0))
    states = states[states != 0]
    return int(((states[1:] > 0) & (states[:-1] < 0)).sum())


def claps(motion: Motion, at: Array) -> int:
    """How often both hands meet and part at once; hands that cross go on past each other."""
    index = motion.skeleton.index
    between = at[:, index("left_wrist")] - at[:, index("right_wrist")]
    apart = smoothed(_in_heading(motion, between)[:, 1], motion.fps, 0.05)
    near = np.linalg.norm(between, axis=1) < PALMS
    return sum(bool(not t.high and near[t.frame] and t.seconds < CLAP_S) for t in turnings(apart, motion.fps, CLAP))


def head(motion: Motion) -> tuple[int, float]:
    """Nods, and shakes from one side to the other and back in halves.

    Both are what the head does in the world and on the chest: walkers hold their eyes still while the chest turns and
    pitches under them, and in a bow the head only goes along.
    """
    index, fps, turn = motion.skeleton.index, motion.fps, motion.global_quat()
    world = turn[:, index("head")]
    down, aside = _nose(world, fps)
    down_on_chest, aside_on_chest = _nose(quat_mul(quat_conj(turn[:, index("spine3")]), world), fps)
    nods = 0
    for t in turnings(down, fps, NOD):
        by_neck = down_on_chest[t.frame] - (down_on_chest[t.first] + down_on_chest[t.last]) / 2
        nods += bool(t.high and t.seconds < NOD_S and by_neck > NOD / 4)
    points, swings = turnings(aside, fps, SHAKE), 0
    for a, b in pairwise(points):
        by_neck = (aside_on_chest[b.frame] - aside_on_chest[a.frame]) * (1 if b.high else -1)
        swings += bool((b.frame - a.frame) / fps < SWING_S and by_neck > SHAKE)
    return nods, (swings + 1) / 2 if swings else 0.0


def _nose(turn: Array, fps: float) -> tuple[Array, Array]:
    """Radians (T,) by which the x axis of the frames `turn` (T, 4) points down, and to the left."""
    x, y, z = smoothed(quat_rotate(turn, [1.0, 0.0, 0.0]), fps).T
    return np.arctan2(-z, np.hypot(x, y)), np.unwrap(np.arctan2(y, x))


def _in_heading(motion: Motion, vectors: Array) -> Array:
    """World vectors (T, 3) seen from the way the chest faces: forward, left, up."""
    chest = motion.global_quat()[:, motion.skeleton.index("spine3")]
    return quat_rotate(quat_conj(yaw_quat(yaw_of_quat(chest))), vectors)


def bows(motion: Motion, low: Array, standing: NDArray[np.bool_]) -> tuple[int, float, float]:
    """Bows; degrees of the deepest, from where the chest was before or after it; the chest's largest forward pitch.

    `low` (T,): metres that the pelvis is below its height in standing; `standing` (T,): both feet are on the floor.
    """
    chest = quat_rotate(motion.global_quat()[:, motion.skeleton.index("spine3")], [0.0, 0.0, 1.0])
    level = _in_heading(motion, chest)
    pitch = smoothed(np.arctan2(level[:, 0], level[:, 2]), motion.fps)
    found = [t for t in turnings(pitch, motion.fps, BOW) if t.high and low[t.frame] < UPRIGHT and standing[t.frame]]
    deepest = max((t.depth for t in found), default=0.0)
    return len(found), float(np.degrees(deepest)), float(np.degrees(pitch.max()))
