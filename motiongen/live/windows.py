"""Windows of motions: a past, a history and the chunk that follows. A batch depends on its number alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.data.dataset import Dataset
from motiongen.diffusion.batches import Scale, chances, features_on
from motiongen.diffusion.configs import LiveConfig
from motiongen.features import mirror
from motiongen.live.joined import Joined, Segment, fits

JOINED_SHARE = 0.55  # of the windows are of joined motions, the others of clips as they are
FRESH_SHARE, FRESH = 0.6, 6  # of those in joined motions begin within so many frames of a prompt, the others anywhere


@dataclass(frozen=True)
class Drawn:
    """`x` (B, P + H + C, 140) normalised features of a past as long as the chunk, a history and a chunk; `frames`
    (B, H + C) of the last two which count; `captions` (B) of the chunk; `before` (B) what was said in the past.

    Where `unbroken` (B,) is true, one thing was said from the past's end to the chunk's begin, so that the network may
    draw the history itself. `whole` (N, H + C): the `frames` of all windows of the batch.
    """

    x: NDArray[np.float32]
    frames: NDArray[np.bool_]
    captions: tuple[str, ...]
    before: tuple[str, ...]
    unbroken: NDArray[np.bool_]
    whole: NDArray[np.bool_]


@dataclass(frozen=True)
class _Pick:
    """A chunk that begins in row `start` of `segment`'s features; `joined`: those of the joined motions."""

    segment: Segment
    joined: bool
    start: int
    mirrored: bool
    caption: str
    before: str
    unbroken: bool
    forgets: bool


class Windows:
    """Draws from clips and joined motions: a segment, a place in it, a side, a caption."""

    def __init__(
        self, data: Dataset, joined: Joined, scale: Scale, *, size: int, history: int, live: LiveConfig, seed: int
    ) -> None:
        self._data, self._joined, self._scale = data, joined, scale
        self._size, self._history, self._chunk = size, history, live.chunk
        self._no_history, self._seed = live.no_history, seed
        least = history + FRESH
        self._segments = [i for i, s in enumerate(joined.segments) if s.stop - s.motion > least]
        clips = [
            i
            for i, e in enumerate(data.entries)
            if e.split == "train" and fits(e) and e.frames > least + live.chunk // 2
        ]
        if not self._segments or not clips:
            raise ValueError(f"{data.folder}: no clip is longer than the history of {history} frames")
        self._clips, self._chance = np.array(clips), chances([data.entries[i] for i in clips])

    def captions(self) -> list[str]:
        """Every caption that can be drawn."""
        clips = {s.clip for s in self._joined.segments} | set(self._clips.tolist())
        return sorted({c for i in clips for mirrored in (False, True) for c in self._data.captions(i, mirrored)})

    def draw(self, number: int, share: slice = slice(None)) -> Drawn:
        """Batch `number`, or the `share` of its windows; the same for the same seed, data and motions."""
        rng = np.random.default_rng([self._seed, number])
        picks = [
            self._from_joined(rng) if rng.random() < JOINED_SHARE else self._from_clip(rng) for _ in range(self._size)
        ]
        whole = np.stack([self._frames(p) for p in picks])
        picks = picks[share]
        return Drawn(
            np.stack([self._features(p) for p in picks]),
            whole[share],
            tuple(p.caption for p in picks),
            tuple(p.before for p in picks),
            np.array([p.unbroken for p in picks]),
            whole,
        )

    def _from_joined(self, rng: np.random.Generator) -> _Pick:
        segments = self._joined.segments
        i = int(rng.choice(self._segments))
        first = max(segments[i].start, segments[i].motion + self._history)
        last = max(first, segments[i].stop - FRESH)
        fresh = rng.random() < FRESH_SHARE
        start = int(rng.integers(first, min(last, first + FRESH) + 1 if fresh else last + 1))
        earlier = i
        while segments[earlier].start > max(start - self._chunk, segments[i].motion):
            earlier -= 1
        one = earlier == i or start == segments[i].start
        return self._pick(rng, segments[i], segments[earlier], start, joined=True, one=one)

    def _from_clip(self, rng: np.random.Generator) -> _Pick:
        clip = int(rng.choice(self._clips, p=self._chance))
        whole = Segment(0, self._data.entries[clip].frames, clip, 0)
        start = int(rng.integers(self._history, whole.stop - FRESH))
        return self._pick(rng, whole, whole, start, joined=False, one=True)

    def _pick(
        self, rng: np.random.Generator, now: Segment, earlier: Segment, start: int, *, joined: bool, one: bool
    ) -> _Pick:
        mirrored, forgets = bool(rng.random() < 0.5), bool(rng.random() < self._no_history)
        said, before = (str(rng.choice(self._data.captions(s.clip, mirrored))) for s in (now, earlier))
        reaches = start - self._chunk - self._history >= now.motion
        return _Pick(now, joined, start, mirrored, said, before, one and reaches and not forgets, forgets)

    def _frames(self, pick: _Pick) -> NDArray[np.bool_]:
        """Which frames count: of the chunk those in which the same is said, and the history unless it is forgotten."""
        at = pick.start + np.arange(-self._history, self._chunk)
        return (at < pick.segment.stop) & ((at >= pick.start) | (not pick.forgets))

    def _features(self, pick: _Pick) -> NDArray[np.float32]:
        """(P + H + C, 140); before the motion its first frame, after the segment its last, which do not count."""
        now = pick.segment
        at = np.arange(pick.start - self._chunk - self._history, pick.start + self._chunk)
        at = np.clip(at - now.motion, 0, now.stop - now.motion - 1)
        if pick.joined:
            x = self._joined.features[now.motion : now.stop][at].astype(np.float32)
            x = mirror(x) if pick.mirrored else x
        else:
            x = features_on(self._data, now.clip, pick.mirrored, self._scale)[at]
        return (x - self._scale.mean) / self._scale.std
