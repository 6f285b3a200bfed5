"""Clips of a data set joined into long motions, cut where a new prompt might come: what the live network learns from.

A clip breaks off anywhere, as it does when somebody says the next thing, and the next begins where its movement does.
Kept in a folder: `joined.npy` holds features (frames, 140), float16, of one motion after another; `joined.json` says
which clip is shown from which frame on.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen.compose.motions import sequence
from motiongen.compose.seams import on_skeleton
from motiongen.data.dataset import Dataset, Entry
from motiongen.diffusion.batches import chances
from motiongen.features import FPS, TURNS, motion_to_features
from motiongen.files import replacing
from motiongen.motion import Label, Motion, Skeleton

CLIPS = (3, 5)  # least and most of a motion
IDLE_SHARE = 0.22  # of the clips: what is done between prompts
LONGEST_S, SHORTEST_S = 6.0, 1.2  # of a clip in a motion
WHOLE_SHARE = 0.5  # of the clips are not broken off
STIRS, LEAD = 0.5, 4  # rad/s of any joint in the heading frame; a clip begins so many frames before it
IDLE = "idle"


@dataclass(frozen=True)
class Segment:
    """Rows `start` to `stop` of the features show `clip` of the data set; the motion they are part of begins at row
    `motion`."""

    start: int
    stop: int
    clip: int
    motion: int


@dataclass(frozen=True)
class Joined:
    """`features` (frames, 140) of all motions, one after another, and their segments in order."""

    features: NDArray[np.float16]
    segments: tuple[Segment, ...]


def open_joined(
    data: Dataset,
    skeleton: Skeleton,
    folder: Path,
    *,
    count: int,
    seed: int,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Joined:
    """`count` motions joined from the training clips of `data`, on `skeleton`; read from `folder` where they are there.

    Raises ValueError where the data set has no idle clip or no other, OSError where `folder` cannot be written.
    """
    path = folder / "joined.json"
    if not path.is_file():
        rows, segments = _made(data, skeleton, count, seed, progress)
        with replacing(folder / "joined.npy") as temporary:
            np.save(temporary, rows, allow_pickle=False)
        with replacing(path) as temporary:  # last: whoever sees it finds the rows whole
            temporary.write_text(json.dumps([list(vars(each).values()) for each in segments]), encoding="utf-8")
    features = np.load(folder / "joined.npy", mmap_mode="r", allow_pickle=False)
    return Joined(features, tuple(Segment(*each) for each in json.loads(path.read_text(encoding="utf-8"))))


def _made(
    data: Dataset, skeleton: Skeleton, count: int, seed: int, progress: Callable[[int, int], None]
) -> tuple[NDArray[np.float16], list[Segment]]:
    usable = [i for i, entry in enumerate(data.entries) if entry.split == "train" and fits(entry)]
    idle, other = ([i for i in usable if (data.entries[i].content == IDLE) == is_idle] for is_idle in (True, False))
    if not idle or not other:
        raise ValueError(f"{data.folder}: a live network learns from idle clips and others; there are {len(idle)} idle")
    chance = chances([data.entries[i] for i in other])
    rng = np.random.default_rng(seed)
    rows: list[NDArray[np.float16]] = []
    segments: list[Segment] = []
    at = done = 0
    while done < count:
        progress(done, count)
        size = int(rng.integers(CLIPS[0], CLIPS[1] + 1))
        drawn = [
            int(rng.choice(idle) if rng.random() < IDLE_SHARE else rng.choice(other, p=chance)) for _ in range(size)
        ]
        clips = [_cut(data, i, rng) for i in drawn]
        try:
            motion = sequence([on_skeleton(clips[0], skeleton), *clips[1:]])
        except ValueError:  # they do not go over into each other
            continue
        rows.append(motion_to_features(motion).astype(np.float16))
        starts = [round(label.start_s * FPS) for label in motion.labels]
        ends = [*starts[1:], len(motion)]
        segments += [
            Segment(at + start, at + end, int(label.text), at)
            for start, end, label in zip(starts, ends, motion.labels, strict=True)
        ]
        at += len(motion)
        done += 1
    progress(count, count)
    return np.concatenate(rows), segments


def fits(entry: Entry) -> bool:
    """Whether a clip shows one thing for long enough."""
    return ">" not in entry.content and entry.seconds >= SHORTEST_S


def _cut(data: Dataset, clip: int, rng: np.random.Generator) -> Motion:
    """From where it begins to move until anywhere; labelled with its number."""
    motion = data.motion(clip)
    begins = 0 if data.entries[clip].content == IDLE else _begins(data.features(clip))
    most = min(len(motion) - begins, round(LONGEST_S * FPS))
    least = min(most, round(SHORTEST_S * FPS))
    count = most if rng.random() < WHOLE_SHARE else int(rng.integers(least, most + 1))
    kept = slice(begins, begins + count)
    label = Label(0.0, (count - 1) / FPS, str(clip))
    return replace(
        motion, root_pos=motion.root_pos[kept], joint_quat=motion.joint_quat[kept], contacts=None, labels=(label,)
    )


def _begins(features: NDArray[np.float32]) -> int:
    """The frame a little before anything moves; never so late that less than the shortest clip is left."""
    change = np.diff(features[:, TURNS], axis=0).reshape(len(features) - 1, -1, 3)
    moves = np.flatnonzero(np.linalg.norm(change, axis=-1).max(1) * FPS > STIRS)
    latest = len(features) - round(SHORTEST_S * FPS)
    return max(0, min(int(moves[0]) - LEAD if len(moves) else 0, latest))
