"""What arms, head and trunk do: waves, raised hands, claps, nods, head shakes, bows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from motiongen.measure.legs import runs
from motiongen.measure.swings import Turning, smoothed, turnings
from motiongen.motion import Motion
from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate, yaw_of_quat, yaw_quat

HAND = 0.12  # m from the wrist joint to the middle of the fingers: some people wave from the wrist alone
BELOW = 0.45  # m under the shoulder that a waving hand may be: shy and old people wave at the hip
SWING_S = 0.95  # a swing to one side, of hand or head, that takes longer is a gesture of its own
RAISED = 0.10  # m over the shoulder, after as much below: an arm stretched level is not a raised hand
NOD = np.radians(9)  # the head bobs by 2–5 degrees as people walk
SHAKE = np.radians(13)  # glances while walking stay below
NOD_S = 0.75  # a head that is down for longer is looking there
PALMS = 0.15  # m between the wrists of hands that meet
CLAP = 0.08  # m that hands part between claps; rubbed hands part by less
CLAP_S = 0.6  # hands that stay together longer are folded
BOW = np.radians(12)  # breath and gait pitch the chest by less than 6 degrees
UPRIGHT = 0.10  # m that the pelvis may sink in a bow: lower, it is a squat


@dataclass(frozen=True)
class _Waving:
    """What counts as a wave: `least` metres from side to side, `level` times as many as up and down, within `seconds`,
    the hand over the elbow by a share `upright` of the forearm's length."""

    least: float
    level: float
    seconds: float
    upright: float


# A hand that is held up drifts by less than 0.03 m. What laxer thresholds find may be a wave, and may be fidgeting.
_SURELY, _PERHAPS = _Waving(0.06, 1.0, SWING_S, 0.3), _Waving(0.04, 0.7, 1.3, 0.0)


def waves(motion: Motion, at: Array, side: str) -> list[Turning]:
    """Swings in and out again of the hand of `side`, its forearm up, sideways more than up.

    Counted where the hand is innermost: on its way up and down it passes the outside anyhow.
    """
    return _waves(motion, at, side, _SURELY)


def perhaps_waves(motion: Motion, at: Array, side: str) -> list[Turning]:
    """The same with smaller, slower, steeper and lower swings: where the counts differ, neither is sure."""
    return _waves(motion, at, side, _PERHAPS)


def _waves(motion: Motion, at: Array, side: str, waving: _Waving) -> list[Turning]:
    index, fps = motion.skeleton.index, motion.fps
    shoulder, elbow, wrist = (at[:, index(f"{side}_{name}")] for name in ("shoulder", "elbow", "wrist"))
    fore = wrist - elbow
    up = (fore[:, 2] > waving.upright * np.linalg.norm(fore, axis=1)) & (wrist[:, 2] > shoulder[:, 2] - BELOW)
    sign = 1.0 if side == "left" else -1.0
    hand = smoothed(_in_heading(motion, _fingers(motion, at, side) - shoulder), fps)
    found = []
    for first, last in runs(up):
        for t in turnings(sign * hand[first : last + 1, 1], fps, waving.least):
            swing = np.ptp(hand[first + t.first : first + t.last + 1], axis=0)
            if not t.high and t.seconds < waving.seconds and swing[1] > waving.level * swing[2]:
                found.append(replace(t, frame=first + t.frame, first=first + t.first, last=first + t.last))
    return found


def raises(motion: Motion, at: Array, side: str) -> list[int]:
    """Frames in which the hand of `side`, having been below its shoulder, comes to be over it."""
    index = motion.skeleton.index
    over = at[:, index(f"{side}_wrist"), 2] - at[:, index(f"{side}_shoulder"), 2]
    states = np.where(over > RAISED, 1, np.where(over < -RAISED, -1, 0))
    clear = np.flatnonzero(states)
    return [int(b) for a, b in pairwise(clear) if states[b] > 0 > states[a]]


def lifted(motion: Motion, at: Array, side: str) -> Array:
    """Degrees (T,) between the line from shoulder to wrist of `side` and straight down."""
    index = motion.skeleton.index
    line = at[:, index(f"{side}_wrist")] - at[:, index(f"{side}_shoulder")]
    return np.degrees(np.arctan2(np.hypot(line[:, 0], line[:, 1]), -line[:, 2]))


def hand_path(motion: Motion, at: Array, side: str) -> float:
    """Metres that the fingers of `side` travel, seen from the shoulder."""
    shoulder = at[:, motion.skeleton.index(f"{side}_shoulder")]
    way = smoothed(_in_heading(motion, _fingers(motion, at, side) - shoulder), motion.fps)
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def claps(motion: Motion, at: Array) -> list[Turning]:
    """Where both hands meet and part at once; hands that cross go on past each other."""
    index = motion.skeleton.index
    between = at[:, index("left_wrist")] - at[:, index("right_wrist")]
    apart = smoothed(_in_heading(motion, between)[:, 1], motion.fps, 0.05)
    near = np.linalg.norm(between, axis=1) < PALMS
    return [t for t in turnings(apart, motion.fps, CLAP) if not t.high and near[t.frame] and t.seconds < CLAP_S]


def head(motion: Motion) -> tuple[list[Turning], list[tuple[int, float]]]:
    """Nods, and swings of a head shake to one side: the frame of each one's end and its seconds.

    Both are what the head does in the world and on the chest: walkers hold their eyes still while the chest turns and
    pitches under them, and in a bow the head only goes along.
    """
    index, fps, turn = motion.skeleton.index, motion.fps, motion.global_quat()
    world = turn[:, index("head")]
    down, aside = _nose(world, fps)
    down_on_chest, aside_on_chest = _nose(quat_mul(quat_conj(turn[:, index("spine3")]), world), fps)
    nods = []
    for t in turnings(down, fps, NOD):
        by_neck = down_on_chest[t.frame] - (down_on_chest[t.first] + down_on_chest[t.last]) / 2
        if t.high and t.seconds < NOD_S and by_neck > NOD / 4:
            nods.append(t)
    swings = []
    for a, b in pairwise(turnings(aside, fps, SHAKE)):
        by_neck = (aside_on_chest[b.frame] - aside_on_chest[a.frame]) * (1 if b.high else -1)
        seconds = (b.frame - a.frame) / fps
        if seconds < SWING_S and by_neck > SHAKE:
            swings.append((b.frame, seconds))
    return nods, swings


def _nose(turn: Array, fps: float) -> tuple[Array, Array]:
    """Radians (T,) by which the x axis of the frames `turn` (T, 4) points down, and to the left."""
    x, y, z = smoothed(quat_rotate(turn, [1.0, 0.0, 0.0]), fps).T
    return np.arctan2(-z, np.hypot(x, y)), np.unwrap(np.arctan2(y, x))


def _fingers(motion: Motion, at: Array, side: str) -> Array:
    """World position (T, 3) of the middle of the fingers."""
    wrist = motion.skeleton.index(f"{side}_wrist")
    out = HAND if side == "left" else -HAND
    return at[:, wrist] + quat_rotate(motion.global_quat()[:, wrist], [0.0, out, 0.0])


def _in_heading(motion: Motion, vectors: Array) -> Array:
    """World vectors (T, 3) seen from the way the chest faces: forward, left, up."""
    chest = motion.global_quat()[:, motion.skeleton.index("spine3")]
    return quat_rotate(quat_conj(yaw_quat(yaw_of_quat(chest))), vectors)


def bows(motion: Motion, low: Array, standing: NDArray[np.bool_]) -> tuple[list[Turning], float]:
    """Bows, each with its `depth` in radians from where the chest was before or after it, and the chest's largest
    forward pitch in degrees.

    `low` (T,): metres that the pelvis is below its height in standing; `standing` (T,): both feet are on the floor.
    """
    chest = quat_rotate(motion.global_quat()[:, motion.skeleton.index("spine3")], [0.0, 0.0, 1.0])
    level = _in_heading(motion, chest)
    pitch = smoothed(np.arctan2(level[:, 0], level[:, 2]), motion.fps)
    found = [t for t in turnings(pitch, motion.fps, BOW) if t.high and low[t.frame] < UPRIGHT and standing[t.frame]]
    return found, float(np.degrees(pitch.max()))
