"""Codes of many stretches of clips, encoded once for the denoiser to learn from, and kept in the folder of its run."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from motiongen.diffusion.batches import Batch, Batches
from motiongen.diffusion.run_folder import RunError
from motiongen.files import replacing
from motiongen.nn import Floats
from motiongen.phase.phases import Frames, Layout, Timing
from motiongen.phase.segments import POOL, primary_segments, timing_of

_FILE = "codes.safetensors"
Encode = Callable[[Floats, Timing], Floats]


@dataclass(frozen=True)
class Codes:
    """`codes` (N, width), half precision; `poses` (N, features), normalised, in which their primary segments begin;
    `timing` and `captions` of them. `center` and `spread` (width,): each number's mean, each token's deviation."""

    codes: NDArray[np.float16]
    poses: Floats
    timing: Timing
    captions: tuple[str, ...]
    center: Floats
    spread: Floats

    def normalised(self, rows: Frames) -> Floats:
        """Some of the codes, with mean 0 and, over a token, deviation 1."""
        return (self.codes[rows] - self.center) / self.spread


def segmented(batch: Batch, seed: int, number: int) -> Timing:
    """Timing of the clips of batch `number`, each with one of its pool of primary segments, by seed and number."""
    counts = batch.frames.sum(1)
    chosen = np.random.default_rng([seed, number]).integers(POOL, size=len(counts))
    pools = [primary_segments(x[:count]) for x, count in zip(batch.x, counts, strict=True)]
    return timing_of(np.stack([pool[i % len(pool)] for pool, i in zip(pools, chosen, strict=True)]), counts)


def held(batch: Batch) -> Floats:
    """Features (B, T, 140) of a batch whose clips stay at their last frame beyond it."""
    last = batch.frames.sum(1)[:, None] - 1
    return np.take_along_axis(batch.x, np.minimum(np.arange(batch.x.shape[1]), last)[..., None], axis=1)


def open_codes(
    folder: Path,
    batches: Batches,
    layout: Layout,
    encode: Encode,
    *,
    count: int,
    seed: int,
    progress: Callable[[int, int], None],
) -> Codes:
    """The codes kept in `folder`; where there are none, of `count` or a few more stretches as `batches` draws them.

    Raises RunError where the file is damaged.
    """
    path = folder / _FILE
    if not path.exists():
        arrays = _encoded(batches, encode, count, seed, progress)
        with replacing(path) as temporary:
            save_file(arrays, temporary)
    try:
        arrays = load_file(path)
        timing = Timing(*(arrays[name].astype(int) for name in ("head", "period", "tail")))
        captions = tuple(json.loads(arrays["captions"].tobytes()))
        return Codes(arrays["codes"], arrays["poses"], timing, captions, *_statistics(arrays["codes"], layout))
    except (SafetensorError, KeyError, ValueError):
        raise RunError(f"{path}: damaged; remove it, and it is made anew") from None


def _encoded(
    batches: Batches, encode: Encode, count: int, seed: int, progress: Callable[[int, int], None]
) -> dict[str, NDArray[Any]]:
    """The file's arrays."""
    parts: list[tuple[NDArray[Any], ...]] = []
    captions: list[str] = []
    while len(captions) < count:
        progress(len(captions), count)
        batch = batches.draw(len(parts))
        timing = segmented(batch, seed, len(parts))
        code = encode(held(batch), timing).astype(np.float16)
        pose = batch.x[np.arange(len(code)), timing.head]
        parts.append((code, pose, timing.head, timing.period, timing.tail))
        captions += batch.captions
    progress(count, count)
    names = ("codes", "poses", "head", "period", "tail")
    arrays = {name: np.concatenate(each) for name, each in zip(names, zip(*parts, strict=True), strict=True)}
    return arrays | {"captions": np.frombuffer(json.dumps(captions).encode(), np.uint8)}


def _statistics(codes: NDArray[np.float16], layout: Layout) -> tuple[Floats, Floats]:
    center = codes.mean(0, dtype=np.float32)
    variance = codes.var(0, dtype=np.float32)
    spread = np.empty_like(center)
    for token in layout.tokens:
        spread[token] = max(float(np.sqrt(variance[token].mean())), 1e-3)
    return center, spread
