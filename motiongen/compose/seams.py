"""Where one motion can go over into another, and how: on a foot that stands in both, the rest inertialized.

"Inertialization: High-Performance Animation Transitions in Gears of War" (Bollo, GDC 2018): the second motion plays
from the seam on, plus what the first differed from it there, in place and speed; that offset dies away by a quintic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from motiongen.compose.leg_ik import SIDES, SINK_S, leg_bones, sinking, with_ankles
from motiongen.measure.legs import feet
from motiongen.measure.swings import smoothed
from motiongen.motion import SMPL_JOINTS, Motion, Skeleton
from motiongen.rotation import (
    Array,
    quat_conj,
    quat_continuous,
    quat_mul,
    quat_rotate,
    quat_to_rotvec,
    rotvec_to_quat,
    yaw_of_quat,
    yaw_quat,
)

HEADING_S = 0.8  # s over which the heading is averaged: hips turn with every step
MOVING = 0.3  # m/s of the pelvis from which a clip ends, or begins, on its way
SEARCH_S, SEARCH_SHARE = 1.3, 0.4  # a walk may lose so much at its end or beginning: a stride, of a short clip less
PAUSE_S = 0.6  # a loop shorter than a fast stride is none
STEP, LIFT_SHARE, MOST_LIFT = 0.02, 0.15, 0.08  # m from which a foot is lifted over to its new place, and how high
LONGEST_STEP = 0.75  # m that a foot may have to make up within a seam

# What a seam costs, in metres or what is as bad as a metre.
_OTHER_FOOT, _SPEED, _POSE = 0.25, 0.10, 0.30  # a metre of the foot that steps, a m/s, a radian of the joints (rms)
_WORST = 0.6

_ANKLES = [SMPL_JOINTS.index(f"{side}_ankle") for side in SIDES]


@dataclass(frozen=True)
class Seam:
    """Frame `end` of the first motion and frame `start` of the second fall together; the foot `side` (0 left, 1 right)
    stands in both. `cost`: the less the better."""

    end: int
    start: int
    side: int
    cost: float


@dataclass(frozen=True)
class _Frames:
    """A motion at the frames `rows` (n,), seen from the pelvis and its heading: ankles (n, 2, 3), planar velocity of
    the pelvis (n, 2), turns of the joints (n, 22, 4), and which feet stand (n, 2)."""

    rows: NDArray[np.int_]
    ankles: Array
    velocity: Array
    turns: Array
    still: NDArray[np.bool_]


def find_seam(first: Motion, second: Motion, blend_s: float) -> Seam:
    """The best seam from the end of `first` to the beginning of `second`.

    A motion that stands there is kept whole; one on its way may lose a stride. Raises ValueError where none will do.
    """
    return _best(_seen(first, _last_rows(first)), _seen(second, _first_rows(second)), blend_s)


def find_loop(motion: Motion, blend_s: float) -> Seam:
    """The best seam from the end of `motion` back to any earlier frame; raises ValueError where none will do."""
    ends = _last_rows(motion)
    rows = np.arange(max(1, ends[0] - round(PAUSE_S * motion.fps)))
    return _best(_seen(motion, ends), _seen(motion, rows), blend_s)


def joined(first: Motion, second: Motion, seam: Seam, blend_s: float) -> Motion:
    """`first` up to the seam, `second` from there on, turned and moved to where `first` has come to.

    Both at the same frames a second and on the same skeleton. The foot of the seam stays where it stands; the other, if
    it stood too, steps over to its new place; everything else is inertialized over `blend_s`. Labels and contacts are
    dropped. Raises ValueError where a leg is too short for it.
    """
    second = _placed(first, second, seam)
    count = min(round(blend_s * first.fps), len(second) - seam.start - 1)
    if count < 2:
        raise ValueError(f"the second motion has {count} frames after the seam; a blend needs 2 or more")
    tail = slice(seam.start, seam.start + count + 1)
    offsets = _Offsets(seam.end, seam.start, np.arange(count + 1) / count, count / first.fps, first.fps)
    root = offsets.positions(first.root_pos, second.root_pos, tail)
    quat = offsets.turns(first.joint_quat, second.joint_quat, tail)
    out = replace(
        first,
        root_pos=np.concatenate([first.root_pos[: seam.end], root, second.root_pos[tail.stop :]]),
        joint_quat=np.concatenate([first.joint_quat[: seam.end], quat, second.joint_quat[tail.stop :]]),
        contacts=None,
        labels=(),
    )
    return _on_feet(out, _steps(first, second, seam, offsets, tail), seam.end)


def on_skeleton(motion: Motion, skeleton: Skeleton) -> Motion:
    """The same motion on another body: ways as much longer as the legs are, soles as high over the floor.

    Raises ValueError where a foot is out of the reach of its leg.
    """
    if (
        np.array_equal(skeleton.offsets, motion.skeleton.offsets)
        and skeleton.foot_height == motion.skeleton.foot_height
    ):
        return motion
    scale = sum(leg_bones(skeleton, "left")) / sum(leg_bones(motion.skeleton, "left"))
    ankle, new_ankle = motion.skeleton.foot_height[0], skeleton.foot_height[0]
    hips = [s.offsets[s.index("left_hip"), 2] for s in (motion.skeleton, skeleton)]

    def moved(points: Array, of_hip: bool) -> Array:
        above = ankle - (hips[0] if of_hip else 0.0), new_ankle - (hips[1] if of_hip else 0.0)
        return (points - [0, 0, above[0]]) * scale + [0, 0, above[1]]

    other = replace(motion, root_pos=moved(motion.root_pos, True), skeleton=skeleton)
    return _on_feet(other, moved(motion.positions()[:, _ANKLES], False), 0)


def _on_feet(motion: Motion, ankles: Array, since: int) -> Motion:
    """`motion` with its ankles at `ankles` (n, 2, 3) from frame `since` on, the pelvis sinking where legs are short."""
    around = round(SINK_S * motion.fps)
    span = slice(max(0, since - around), since + len(ankles) + around)
    part = replace(motion, root_pos=motion.root_pos[span], joint_quat=motion.joint_quat[span], contacts=None)
    goals = part.positions()[:, _ANKLES]
    goals[since - span.start :][: len(ankles)] = ankles
    sunk = replace(part, root_pos=part.root_pos - np.outer(sinking(part, goals), [0.0, 0.0, 1.0]))
    root, quat = motion.root_pos.copy(), motion.joint_quat.copy()
    root[span], quat[span] = sunk.root_pos, with_ankles(sunk, goals)
    return replace(motion, root_pos=root, joint_quat=quat_continuous(quat), contacts=None)


# ---- Finding


def heading(motion: Motion) -> Array:
    """Radians (T,) that the pelvis faces, averaged over a stride."""
    return smoothed(np.unwrap(yaw_of_quat(motion.joint_quat[:, 0])), motion.fps, HEADING_S)


def _last_rows(motion: Motion) -> NDArray[np.int_]:
    count = len(motion)
    return np.arange(count - _searched(motion, motion.root_pos[-max(2, round(0.2 * motion.fps)) :]), count)


def _first_rows(motion: Motion) -> NDArray[np.int_]:
    return np.arange(_searched(motion, motion.root_pos[: max(2, round(0.2 * motion.fps))]))


def _searched(motion: Motion, way: Array) -> int:
    """How many frames at an end may hold the seam: one where the pelvis stands there, going `way` (n, 3)."""
    if len(way) < 2:
        return 1
    speed = np.linalg.norm(way[-1, :2] - way[0, :2]) * motion.fps / (len(way) - 1)
    return 1 if speed < MOVING else max(1, round(min(SEARCH_S * motion.fps, SEARCH_SHARE * len(motion))))


def _seen(motion: Motion, rows: NDArray[np.int_]) -> _Frames:
    at = motion.positions()
    level = quat_conj(yaw_quat(heading(motion)))[rows]
    ankles = at[rows][:, _ANKLES] - at[rows, None, 0]
    velocity = smoothed(np.gradient(motion.root_pos, axis=0), motion.fps) * motion.fps
    turns = motion.joint_quat[rows].copy()
    turns[:, 0] = quat_mul(level, turns[:, 0])
    return _Frames(
        rows,
        quat_rotate(level[:, None], ankles),
        quat_rotate(level, velocity[rows])[:, :2],
        turns,
        feet(motion, at).still[rows],
    )


def _best(ends: _Frames, starts: _Frames, blend_s: float) -> Seam:
    """Of all pairs of frames the one in which the same foot stands and the rest differs least.

    On its standing foot the second body is at some distance from the first. It should be that which the pelvis goes by
    itself while it changes its speed: half the difference of the velocities times the time.
    """
    change = ends.velocity[:, None] - starts.velocity[None]
    apart = 2 * np.arccos(np.clip(np.abs(np.einsum("ajk,bjk->abj", ends.turns, starts.turns)), 0, 1))
    rest = _SPEED * np.linalg.norm(change, axis=-1) + _POSE * np.sqrt(np.mean(apart**2, axis=-1))
    best: Seam | None = None
    for side in (0, 1):
        ankles = ends.ankles[:, None] - starts.ankles[None]
        pelvis = -ankles[:, :, side, :2]  # the first's less the second's, once the feet are on the same spot
        other = np.linalg.norm(ankles[:, :, 1 - side, :2] + pelvis, axis=-1)
        cost = np.linalg.norm(pelvis + change * blend_s / 2, axis=-1) + _OTHER_FOOT * other + rest
        cost[~(ends.still[:, None, side] & starts.still[None, :, side]) | (other > LONGEST_STEP)] = np.inf
        a, b = np.unravel_index(np.argmin(cost), cost.shape)
        if best is None or cost[a, b] < best.cost:
            best = Seam(int(ends.rows[a]), int(starts.rows[b]), side, float(cost[a, b]))
    if best is None or best.cost > _WORST:
        raise ValueError("these motions do not go over into each other: no foot stands alike at the end and the start")
    return best


# ---- Joining


def _placed(first: Motion, second: Motion, seam: Seam) -> Motion:
    """`second` turned to the heading of `first` at the seam and moved until the standing foot is where it was."""
    yaw = heading(first)[seam.end] - heading(second)[seam.start]
    turn = yaw_quat(yaw)
    ankle = _ANKLES[seam.side]
    shift = first.positions()[seam.end, ankle] - quat_rotate(turn, second.positions()[seam.start, ankle])
    quat = second.joint_quat.copy()
    quat[:, 0] = quat_mul(turn, quat[:, 0])
    return replace(second, root_pos=quat_rotate(turn, second.root_pos) + shift * [1.0, 1.0, 0.0], joint_quat=quat)


@dataclass(frozen=True)
class _Offsets:
    """What the first motion differs from the second by at the seam, dying away over `u` (n,), 0 … 1, in `seconds`."""

    end: int
    start: int
    u: Array
    seconds: float
    fps: float

    def positions(self, first: Array, second: Array, tail: slice, keep_speed: bool = True) -> Array:
        """Points (n, 3) of `second` in its frames `tail`, plus the offset; see `decayed`."""
        here, speed = first[self.end] - second[self.start], np.zeros(3)
        if keep_speed and self.end:
            before = max(self.start, 1)  # like with like: the last step of both, where the second has one
            speed = (first[self.end] - first[self.end - 1] - second[before] + second[before - 1]) * self.fps
        return second[tail] + decayed(self.u, self.seconds, here, speed)

    def turns(self, first: Array, second: Array, tail: slice) -> Array:
        """Turns (n, J, 4), likewise; offsets are axis times angle in the frame of each joint of `second`."""
        here, speed = _turn(second[self.start], first[self.end]), np.zeros((first.shape[1], 3))
        if self.end:
            before = max(self.start, 1)
            speed = _turn(first[self.end - 1], first[self.end]) - _turn(second[before - 1], second[before])
            speed = speed * self.fps
        return quat_mul(second[tail], rotvec_to_quat(decayed(self.u, self.seconds, here, speed)))


def decayed(u: Array, seconds: float, here: Array, speed: Array) -> Array:
    """An offset (n, …) at `u` (n,), 0 … 1 of `seconds`: from `here`, at `speed` a second and without acceleration, to
    rest at 0 by a quintic (Bollo 2018)."""
    u = u.reshape(-1, *[1] * np.ndim(here))
    from_place = 1 - 10 * u**3 + 15 * u**4 - 6 * u**5
    from_speed = seconds * (u - 6 * u**3 + 8 * u**4 - 3 * u**5)
    return from_place * here + from_speed * speed


def _turn(a: Array, b: Array) -> Array:
    """Axis times angle from `a` to `b`, in the frame of `a`."""
    return quat_to_rotvec(quat_mul(quat_conj(a), b))


def _steps(first: Motion, second: Motion, seam: Seam, offsets: _Offsets, tail: slice) -> Array:
    """Where the ankles go during the seam, (n, 2, 3): the other foot is lifted over if it has to move."""
    at = [motion.positions() for motion in (first, second)]
    still = [feet(motion, points).still for motion, points in zip((first, second), at, strict=True)]
    out = np.empty((len(offsets.u), 2, 3))
    for side, ankle in enumerate(_ANKLES):
        before, after = (points[:, ankle] for points in at)
        stands = bool(still[0][seam.end, side] and still[1][seam.start, side])
        out[:, side] = offsets.positions(before, after, tail, keep_speed=not stands)
        far = np.linalg.norm((before[seam.end] - after[seam.start])[:2])
        if stands and far > STEP:
            out[:, side, 2] += min(MOST_LIFT, LIFT_SHARE * far) * np.sin(np.pi * offsets.u) ** 2
        lowest = min(before[seam.end, 2], after[tail, 2].min())
        out[:, side, 2] = np.maximum(out[:, side, 2], lowest)  # no deeper than either motion has it
    return out
