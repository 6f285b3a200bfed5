"""Batches of clips and captions from a data set, for training. What a batch holds depends on its number alone."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.data.dataset import Dataset, Entry
from motiongen.features import CONTACTS, HEIGHT, PLANAR, TURNS, WIDTH, YAW
from motiongen.motion import SMPL_JOINTS
from motiongen.text.say_numbers import says_number

Floats = NDArray[np.float32]

LONGEST = 300  # frames: the longest stretch that a model sees at once
SHORTEST_CROP = 60
TOGETHER = 8  # batches drawn at once and sorted by length, so that little is padded
CUT = ("bandai-namco", "cmu")  # their clips go on with one thing: any stretch shows it, as long as nothing is counted
_OTHER = {"left": "right", "right": "left"}
_SIDE = re.compile("left|right")
_LEG = [SMPL_JOINTS.index(name) for name in ("left_knee", "left_ankle", "right_knee", "right_ankle")]


@dataclass(frozen=True)
class Scale:
    """What a model's numbers mean: `mean` and `std` (140,) of features, `offsets` (22, 3) in metres of its skeleton."""

    mean: Floats
    std: Floats
    offsets: Floats


@dataclass(frozen=True)
class Batch:
    """`x` (B, T, 140) normalised features, `frames` (B, T) which count, `captions` (B) and `actions` (B) of them, an
    action "" where a clip shows more than one. T is a multiple of the patch that was asked for. `whole` (N, T): the
    `frames` of all clips of the batch, where these B are a share of them."""

    x: Floats
    frames: NDArray[np.bool_]
    captions: tuple[str, ...]
    actions: tuple[str, ...]
    whole: NDArray[np.bool_]


@dataclass(frozen=True)
class _Pick:
    clip: int
    mirrored: bool
    start: int
    frames: int
    caption: str


class Batches:
    """Draws from the training split: a clip by rarity, a side, a stretch, a caption that holds for the stretch."""

    def __init__(self, data: Dataset, scale: Scale, *, size: int, patch: int, seed: int) -> None:
        self._data, self._scale, self._size, self._patch, self._seed = data, scale, size, patch, seed
        usable = [i for i, e in enumerate(data.entries) if e.split == "train" and _fits(e)]
        if not usable:
            raise ValueError(f"{data.folder}: no training clip of at most {LONGEST / 30:.0f} s")
        self._rows = np.array(usable)
        self._chance = chances([data.entries[i] for i in usable])
        self._drawn: tuple[int, list[list[_Pick]]] = (-1, [])

    def captions(self) -> list[str]:
        """Every caption that can be drawn."""
        clips = [int(i) for i in self._rows]
        return sorted({c for i in clips for mirrored in (False, True) for c in self._data.captions(i, mirrored)})

    def draw(self, number: int, share: slice = slice(None)) -> Batch:
        """Batch `number`, or the `share` of its clips; the same for the same seed and data."""
        group, place = divmod(number, TOGETHER)
        if self._drawn[0] != group:
            self._drawn = (group, self._group(group))
        picks = self._drawn[1][place]
        length = self._patch * math.ceil(max(p.frames for p in picks) / self._patch)
        whole = np.arange(length) < np.array([[p.frames] for p in picks])
        picks = picks[share]
        x = np.zeros((len(picks), length, len(self._scale.mean)), np.float32)
        for out, pick in zip(x, picks, strict=True):
            clip = features_on(self._data, pick.clip, pick.mirrored, self._scale)[pick.start : pick.start + pick.frames]
            out[: pick.frames] = (clip - self._scale.mean) / self._scale.std
        actions = tuple(action_of(self._data.entries[p.clip], p.mirrored) for p in picks)
        return Batch(x, whole[share], tuple(p.caption for p in picks), actions, whole)

    def _group(self, group: int) -> list[list[_Pick]]:
        rng = np.random.default_rng([self._seed, group])
        rows = rng.choice(self._rows, self._size * TOGETHER, p=self._chance)
        picks = sorted((self._pick(int(i), rng) for i in rows), key=lambda p: p.frames)
        batches = [picks[at : at + self._size] for at in range(0, len(picks), self._size)]
        return [batches[i] for i in rng.permutation(TOGETHER)]

    def _pick(self, i: int, rng: np.random.Generator) -> _Pick:
        entry, mirrored = self._data.entries[i], bool(rng.random() < 0.5)
        said = self._data.captions(i, mirrored)
        plain = [c for c in said if not says_number(c)]
        room = entry.frames - SHORTEST_CROP
        if entry.source in CUT and plain and room > 0 and (entry.frames > LONGEST or rng.random() < 0.5):
            frames = SHORTEST_CROP + int(rng.integers(min(room, LONGEST - SHORTEST_CROP) + 1))
            start = self._start(i, frames, rng)
            return _Pick(i, mirrored, start, frames, str(rng.choice(plain)))
        return _Pick(i, mirrored, 0, entry.frames, str(rng.choice(np.array(said, object))))

    def _start(self, i: int, frames: int, rng: np.random.Generator) -> int:
        """Half of the stretches from near the clip's start, the rest where most happens."""
        room = self._data.entries[i].frames - frames
        if rng.random() < 0.5:
            return int(rng.integers(min(room, 10) + 1))
        stir = np.abs(np.diff(self._data.features(i)[:, TURNS], axis=0)).sum(1)
        starts = rng.integers(0, room + 1, 4)
        return int(max(starts, key=lambda s: stir[s : s + frames].sum()))


def features_on(data: Dataset, i: int, mirrored: bool, scale: Scale) -> Floats:
    """Features of a clip as the scale's skeleton has to move, so that its feet do not slide: lengths go by legs."""
    features = data.features(i, mirrored)
    longer = _leg(scale.offsets) / _leg(np.array(data.entries[i].offsets))
    features[:, [PLANAR.start, PLANAR.start + 1, HEIGHT]] *= longer
    return features


def scale_of(data: Dataset) -> Scale:
    """Statistics of the training clips, fit to normalise by, and the skeleton of the first one.

    Orientations share one floor: what hardly moves must not be blown up to the size of what does. But a nod is all in
    two joints, and a step's way in three numbers: among 140 the noise drowns them and the loss does not miss them, so
    they are shown larger by `_gain` (as Guo et al. 2022 do with root and contacts, by 5).
    """
    mean, std = np.array(data.head.mean), np.array(data.head.std)
    std[TURNS] = np.maximum(std[TURNS], 0.1)
    std[CONTACTS] = 0.5
    std /= _gain()
    offsets = np.array(next(e.offsets for e in data.entries if e.split == "train"))
    return Scale(*(y.astype(np.float32) for y in (mean, std, offsets)))


def actions_of(data: Dataset) -> tuple[str, ...]:
    """Names of the actions that the training clips show, one at a time."""
    rows = [e for e in data.entries if e.split == "train"]
    return tuple(sorted({action_of(e, mirrored) for e in rows for mirrored in (False, True)} - {""}))


def action_of(entry: Entry, mirrored: bool) -> str:
    """The content of a clip or of its mirror image, as "wave-left-hand"; "" of one that is composed of several."""
    if set(entry.content) & set("+>"):
        return ""
    return _SIDE.sub(lambda side: _OTHER[side[0]], entry.content) if mirrored else entry.content


def _gain() -> NDArray[np.float64]:
    """(140,): by how much more than its deviation each feature counts."""
    gain = np.ones(WIDTH)
    gain[[YAW, PLANAR.start, PLANAR.start + 1, HEIGHT]] = 3.0
    for names, larger in ((("head", "neck"), 3.0), (("pelvis", "spine1", "spine2", "spine3"), 2.5)):
        for name in names:
            start = TURNS.start + 6 * SMPL_JOINTS.index(name)
            gain[start : start + 6] = larger
    return gain


def _fits(entry: Entry) -> bool:
    return entry.frames <= LONGEST or (entry.source in CUT and not all(map(says_number, entry.captions)))


def chances(entries: list[Entry]) -> NDArray[np.float64]:
    """Chance of each clip: small sources somewhat above their share of frames; in a source, rare contents too."""
    kinds = Counter((e.source, e.content, e.style) for e in entries)
    chance = np.array([kinds[e.source, e.content, e.style] ** -0.6 for e in entries])
    for source in {e.source for e in entries}:
        its = np.array([e.source == source for e in entries])
        frames = sum(e.frames for e in entries if e.source == source)
        chance[its] *= frames**0.75 / chance[its].sum()
    return chance / chance.sum()


def _leg(offsets: NDArray[np.floating]) -> float:
    return float(np.linalg.norm(offsets[_LEG], axis=-1).sum())
