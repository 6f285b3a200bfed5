"""Build a data set: read every clip of the sources once, write features in shards, go on where a build was cut off."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from motiongen.data.clip import Clip, SourceError
from motiongen.data.dataset import (
    VERSION,
    Dataset,
    DatasetError,
    Entry,
    Head,
    load_shards,
    open_dataset,
    read_head,
    read_shards,
    shard_name,
    statistics,
    write_line,
)
from motiongen.data.pictures import different, draw_clips
from motiongen.data.read_clips import Features, Line, read_clips
from motiongen.data.report import report
from motiongen.data.sources import absolute, find_all
from motiongen.features import WIDTH
from motiongen.files import replacing

SHARD_BYTES = 10_000_000  # what an interruption can lose: some ten minutes of motion, seconds of work
PICTURED = 8  # clips in the report's picture


def build(
    specs: Sequence[str],
    out: Path,
    *,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    shard_bytes: int = SHARD_BYTES,
) -> tuple[Dataset, bool]:
    """Build the data set of the sources `specs` (see `find_all`) in `out`; False where it was there already.

    An unfinished build of the same sources goes on with the first clip that is in no shard; a finished one is only
    opened. Clips that cannot be read are skipped and listed. `jobs` processes read, 1 being this one; the files are the
    same for any number. `progress` is told how many clips of how many are done.

    Raises SourceError for a bad source, or where no clip of it can be read; DatasetError where `out` holds something
    else or a data set of other sources; ValueError for fewer than one job; OSError where `out` cannot be written.
    """
    if jobs < 1:
        raise ValueError(f"jobs must be 1 or more, not {jobs}")
    clips = find_all(specs)
    head = Head(VERSION, tuple(map(absolute, specs)), len(clips), _stamp(clips))
    if _prepare(out, head):
        return open_dataset(out), False
    shards = read_shards(out)
    done = sum(map(len, shards))
    _write_shards(clips, done, len(shards), out, shard_bytes, jobs, progress or (lambda *_: None))
    _finish(out, head)
    return open_dataset(out), True


def _stamp(clips: Iterable[Clip]) -> str:
    """One stamp of all the clips and their order."""
    return hashlib.sha256("\n".join(f"{c.name} {c.split} {c.stamp}" for c in clips).encode()).hexdigest()[:16]


def _prepare(out: Path, head: Head) -> bool:
    """Make `out` ready for the build that `head` describes; True where that build is finished already."""
    if out.exists() and not out.is_dir():
        raise DatasetError(f"{out}: is a file, expected a folder")
    if not (out / "dataset.json").is_file():
        if out.is_dir() and any(out.iterdir()):
            raise DatasetError(f"{out}: not empty and not a data set; name another folder")
        out.mkdir(parents=True, exist_ok=True)
        _write(out / "dataset.json", json.dumps(asdict(head)).encode())
        return False
    there = read_head(out)
    if (there.sources, there.clips) != (head.sources, head.clips):
        state = "a data set" if there.finished else "an unfinished data set"
        raise DatasetError(
            f"{out}: holds {state} of {there.clips} clips of {', '.join(there.sources)}, not {head.clips} of "
            f"{', '.join(head.sources)}; remove it or name another folder"
        )
    if there.stamp != head.stamp:
        raise DatasetError(f"{out}: the sources changed since this was built; remove it to build anew")
    for ours in ("shard", "dataset", "report"):
        for left_over in out.glob(f".{ours}-*"):  # a process that was killed had no time to tidy up
            left_over.unlink()
    return there.finished


def _write_shards(
    clips: Sequence[Clip],
    done: int,
    number: int,
    out: Path,
    shard_bytes: int,
    jobs: int,
    progress: Callable[[int, int], None],
) -> None:
    """Write the clips from `done` on into shards from `number` on, each as full as `shard_bytes` allows."""
    rows: list[Features] = []
    lines: list[Line] = []
    start = 0
    progress(done, len(clips))
    for at, (line, features) in enumerate(read_clips(clips[done:], jobs), start=done + 1):
        if start and (start + len(features)) * WIDTH * 2 > shard_bytes:
            _write_shard(out, number, rows, lines)
            rows, lines, start, number = [], [], 0, number + 1
        rows.append(features)
        lines.append(replace(line, start=start) if isinstance(line, Entry) else line)
        start += len(features)
        progress(at, len(clips))
    if lines:
        _write_shard(out, number, rows, lines)


def _write_shard(out: Path, number: int, rows: Sequence[Features], lines: Sequence[Line]) -> None:
    """The features first: whoever sees the lines finds a whole shard."""
    with replacing(out / f"{shard_name(number)}.npy") as temporary:
        np.save(temporary, np.concatenate(rows), allow_pickle=False)
    _write(out / f"{shard_name(number)}.jsonl", "".join(map(write_line, lines)).encode())


def _finish(out: Path, head: Head) -> None:
    """Statistics and report, then the mark that all is there."""
    found = load_shards(out, head)
    if not found.entries:
        first = found.skipped[0]
        raise SourceError(f"none of the {head.clips} clips can be read; the first, {first.name}: {first.why}")
    mean, std = statistics(found.features(i) for i, entry in enumerate(found.entries) if entry.split == "train")
    _write(out / "report.md", report(found, _pictured(found, out / "report.png")).encode())
    finished = replace(head, finished=True, mean=mean, std=std)
    _write(out / "dataset.json", json.dumps(asdict(finished)).encode())


def _pictured(found: Dataset, path: Path) -> bool:
    """Whether a picture of a few clips could be drawn: a data set is whole without, as rigcast is without Pillow."""
    try:
        draw_clips(found, different(found.entries, PICTURED), path)
    except ModuleNotFoundError:
        return False
    return True


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as temporary:
        temporary.write_bytes(content)
