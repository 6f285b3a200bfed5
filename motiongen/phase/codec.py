"""A trained auto-encoder at work: motions to phrases, and phrases one after the other to motions at any frame rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from motiongen.diffusion.finish import finished, smoothed_over_five
from motiongen.evaluation.judges.seen import leg_length
from motiongen.features import FPS, HEIGHT, PLANAR, YAW, features_to_motion, motion_to_features
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source
from motiongen.nn import Floats, Tensors
from motiongen.phase.phase_run import decode, encode
from motiongen.phase.phases import Layout
from motiongen.phase.phrases import Phrase, joined_frames, joined_signals, looped_signals
from motiongen.phase.segments import primary_segments, timing_of
from motiongen.skeletons import BANDAI_NAMCO

_WAY = [YAW, PLANAR.start, PLANAR.start + 1]


@dataclass(frozen=True)
class Codec:
    """`tensors` of an auto-encoder, the `layout` of its codes, and what its numbers mean (see `Scale`)."""

    tensors: Tensors
    layout: Layout
    mean: Floats
    std: Floats
    offsets: Floats

    @property
    def skeleton(self) -> Skeleton:
        """On which all its motions are."""
        return Skeleton(SMPL_JOINTS, SMPL_PARENTS, self.offsets.astype(float), BANDAI_NAMCO.foot_height)

    @property
    def margin(self) -> int:
        """Frames on either side of a stretch that the decoder sees too."""
        kernels = [
            w.shape[-1] for name, w in self.tensors.items() if name.startswith("decoder.layers.") and w.ndim == 3
        ]
        return sum(kernel // 2 for kernel in kernels)

    def encoded(self, motion: Motion) -> Phrase:
        """The phrase of a motion, its primary segment the best that `primary_segments` finds.

        Raises ValueError for another skeleton than SMPL's 22 joints, or a single frame.
        """
        features = motion_to_features(motion)
        features[:, [*_WAY[1:], HEIGHT]] *= leg_length(self.offsets.astype(float)) / leg_length(motion.skeleton.offsets)
        return self.coded((features - self.mean) / self.std)

    def coded(self, x: Floats) -> Phrase:
        """The phrase of normalised features (T, 140)."""
        timing = timing_of(primary_segments(x, count=1), np.array([len(x)]))
        head, period, tail = (int(n[0]) for n in (timing.head, timing.period, timing.tail))
        return Phrase(encode(self.tensors, self.layout, x[None], timing)[0], head, period, tail, period)

    def features(self, phrases: Sequence[Phrase], dense: int = 1) -> Floats:
        """Normalised features (dense, T, 140) of phrases one after the other: set i is a whole motion at 30 frames a
        second, i / dense frames after set 0 (Suppl. 2). Raises ValueError unless `dense` is 1 or more."""
        if dense < 1:
            raise ValueError(f"dense must be 1 or more, not {dense}")
        at = np.arange(-self.margin, joined_frames(phrases) + self.margin)
        sets = [joined_signals(phrases, self.layout, at + i / dense) for i in range(dense)]
        return decode(self.tensors, np.stack(sets))

    def pose(self, phrase: Phrase) -> Floats:
        """Normalised features (140,) of the pose in which the primary segment of a phrase begins and ends."""
        at = np.arange(-self.margin, self.margin + 1)
        return decode(self.tensors, looped_signals(phrase, self.layout, at)[None])[0, 0]

    def motion(self, phrases: Sequence[Phrase], texts: Sequence[str], *, source: Source, dense: int = 1) -> Motion:
        """Phrases one after the other, a text each, as a motion at `dense` times 30 frames a second."""
        sets = list(self.features(phrases, dense) * self.std + self.mean)
        plain = finished(sets[0].astype(float), self.skeleton)
        features = plain
        if dense > 1:
            smooth = [smoothed_over_five(each.astype(float)) for each in sets]
            features = np.stack(smooth, 1).reshape(-1, plain.shape[1])[: dense * (len(plain) - 1) + 1]
            features[:, HEIGHT] += np.median(plain[:, HEIGHT] - smooth[0][:, HEIGHT])  # down to the floor, as it was
            features[:, _WAY] /= dense  # a step takes so much less time
        bounds = phrases[0].head + np.cumsum([0, *(p.loop for p in phrases)])
        bounds[0], bounds[-1] = 0, len(plain) - 1
        spans = pairwise((bounds / FPS).tolist())
        labels = tuple(Label(*span, text) for span, text in zip(spans, texts, strict=True))
        return replace(features_to_motion(features, self.skeleton, source=source), fps=FPS * dense, labels=labels)
