"""From rest to rest: a solved motion is led in from the rig's nominal pose and out to it again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motiongen.motion import Label
from motiongen.rotation import Array, quat_continuous, slerp

SHORTEST_EASE = 0.5  # s
RAMP = 0.3  # s over which the motion itself gets up to speed and down from it
# Minimum jerk, 10u³ − 15u⁴ + 6u⁵, is fastest half-way, at 15/8 of its mean speed (Flash and Hogan 1985).
PEAK = 15 / 8
BINOMIAL = np.array([1.0, 4.0, 6.0, 4.0, 1.0]) / 16


@dataclass(frozen=True)
class Timeline:
    """`lead` and `tail`: frames of easing before and after; `at` (n,): which frame (fractional) of the solved motion
    is shown at each frame in between.
    """

    lead: int
    at: Array
    tail: int


def plan(first: Array, last: Array, nominal: Array, velocity: Array, frames: int, fps: float) -> Timeline:
    """How long to ease between joint angles (nj,) without exceeding `velocity` (nj,) rad/s, and the run of the motion.

    The motion starts and ends at rest: its time is run at a rate that rises from 0 to 1 and falls back, never above 1.
    """
    lead, tail = (ease_frames(pose - nominal, velocity, fps) for pose in (first, last))
    ramp = min(round(RAMP * fps), frames - 1)
    count = frames + ramp
    u = np.clip((np.arange(count - 1) + 0.5) / max(ramp, 1), 0, 1)
    rate = _smooth(u) * _smooth(u)[::-1]
    at = np.concatenate([[0.0], np.cumsum(rate)])
    return Timeline(lead, np.minimum(at * min(1.0, (frames - 1) / max(at[-1], 1e-12)), frames - 1), tail)


def stretch(values: Array, timeline: Timeline) -> Array:
    """(T, k) at the frames `timeline.at`, linear in between: no faster than `values` and nowhere beyond them."""
    low = np.minimum(timeline.at.astype(int), len(values) - 1)
    high = np.minimum(low + 1, len(values) - 1)
    u = (timeline.at - low)[:, None]
    return values[low] * (1 - u) + values[high] * u


def smoothed(qpos: Array) -> Array:
    """`qpos` (T, 7 + nj) under a binomial window of five frames, the ends held: no lag.

    A mean of neighbours stays within every joint limit and no faster than they are. Quaternions must not jump in sign.
    """
    padded = np.concatenate([qpos[:1], qpos[:1], qpos, qpos[-1:], qpos[-1:]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0)
    return windows @ BINOMIAL


def ease(start: Array, end: Array, frames: int) -> Array:
    """(frames, 7 + nj) qpos by minimum jerk from `start` (included) to `end` (excluded)."""
    s = eased(np.arange(frames) / frames)
    out = start + s[:, None] * (end - start)
    out[:, 3:7] = slerp(start[3:7], end[3:7], s)
    return out


def eased(u: Array) -> Array:
    """Minimum jerk from 0 to 1 as u goes there; beyond, what it is there."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u * u)


def normalised(qpos: Array) -> Array:
    """`qpos` with root quaternions of unit length that do not jump in sign."""
    out = qpos.copy()
    quat = quat_continuous(qpos[:, 3:7])
    out[:, 3:7] = quat / np.linalg.norm(quat, axis=1, keepdims=True)
    return out


def shifted(labels: tuple[Label, ...], timeline: Timeline, fps: float) -> tuple[Label, ...]:
    """The labels at the times where their stretch of the motion now is."""
    frames = np.arange(len(timeline.at)) + timeline.lead
    times = [np.interp([label.start_s * fps, label.end_s * fps], timeline.at, frames) / fps for label in labels]
    return tuple(
        Label(float(s), float(e), label.text, label.parts) for label, (s, e) in zip(labels, times, strict=True)
    )


def ease_frames(step: Array, velocity: Array, fps: float) -> int:
    """Frames in which to `ease` joints over `step` (nj,) rad without exceeding `velocity` (nj,) rad/s."""
    seconds = PEAK * float(np.max(np.abs(step) / velocity, initial=0.0))
    return int(np.ceil(max(SHORTEST_EASE, seconds) * fps))


def run_down(frame: int, last: int, frames: int) -> Timeline:
    """How a motion is shown from `frame` on while it comes to rest.

    Its time is run at a rate that falls from 1 to 0 within `frames` frames; it does not go beyond `last`.
    """
    u = (np.arange(frames) + 0.5) / max(frames, 1)
    return Timeline(0, np.minimum(frame + np.concatenate([[0.0], np.cumsum(1 - _smooth(u))]), last), 0)


def _smooth(u: Array) -> Array:
    return u * u * (3 - 2 * u)
