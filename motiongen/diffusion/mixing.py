"""One estimate of the noise from several: each for its frames and its part of the body (Zhang et al. 2022, Sec. 3.5).

A `Span` says of which frames and features an estimate speaks, `shares` how much of each number of the mixture is its,
and `mix` puts them together with the paper's correction. `mix_parts` is Eq. 10 alone and `mix_times` Eq. 11 alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from motiongen.nn import Floats


@dataclass(frozen=True)
class Span:
    """Frames `start` … `stop` − 1 and the features `columns` (F,) of which an estimate speaks.

    `told` is false for the estimate of a network that is told nothing: it counts where no other does. Raises ValueError
    for a span without frames or without features.
    """

    start: int
    stop: int
    columns: NDArray[np.bool_]
    told: bool = True

    def __post_init__(self) -> None:
        if not 0 <= self.start < self.stop:
            raise ValueError(f"a span goes from frame 0 or later to a later one, not from {self.start} to {self.stop}")
        if not self.columns.any():
            raise ValueError("a span speaks of one feature at least")


def shares(spans: Sequence[Span], fade: int) -> list[Floats]:
    """How much of the mixture is each span's: (stop − start, F) for each, adding up to 1 for every frame and feature.

    Who speaks of fewer features goes first, so that "wave" of an arm is heard through "walk" of the whole body; spans
    of equally many share what they both speak of, in halves or as they fade. A span fades over its first and last
    `fade` frames, but not at frame 0 nor at the end of all. Raises ValueError where nobody speaks of something, or for
    a fade below 1.
    """
    if fade < 1:
        raise ValueError(f"a fade takes 1 frame or more, not {fade}")
    total = max(span.stop for span in spans)
    left = np.ones((total, len(spans[0].columns)), np.float32)
    given = np.zeros_like(left)
    out = [_fading(span, total, fade) * span.columns for span in spans]
    order = sorted(range(len(spans)), key=lambda i: _width(spans[i]))
    for _, rows in groupby(order, key=lambda i: _width(spans[i])):
        rank = list(rows)
        asked = np.zeros_like(left)
        for i in rank:
            asked[spans[i].start : spans[i].stop] += out[i]
        taken = left / np.maximum(asked, 1)
        given += taken * asked
        left = left * (1 - np.minimum(asked, 1))
        for i in rank:
            out[i] *= taken[spans[i].start : spans[i].stop]
    silent = np.flatnonzero((given == 0).any(1))
    if len(silent):
        raise ValueError(f"in frame {silent[0]} and {len(silent) - 1} more, nothing says what all of the body does")
    return [share / given[span.start : span.stop] for span, share in zip(spans, out, strict=True)]  # lone fades: to 1


def mix(
    noises: Sequence[Floats],
    spans: Sequence[Span],
    share: Sequence[Floats],
    lam_parts: float = 0.0,
    lam_times: float = 0.0,
) -> Floats:
    """Estimate (B, T, F) of all spans together: Eq. 10 and Eq. 11 at once.

    `noises[i]` (B, stop − start, F) is the estimate for all features in the frames of span i, `share` what `shares`
    gives. The correction λ·∇Σ‖ε_i − ε_j‖ goes over pairs in both orders; its norm is a clip's, over the frames that
    both speak of; its derivative by ε_i counts as far as ε_i itself does. Two spans that share a number of the mixture
    meet in time and are held to λ₂ = `lam_times`; those that do not are parts of one body, λ₁ = `lam_parts`.
    """
    out = np.zeros((len(noises[0]), max(span.stop for span in spans), noises[0].shape[-1]), noises[0].dtype)
    for noise, span, part in zip(noises, spans, share, strict=True):
        out[:, span.start : span.stop] += part * noise
    if lam_parts or lam_times:
        for i, j in _meeting(spans):
            start, stop = max(spans[i].start, spans[j].start), min(spans[i].stop, spans[j].stop)
            a, b = (slice(start - spans[k].start, stop - spans[k].start) for k in (i, j))
            in_time = (share[i][a] * share[j][b]).any()
            lam = lam_times if in_time else lam_parts
            slope = 2 * lam * _unit(noises[i][:, a] - noises[j][:, b])
            out[:, start:stop] += (share[i][a] - share[j][b]) * slope
    return out


def mix_parts(noises: Sequence[Floats], masks: NDArray[np.bool_], lam: float) -> Floats:
    """Eq. 10: noises n × (B, T, F) for parts of the body, `masks` (n, F) telling whose each feature is, λ₁ = `lam`.

    Raises ValueError where a feature is not one part's alone.
    """
    owners = masks.sum(0)
    if (owners != 1).any():
        column = int(np.flatnonzero(owners != 1)[0])
        raise ValueError(f"feature {column} belongs to {owners[column]} parts; each belongs to one")
    spans = [Span(0, noises[0].shape[1], mask) for mask in masks]
    return mix(noises, spans, shares(spans, fade=1), lam_parts=lam)


def mix_times(noises: Sequence[Floats], intervals: Sequence[tuple[int, int]], lam: float) -> Floats:
    """Eq. 11: noises (B, r − l, F) for `intervals` [l, r) of frames, which may overlap, with λ₂ = `lam`.

    In an overlap they count for one: each the less, the nearer its own end. Raises ValueError for a gap.
    """
    columns = np.ones(noises[0].shape[-1], bool)
    spans = [Span(start, stop, columns) for start, stop in intervals]
    return mix(noises, spans, shares(spans, fade=max(stop for _, stop in intervals)), lam_times=lam)


def _width(span: Span) -> tuple[bool, int]:
    return not span.told, int(span.columns.sum())


def _fading(span: Span, total: int, fade: int) -> Floats:
    """(stop − start, 1), up to 1."""
    at = np.arange(span.start, span.stop, dtype=np.float32)[:, None] + 0.5
    ends = [at - span.start] * (span.start > 0) + [span.stop - at] * (span.stop < total)
    return np.minimum.reduce([np.ones_like(at), *(end / fade for end in ends)])


def _meeting(spans: Sequence[Span]) -> Iterator[tuple[int, int]]:
    """Pairs of spans with a frame in common."""
    order = sorted(range(len(spans)), key=lambda i: spans[i].start)
    for place, i in enumerate(order):
        for j in order[place + 1 :]:
            if spans[j].start >= spans[i].stop:
                break
            yield i, j


def _unit(x: Floats) -> Floats:
    """x (B, T, F) over its norm, clip by clip; nothing where all is nothing, as a subgradient of the norm there."""
    size = np.sqrt(np.square(x).sum((1, 2), keepdims=True))
    return x / (size + (size == 0))
