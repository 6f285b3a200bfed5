"""What the legs do: steps, way, turn, squats and jumps, from joint positions alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.measure.swings import Turning, smoothed, turnings
from motiongen.motion import Motion
from motiongen.rotation import Array, quat_conj, quat_rotate, yaw_of_quat, yaw_quat

STILL = 0.30  # m/s below which a foot stands; the slowest swings of a foot peak at twice that …
STILL_SHARE = 0.35  # … or below this share of the pelvis's speed: in a run the standing foot rolls on
STRIDE = 0.10  # m that a foot must travel for a step; feet shuffle less while standing
LIFT = 0.05  # m that a foot must rise for a step on the spot; it stands on nothing while it is that high
SHORTEST_S = 0.12  # a swing takes longer, even in a sprint
PAUSE_S = 0.9  # with longer between them, two lifts are no march but two gestures
HOP = 0.25  # m between the points through which the way is drawn: well above sway, below a step
SQUAT = 0.10  # m that the pelvis must sink; walking moves it by less than 0.06
AIR = 0.03  # m that the lowest foot is off the floor in a jump; noise of the floor is below 0.02
TOGETHER_S = 0.15  # within which both feet leave the floor, and land, in a jump; runners are slower
TOES_DOWN, SLIDING = 0.05, 0.2  # m off the floor and m/s, both Kimodo's
NEAR_JUMP_S = 0.9  # a dip as near to a jump belongs to it


@dataclass(frozen=True)
class Feet:
    """Left and right foot over T frames.

    `lifts`: first frame, last frame and whether left, of every swing during which the other foot stands at least once.
    `still` (T, 2): whether it stands. `clear` (T, 2): metres that the lower of ankle and toe is off the floor. `ankle`
    (T, 2, 3): where the ankles are, in metres.
    """

    lifts: tuple[tuple[int, int, bool], ...]
    still: NDArray[np.bool_]
    clear: Array
    ankle: Array


def feet(motion: Motion, at: Array) -> Feet:
    """Swings and stances of both feet; `at` (T, J, 3) are the positions of `motion`."""
    index, fps = motion.skeleton.index, motion.fps
    ankle = at[:, [index("left_ankle"), index("right_ankle")]]
    toe = at[:, [index("left_foot"), index("right_foot")]]
    heights = np.stack([ankle[..., 2], toe[..., 2]], -1) - motion.skeleton.foot_height
    clear = heights.min(-1) - np.quantile(heights.min((1, 2)), 0.05)
    limit = np.maximum(STILL, STILL_SHARE * _speed(at[:, 0], fps))
    still = (np.minimum(_speed(ankle, fps), _speed(toe, fps)) < limit[:, None]) & (clear < LIFT)
    lifts = []
    for side in (0, 1):
        for first, last in runs(~still[:, side]):
            if (last - first + 1) / fps >= SHORTEST_S and still[first : last + 1, 1 - side].any():
                lifts.append((first, last, side == 0))
    return Feet(tuple(sorted(lifts)), still, clear, ankle)


def steps(motion: Motion, found: Feet) -> list[tuple[int, int, bool]]:
    """Steps, as in `Feet.lifts`: swings that travel, and lifts on the spot by one foot after the other.

    One lift on the spot, or the same foot lifted again and again, is a raised knee or a kick.
    """
    taken = []
    for i, (first, last, left) in enumerate(found.lifts):
        ankle = found.ankle[:, 0 if left else 1]
        travels = np.linalg.norm(ankle[last, :2] - ankle[first, :2]) >= STRIDE
        rises = np.ptp(found.clear[first : last + 1, 0 if left else 1]) >= LIFT
        near = [found.lifts[k] for k in (i - 1, i + 1) if 0 <= k < len(found.lifts)]
        gaps = [(max(first, f) - min(last, end)) / motion.fps for f, end, other in near if other != left]
        if travels or (rises and any(gap <= PAUSE_S for gap in gaps)):
            taken.append((first, last, left))
    return taken


def way(pelvis: Array) -> tuple[float, float]:
    """Metres that the pelvis (T, 3) travels over the floor, along its way and from start to end; sway is left out."""
    flat = pelvis[:, :2]
    anchor, along = flat[0], 0.0
    for point in flat[1:]:
        hop = float(np.linalg.norm(point - anchor))
        if hop >= HOP:
            anchor, along = point, along + hop
    along += float(np.linalg.norm(flat[-1] - anchor))
    return along, float(np.linalg.norm(flat[-1] - flat[0]))


def turned(motion: Motion) -> Array:
    """Degrees (T,) that the pelvis has turned since the start, left positive, whole turns included."""
    yaw = smoothed(np.unwrap(yaw_of_quat(motion.joint_quat[:, 0])), motion.fps, 0.2)
    return np.degrees(yaw - yaw[0])


def ahead(motion: Motion) -> tuple[float, float]:
    """Metres from start to end, forward and left of where the pelvis faces at first."""
    start = quat_conj(yaw_quat(yaw_of_quat(motion.joint_quat[0, 0])))
    forward, left, _ = quat_rotate(start, motion.root_pos[-1] - motion.root_pos[0])
    return float(forward), float(left)


def skate(motion: Motion, at: Array) -> float:
    """Share of the frames in which a foot's toes are down in which they slide (Kimodo's foot skate ratio)."""
    index = motion.skeleton.index
    toe = at[:, [index("left_foot"), index("right_foot")]]
    flat = np.linalg.norm(np.diff(toe[..., :2], axis=0), axis=-1) * motion.fps
    above = toe[..., 2] - np.quantile(toe[..., 2], 0.05)
    down = (above[1:] < TOES_DOWN) & (above[:-1] < TOES_DOWN)
    return float((flat[down] > SLIDING).mean()) if down.any() else 0.0


def jumps(motion: Motion, pelvis: Array, found: Feet) -> tuple[list[int], float]:
    """Frames at the top of each jump off both feet, and the highest rise of the pelvis above standing, in metres."""
    near = max(1, round(TOGETHER_S * motion.fps))
    down = found.clear < AIR
    tops = []
    for first, last in runs(np.all(~down, axis=1)):
        before, after = down[max(0, first - near) : first], down[last + 1 : last + 1 + near]
        if before.any(0).all() and after.any(0).all():
            tops.append(first + int(np.argmax(pelvis[first : last + 1, 2])))
    both = down.all(1)
    if not tops or not both.any():  # who never stands on both feet is running
        return [], 0.0
    standing = float(np.quantile(pelvis[both, 2], 0.9))
    return tops, max(0.0, float(pelvis[tops, 2].max()) - standing)


def squats(motion: Motion, pelvis: Array, found: Feet, jumped: list[int]) -> list[Turning]:
    """The bottom of each squat: the pelvis sinks towards both feet, which stand, and rises again."""
    height = smoothed(pelvis[:, 2] - found.ankle[..., 2].min(1), motion.fps)
    far = NEAR_JUMP_S * motion.fps
    return [
        low
        for low in turnings(height, motion.fps, SQUAT)
        if not low.high and found.still[low.frame].all() and all(abs(low.frame - top) > far for top in jumped)
    ]


def runs(true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every unbroken stretch of true values."""
    edge = np.diff(np.concatenate([[0], np.asarray(true, np.int8), [0]]))
    return [(int(a), int(b) - 1) for a, b in zip(np.flatnonzero(edge == 1), np.flatnonzero(edge == -1), strict=True)]


def _speed(points: Array, fps: float) -> Array:
    """m/s (T, …) of points (T, …, 3)."""
    if len(points) < 2:
        return np.zeros(points.shape[:-1])
    return np.linalg.norm(np.gradient(smoothed(points, fps, 0.07), axis=0), axis=-1) * fps
