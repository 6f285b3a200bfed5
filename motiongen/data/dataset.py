"""A built data set: features of many clips in memory-mapped shards, and what each clip is.

| file | holds |
|---|---|
| `dataset.json` | format version, sources, whether it is finished, statistics |
| `shard-0000.npy` … | features (frames, 140), float16, of clips one after another |
| `shard-0000.jsonl` … | one line a clip of that shard; a shard is done once this file is there |
| `report.md` | what is in it, for people |
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.features import FPS, MIRRORED_JOINT, WIDTH, features_to_motion, mirror
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source

VERSION = 1


class DatasetError(ValueError):
    """A folder that is no data set, or not a whole one; the message names it and says what to do."""


@dataclass(frozen=True)
class Head:
    """What `dataset.json` says. `clips`: how many the sources hold; `stamp` changes when they do.

    `mean` and `std` (140) are over the clips of the training split and their mirror images; empty until the build is
    `finished`, and where that split has no clip.
    """

    version: int
    sources: tuple[str, ...]
    clips: int
    stamp: str = ""
    finished: bool = False
    mean: tuple[float, ...] = ()
    std: tuple[float, ...] = ()


@dataclass(frozen=True)
class Entry:
    """One clip: `frames` rows of its shard from row `start` on; `offsets` (22, 3) in metres of its skeleton."""

    name: str
    source: str
    file: str
    licence: str
    split: str
    start: int
    frames: int
    captions: tuple[str, ...]
    mirrored: tuple[str, ...]
    content: str
    style: str
    offsets: tuple[tuple[float, float, float], ...]
    foot_height: tuple[float, float]

    @property
    def seconds(self) -> float:
        return self.frames / FPS


@dataclass(frozen=True)
class Skipped:
    """A clip that could not be read, and why."""

    name: str
    why: str


_KINDS = {Entry: "clip", Skipped: "skipped"}
_DAMAGE = (ValueError, KeyError, TypeError, AttributeError)  # whatever comes of JSON that is not as it was written


@dataclass(frozen=True)
class Dataset:
    """A finished data set. Clip i is `entries[i]` and lies in `shards[shard_of[i]]`, (frames, 140) each."""

    folder: Path
    head: Head
    entries: tuple[Entry, ...]
    skipped: tuple[Skipped, ...]
    shard_of: tuple[int, ...]
    shards: tuple[NDArray[np.float16], ...]

    def __len__(self) -> int:
        return len(self.entries)

    def features(self, i: int, mirrored: bool = False) -> NDArray[np.float32]:
        """Features (T, 140) of clip i, or of its mirror image."""
        entry = self.entries[i]
        rows = self.shards[self.shard_of[i]][entry.start : entry.start + entry.frames].astype(np.float32)
        return mirror(rows) if mirrored else rows

    def captions(self, i: int, mirrored: bool = False) -> tuple[str, ...]:
        """What clip i, or its mirror image, is called."""
        return self.entries[i].mirrored if mirrored else self.entries[i].captions

    def motion(self, i: int, mirrored: bool = False) -> Motion:
        """Clip i, or its mirror image, from the origin, facing +x, labelled with its first caption."""
        entry = self.entries[i]
        offsets = np.array(entry.offsets)
        if mirrored:
            offsets = offsets[MIRRORED_JOINT] * [1.0, -1.0, 1.0]
        skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, offsets, entry.foot_height)
        label = Label(0.0, (entry.frames - 1) / FPS, self.captions(i, mirrored)[0])
        source = Source(entry.name, licence=entry.licence)
        return features_to_motion(self.features(i, mirrored), skeleton, labels=(label,), source=source)


def open_dataset(folder: str | Path) -> Dataset:
    """Open a finished data set; its features stay on disk until they are asked for.

    Raises DatasetError where `folder` is no data set, of another version, not finished or damaged.
    """
    folder = Path(folder)
    head = read_head(folder)
    if not head.finished:
        raise DatasetError(f"{folder}: the build was interrupted; run the same rigcast data build again to finish it")
    return load_shards(folder, head)


def load_shards(folder: Path, head: Head) -> Dataset:
    """The data set of the shards in `folder`, finished or not; raises DatasetError where they are not all there."""
    entries: list[Entry] = []
    skipped: list[Skipped] = []
    shard_of: list[int] = []
    shards = []
    for number, lines in enumerate(read_shards(folder)):
        shards.append(_map(folder, number, lines))
        clips = [line for line in lines if isinstance(line, Entry)]
        entries += clips
        skipped += [line for line in lines if isinstance(line, Skipped)]
        shard_of += [number] * len(clips)
    if len(entries) + len(skipped) != head.clips:
        raise DatasetError(f"{folder}: damaged, {len(entries) + len(skipped)} of {head.clips} clips; build it anew")
    return Dataset(folder, head, tuple(entries), tuple(skipped), tuple(shard_of), tuple(shards))


def read_head(folder: Path) -> Head:
    """What `dataset.json` says; raises DatasetError where it is missing, damaged or of another version."""
    path = folder / "dataset.json"
    if not path.is_file():
        raise DatasetError(f"{folder}: not a data set (no dataset.json in it); rigcast data build makes one")
    try:
        fields = _frozen(json.loads(path.read_bytes()))
        version = fields["version"]
        head = Head(**fields) if version == VERSION else None
    except _DAMAGE:
        raise DatasetError(f"{path}: damaged; build the data set anew") from None
    if head is None:
        raise DatasetError(f"{folder}: format version {version}, this rigcast reads {VERSION}; build it anew")
    return head


def read_shards(folder: Path) -> list[list[Entry | Skipped]]:
    """The lines of every shard that is done, in order; raises DatasetError where one is damaged."""
    shards: list[list[Entry | Skipped]] = []
    while (path := folder / f"{shard_name(len(shards))}.jsonl").is_file():
        try:
            shards.append([_read_line(line) for line in path.read_bytes().splitlines()])
        except _DAMAGE:
            raise DatasetError(f"{path}: damaged; build the data set anew") from None
    return shards


def statistics(clips: Iterable[NDArray[np.float32]]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mean and standard deviation (140,) of all frames and their mirror images; empty without clips."""
    count, total, squares = 0, np.zeros(WIDTH), np.zeros(WIDTH)
    for clip in clips:
        for rows in (clip, mirror(clip)):
            count += len(rows)
            total += rows.sum(axis=0, dtype=np.float64)
            squares += np.square(rows, dtype=np.float64).sum(axis=0)
    if not count:
        return (), ()
    mean = total / count
    return tuple(mean.tolist()), tuple(np.sqrt(np.maximum(squares / count - mean**2, 0.0)).tolist())


def write_line(line: Entry | Skipped) -> str:
    """A clip's line in a shard's `.jsonl`."""
    return json.dumps({"type": _KINDS[type(line)], **vars(line)}, ensure_ascii=False) + "\n"


def _read_line(text: bytes) -> Entry | Skipped:
    fields = _frozen(json.loads(text))
    kind = fields.pop("type")
    return (Entry if kind == _KINDS[Entry] else Skipped)(**fields)


def _frozen(fields: dict[str, Any]) -> dict[str, Any]:
    """Fields as JSON has them, with tuples for its lists."""

    def frozen(value: Any) -> Any:
        return tuple(map(frozen, value)) if isinstance(value, list) else value

    return {name: frozen(value) for name, value in fields.items()}


def shard_name(number: int) -> str:
    """Name of a shard's files without their suffix."""
    return f"shard-{number:04d}"


def _map(folder: Path, number: int, lines: Sequence[Entry | Skipped]) -> NDArray[np.float16]:
    """A shard's features, not read before they are used; raises DatasetError where they do not fit its `lines`."""
    path = folder / f"{shard_name(number)}.npy"
    frames = sum(line.frames for line in lines if isinstance(line, Entry))
    try:
        rows = np.load(path, mmap_mode="r", allow_pickle=False) if frames else np.zeros((0, WIDTH), np.float16)
    except (OSError, ValueError, SyntaxError):  # whatever numpy makes of a damaged header
        rows = np.zeros(0)
    if rows.dtype != np.float16 or rows.shape != (frames, WIDTH):
        raise DatasetError(f"{path}: missing or damaged; build the data set anew")
    return rows
