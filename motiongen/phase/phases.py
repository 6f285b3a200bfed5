"""Phases: motion as waves of fixed whole frequencies, and straight lines before and after (DiffusionPhase, Eq. 2–3).

A code holds the numbers of one motion in a row, `Layout.width` of them, token by token:

| token | numbers | holds |
|---|---|---|
| one for each of F frequencies | 3 × G | A·cos 2πS, A·sin 2πS and B of its G phases |
| head, tail | C each | how far the signals are, at the first and last frame, from where the primary segment begins |
| timing | 2 | shares of the motion's length that are head and tail |

Amplitude A and shift S are kept as one complex number: a shift of 1 is one of 0, and where there is no amplitude there
is no shift to be told. `signals` takes arrays of numpy and tensors of torch alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.nn import Floats

Array = Any  # of numpy or of torch
Frames = NDArray[np.int_]


@dataclass(frozen=True)
class Layout:
    """Which waves there are: `phases` in all, as many of each divisor of `highest`, which so is a common multiple of
    the frequencies (Sec. 3.2); each gives a sine, with `cosine` also a cosine.

    Raises ValueError where the phases cannot be shared out evenly.
    """

    highest: int = 30
    phases: int = 128
    cosine: bool = True

    def __post_init__(self) -> None:
        if self.highest < 1 or self.phases < 1 or self.phases % len(self.frequencies):
            raise ValueError(
                f"{self.phases} phases; they must be a multiple of {len(self.frequencies)}, the number of divisors of "
                f"the highest frequency, {self.highest}"
            )

    @property
    def frequencies(self) -> tuple[int, ...]:
        """F of them, in cycles a primary segment, lowest first."""
        return tuple(f for f in range(1, self.highest + 1) if self.highest % f == 0)

    @property
    def group(self) -> int:
        """G, phases of each frequency."""
        return self.phases // len(self.frequencies)

    @property
    def channels(self) -> int:
        """C, signals that the decoder sees."""
        return self.phases * (1 + self.cosine)

    @property
    def tokens(self) -> tuple[slice, ...]:
        """Where in a code each frequency is, then the head, the tail and the timing."""
        sizes = [*[3 * self.group] * len(self.frequencies), self.channels, self.channels, 2]
        return tuple(slice(a, b) for a, b in pairwise(np.cumsum([0, *sizes]).tolist()))

    @property
    def width(self) -> int:
        """Numbers in a code."""
        return 3 * self.phases + 2 * self.channels + 2


@dataclass(frozen=True)
class Timing:
    """Steps of B motions, (B,) each, from one frame to the next: `head`, `period` of the primary segment, `tail`."""

    head: Frames
    period: Frames
    tail: Frames

    @property
    def frames(self) -> Frames:
        """How many frames they have, the segment shown once."""
        return self.head + self.period + self.tail + 1

    @property
    def shares(self) -> Floats:
        """(B, 2): the timing token."""
        return (np.stack([self.head, self.tail], 1) / (self.frames - 1)[:, None]).astype(np.float32)


@dataclass(frozen=True)
class Course:
    """Where each frame of a motion is, (B, T) each.

    `k`: time control of the waves, in [0, 1): their frequencies are whole, so whole turns may be left out; `head`: 1 at
    the first frame, falling evenly to 0 at the start of the primary segment; `tail`: 0 at its end, 1 at the last frame.
    """

    k: Array
    head: Array
    tail: Array


def course(timing: Timing, at: NDArray[Any], loop: Frames | None = None) -> Course:
    """Courses (B, T) at the frames `at`, (T,) or (B, T), which may lie between two; the primary segment goes round for
    `loop` (B,) steps, None: once.

    Frames before a motion's first stay there, or, where it has no head, go round, too; so do those after its last.
    """
    head, period, tail = (each[:, None] for each in (timing.head, timing.period, timing.tail))
    stop = head + (period if loop is None else loop[:, None])
    before, after = np.minimum(np.maximum(head - at, 0), head), np.minimum(np.maximum(at - stop, 0), tail)
    turning = np.where(head > 0, np.maximum(at, head), at)
    turning = np.where(tail > 0, np.minimum(turning, stop), turning)
    k = np.mod(turning - head, period) / period
    return Course(*(y.astype(np.float32) for y in (k, before / np.maximum(head, 1), after / np.maximum(tail, 1))))


def readings(timing: Timing, length: int, highest: int) -> Floats:
    """Weights (B, 2H + 5, length) by which a motion's frames are summed up into what an encoder goes by, H = `highest`.

    Row by row: the mean of the primary segment; how much A·cos 2πS of each whole frequency is in it, up to H; how much
    A·sin 2πS; the head's mean and first frame, off the segment's first; the tail's mean and last frame, off its last.
    """
    frame = np.arange(length)
    start, last = timing.head[:, None], timing.frames[:, None] - 1
    stop = start + timing.period[:, None]
    before, after = frame < start, (frame > stop) & (frame <= last)
    inside = _mean((frame >= start) & (frame < stop))[:, None]
    angle = 2 * math.pi * course(timing, frame).k[:, None] * np.arange(1, highest + 1)[:, None]
    begin, end = 1.0 * (frame == start), 1.0 * (frame == stop)
    ends = (
        _mean(before) - begin * (start > 0),
        (frame == 0) - begin,
        _mean(after) - end * (last > stop),
        (frame == last) - end,
    )
    rows = inside, 2 * np.sin(angle) * inside, -2 * np.cos(angle) * inside, np.stack(ends, 1)
    return np.concatenate(rows, 1).astype(np.float32)


def _mean(chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Weights (B, T) that give the mean of the chosen frames; all 0 where none is."""
    return chosen / np.maximum(chosen.sum(1, keepdims=True), 1)


def signals(code: Array, at: Course, layout: Layout) -> Array:
    """Signals (B, T, C) of codes (B, width) (Eq. 2–3): A·sin 2π(F·k − S) + B of every phase, then the cosines.

    Before and after the primary segment they lie on the straight line from where the segment begins to `head` and
    `tail` away from it: they meet the waves, so no constant of theirs is left to be found.
    """
    *_, head, tail, _ = layout.tokens
    waves = code[:, : 3 * layout.phases].reshape(len(code), 1, len(layout.frequencies), 3, layout.group)
    along, across, offset = waves[..., 0, :], waves[..., 1, :], waves[..., 2, :]
    angle = 2 * math.pi * at.k[..., None, None] * _like(layout.frequencies, at.k)[:, None]
    cos, sin = (np.cos(angle), np.sin(angle)) if isinstance(angle, np.ndarray) else (angle.cos(), angle.sin())
    shape = (*at.k.shape, layout.phases)
    out = (sin * along - cos * across + offset).reshape(shape)
    if layout.cosine:
        out = _joined(out, (cos * along + sin * across + offset).reshape(shape))
    return out + at.head[..., None] * code[:, None, head] + at.tail[..., None] * code[:, None, tail]


def amplitude_shift_offset(code: Floats, layout: Layout) -> tuple[Floats, Floats, Floats]:
    """A ≥ 0, S in [0, 1) and B, (B, F, G) each, of codes (B, width)."""
    waves = code[:, : 3 * layout.phases].reshape(len(code), len(layout.frequencies), 3, layout.group)
    along, across, offset = waves[:, :, 0], waves[:, :, 1], waves[:, :, 2]
    return np.hypot(along, across), np.mod(np.arctan2(across, along) / (2 * math.pi), 1.0), offset


def _like(numbers: tuple[int, ...], array: Array) -> Array:
    return np.array(numbers, array.dtype) if isinstance(array, np.ndarray) else array.new_tensor(numbers)


def _joined(a: Array, b: Array) -> Array:
    if isinstance(a, np.ndarray):
        return np.concatenate([a, b], axis=-1)
    import torch

    return torch.cat([a, b], dim=-1)
