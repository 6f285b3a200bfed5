"""Read clips one after another or in several processes: the same lines and features in the same order."""

from __future__ import annotations

import multiprocessing
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
from numpy.typing import NDArray

from motiongen.data.clip import Clip
from motiongen.data.dataset import Entry, Skipped
from motiongen.features import FPS, WIDTH, motion_to_features

MAX_BYTES = 30_000_000  # of features in one clip, some 30 minutes: beyond, it is skipped
LARGEST = float(np.finfo(np.float16).max)
AT_ONCE = 256  # clips handed out together, so that no more than these can pile up finished

Features = NDArray[np.float16]
Line = Entry | Skipped


def read_clips(clips: Sequence[Clip], jobs: int = 1) -> Iterator[tuple[Line, Features]]:
    """The line, its `start` 0, and the features (T, 140) of each clip, in order; no rows where it is skipped.

    `jobs` processes read; 1 is this one. Raises RuntimeError where one of them is killed.
    """
    if jobs == 1 or len(clips) < 2:
        yield from map(read_clip, clips)
        return
    # Spawned alike everywhere: a fork would copy whatever threads and OpenGL the parent has.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(clips)), context, initializer=_leave_interrupts_to_the_parent) as pool:
        try:
            for first in range(0, len(clips), AT_ONCE):
                yield from pool.map(read_clip, clips[first : first + AT_ONCE], chunksize=4)
        except BrokenProcessPool:
            raise RuntimeError(
                "a process that read clips was killed, perhaps for memory; the same command with fewer --jobs goes on"
            ) from None


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def read_clip(clip: Clip) -> tuple[Line, Features]:
    """The line and the features of one clip."""
    try:
        sample = clip.load()
        features = motion_to_features(sample.motion)
        if not np.abs(features).max() <= LARGEST:
            raise ValueError("moves faster or further than float16 can hold")
        if features.size * 2 > MAX_BYTES:
            raise ValueError(f"{len(features) / FPS / 60:.0f} minutes long, over {MAX_BYTES} bytes; cut it up")
    except (ValueError, OSError) as error:
        return Skipped(clip.name, " ".join(str(error).split())), np.zeros((0, WIDTH), np.float16)
    skeleton = sample.motion.skeleton
    entry = Entry(
        name=clip.name,
        source=clip.source,
        file=clip.file,
        licence=sample.licence,
        split=clip.split,
        start=0,
        frames=len(features),
        captions=sample.captions,
        mirrored=sample.mirrored,
        content=sample.content,
        style=sample.style,
        offsets=tuple((x, y, z) for x, y, z in skeleton.offsets.round(5).tolist()),
        foot_height=skeleton.foot_height,
    )
    return entry, features.astype(np.float16)
