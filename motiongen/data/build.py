"""Build a data set: read every clip of the sources once, write features in shards, go on where a build was cut off."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from motiongen.data.dataset import (
    VERSION,
    Dataset,
    DatasetError,
    Entry,
    Head,
    Skipped,
    open_dataset,
    read_head,
    read_shards,
    shard_name,
)
from motiongen.data.report import report
from motiongen.data.sources import Clip, SourceError, find_clips, split_of
from motiongen.features import FPS, WIDTH, mirror, motion_to_features
from motiongen.files import replacing

SHARD_BYTES = 10_000_000  # what an interruption can lose: some ten minutes of motion, seconds of work
MAX_SHARD_BYTES = 30_000_000  # a shard with one clip that is longer; beyond, the clip is skipped
LARGEST = float(np.finfo(np.float16).max)

Features = NDArray[np.float16]


def build(
    specs: Sequence[str],
    out: Path,
    *,
    progress: Callable[[int, int], None] | None = None,
    shard_bytes: int = SHARD_BYTES,
) -> tuple[Dataset, bool]:
    """Build the data set of the sources `specs` (see `find_clips`) in `out`; False where it was there already.

    An unfinished build of the same sources goes on with the first clip that is in no shard; a finished one is only
    opened. Clips that cannot be read are skipped and listed. `progress` is told how many clips of how many are done.

    Raises SourceError for a bad source, or where no clip of it can be read; DatasetError where `out` holds something
    else or a data set of other sources; OSError where `out` cannot be written.
    """
    if not specs:
        raise SourceError("no source; name one or more, for example gestures:100 or folder:FOLDER")
    clips = [clip for spec in specs for clip in find_clips(spec)]
    name, times = Counter(clip.name for clip in clips).most_common(1)[0]
    if times > 1:
        raise SourceError(f"clip {name} is in the sources {times} times")
    head = Head(VERSION, tuple(map(_absolute, specs)), len(clips))
    if _prepare(out, head):
        return open_dataset(out), False
    shards = read_shards(out)
    done = [line.name for lines in shards for line in lines]
    if done != [clip.name for clip in clips[: len(done)]]:
        raise DatasetError(f"{out}: the sources changed since the build was interrupted; remove it to build anew")
    _write_shards(clips, len(done), len(shards), out, shard_bytes, progress or (lambda *_: None))
    _finish(out, head)
    return open_dataset(out), True


def _absolute(spec: str) -> str:
    kind, _, where = spec.partition(":")
    return spec if kind == "gestures" else f"{kind}:{Path(where).expanduser().resolve()}"


def _prepare(out: Path, head: Head) -> bool:
    """Make `out` ready for the build that `head` describes; True where that build is finished already."""
    if out.exists() and not out.is_dir():
        raise DatasetError(f"{out}: is a file, expected a folder")
    if not (out / "dataset.json").is_file():
        if out.is_dir() and any(out.iterdir()):
            raise DatasetError(f"{out}: not empty and not a data set; name another folder")
        out.mkdir(parents=True, exist_ok=True)
        _write(out / "dataset.json", msgspec.json.encode(head))
        return False
    there = read_head(out)
    if (there.sources, there.clips) != (head.sources, head.clips):
        state = "a data set" if there.finished else "an unfinished data set"
        raise DatasetError(
            f"{out}: holds {state} of {there.clips} clips of {', '.join(there.sources)}, not {head.clips} of "
            f"{', '.join(head.sources)}; remove it or name another folder"
        )
    for ours in ("shard", "dataset", "report"):
        for left_over in out.glob(f".{ours}-*"):  # a process that was killed had no time to tidy up
            left_over.unlink()
    return there.finished


def _write_shards(
    clips: Sequence[Clip], done: int, number: int, out: Path, shard_bytes: int, progress: Callable[[int, int], None]
) -> None:
    """Write the clips from `done` on into shards from `number` on, each as full as `shard_bytes` allows."""
    rows: list[Features] = []
    lines: list[Entry | Skipped] = []
    start = 0
    for at in range(done, len(clips)):
        progress(at, len(clips))
        line, features = _read(clips[at], start)
        if start and (start + len(features)) * WIDTH * 2 > shard_bytes:
            _write_shard(out, number, rows, lines)
            rows, lines, start, number = [], [], 0, number + 1
            line = msgspec.structs.replace(line, start=0) if isinstance(line, Entry) else line
        rows.append(features)
        lines.append(line)
        start += len(features)
    if lines:
        _write_shard(out, number, rows, lines)
    progress(len(clips), len(clips))


def _read(clip: Clip, start: int) -> tuple[Entry | Skipped, Features]:
    """The line and the features (T, 140) of a clip that begins in row `start`; no rows where it is skipped."""
    try:
        sample = clip.load()
        features = motion_to_features(sample.motion)
        if not np.abs(features).max() <= LARGEST:
            raise ValueError("moves faster or further than float16 can hold")
        if features.size * 2 > MAX_SHARD_BYTES:
            raise ValueError(f"{len(features) / FPS / 60:.0f} minutes long, over {MAX_SHARD_BYTES} bytes; cut it up")
    except (ValueError, OSError) as error:
        return Skipped(clip.name, " ".join(str(error).split())), np.zeros((0, WIDTH), np.float16)
    skeleton = sample.motion.skeleton
    entry = Entry(
        name=clip.name,
        source=clip.source,
        file=clip.file,
        licence=sample.licence,
        split=split_of(clip.name),
        start=start,
        frames=len(features),
        captions=sample.captions,
        mirrored=sample.mirrored,
        content=sample.content,
        style=sample.style,
        offsets=tuple((x, y, z) for x, y, z in skeleton.offsets.round(5).tolist()),
        foot_height=skeleton.foot_height,
    )
    return entry, features.astype(np.float16)


def _write_shard(out: Path, number: int, rows: Sequence[Features], lines: Sequence[Entry | Skipped]) -> None:
    """The features first: whoever sees the lines finds a whole shard."""
    with replacing(out / f"{shard_name(number)}.npy") as temporary:
        np.save(temporary, np.concatenate(rows), allow_pickle=False)
    _write(out / f"{shard_name(number)}.jsonl", msgspec.json.Encoder().encode_lines(lines))


def _finish(out: Path, head: Head) -> None:
    """Statistics and report, then the mark that all is there."""
    shards = read_shards(out)
    lines = [line for lines in shards for line in lines]
    entries = [line for line in lines if isinstance(line, Entry)]
    skipped = [line for line in lines if isinstance(line, Skipped)]
    if not entries:
        raise SourceError(f"none of the {head.clips} clips can be read; the first, {skipped[0].name}: {skipped[0].why}")
    mean, std = _statistics(np.load(out / f"{shard_name(n)}.npy", mmap_mode="r") for n in range(len(shards)))
    _write(out / "report.md", report(head, entries, skipped).encode())
    finished = msgspec.structs.replace(head, finished=True, mean=tuple(mean.tolist()), std=tuple(std.tolist()))
    _write(out / "dataset.json", msgspec.json.encode(finished))


def _statistics(shards: Iterable[Features]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean and standard deviation (140,) of all frames and their mirror images."""
    count, total, squares = 0, np.zeros(WIDTH), np.zeros(WIDTH)
    for shard in shards:
        for rows in (shard.astype(np.float32), mirror(shard.astype(np.float32))):
            count += len(rows)
            total += rows.sum(axis=0, dtype=np.float64)
            squares += np.square(rows, dtype=np.float64).sum(axis=0)
    mean = total / count
    return mean, np.sqrt(np.maximum(squares / count - mean**2, 0.0))


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(content)
