"""Batches for training an evaluator: clips by rarity, a side, a stretch, a caption each."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from rich.progress import track
from safetensors.numpy import load_file, save_file
from torch import Tensor

from motiongen.captions import swap_sides
from motiongen.data.dataset import Dataset, Entry
from motiongen.evaluation.judge import Kind, padded, words
from motiongen.evaluation.negatives import may_be_same, telling
from motiongen.evaluation.seen import MOST_FRAMES, WIDTH, mirror_seen, see
from motiongen.files import replacing
from motiongen.nn import Floats
from motiongen.text import TextEncoder

CAPTIONS = 2  # of a clip and of its mirror image that "tmr" learns from: its word vectors take 15 ms a caption
RARITY = 0.5  # a label with n clips is drawn n ** (1 - RARITY) times as often as one with a single clip


class Batches:
    """Draws batches from the training clips of a data set; the draw depends on the step alone.

    Raises ValueError where there are fewer training clips than `batch`.
    """

    def __init__(self, data: Dataset, kind: Kind, batch: int, seed: int, cache: Path) -> None:
        rows = [i for i, e in enumerate(data.entries) if e.split == "train"]
        if len(rows) < batch:
            raise ValueError(f"{data.folder}: {len(rows)} training clips, fewer than a batch of {batch}")
        self._kind, self._batch, self._seed = kind, batch, seed
        self._entries = [data.entries[i] for i in rows]
        self._seen = [
            see(data.features(i), np.array(data.entries[i].offsets))
            for i in track(rows, "reading clips", transient=True)
        ]
        self.mean, self.std = statistics(self._seen)
        labels = [clip_label(e) for e in self._entries]
        count = {label: labels.count(label) for label in set(labels)}
        weight = np.array([count[label] ** -RARITY if label else 1.0 for label in labels])
        self._chance = weight / weight.sum()
        self._encoder = TextEncoder()
        self._texts = _Contextual(self._entries, self._encoder, cache) if kind == "tmr" else None

    def draw(self, step: int) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor], Tensor]:
        """Frames (B, T, 71) and how many (B), word vectors (B, N, 384) and mask (B, N), no negatives (B, B)."""
        rng = np.random.default_rng([self._seed, step])
        clips, captions, labels = [], [], []
        for i in rng.choice(len(self._entries), self._batch, replace=False, p=self._chance):
            entry, mirrored = self._entries[i], bool(rng.random() < 0.5)
            start = int(rng.integers(0, max(len(self._seen[i]) - MOST_FRAMES, 0) + 1))
            clip = self._seen[i][start : start + MOST_FRAMES]
            clips.append(mirror_seen(clip) if mirrored else clip)
            said = entry.mirrored if mirrored else entry.captions
            captions.append(str(rng.choice(said[:CAPTIONS] if self._texts else said)))
            labels.append(swap_sides(clip_label(entry)) if mirrored else clip_label(entry))
        told = telling(captions)
        if self._texts is None:
            texts, sentences = words(self._encoder, captions, self._kind), None
        else:
            texts, sentences = self._texts(captions)
        same = may_be_same(captions, labels, told, sentences)
        return padded(clips, self.mean, self.std), texts, torch.from_numpy(same)


def clip_label(entry: Entry) -> str:
    """Content and style of a clip; empty where the content is not known."""
    return f"{entry.content}/{entry.style}" if entry.content else ""


def statistics(seen: list[NDArray[np.float32]]) -> tuple[Floats, Floats]:
    """Mean and deviation (71) over clips and their mirror images; a deviation under 0.01 is taken as 0.01."""
    count, total, squares = 0, np.zeros(WIDTH), np.zeros(WIDTH)
    for clip in seen:
        for rows in (clip, mirror_seen(clip)):
            count += len(rows)
            total += rows.sum(0, dtype=np.float64)
            squares += np.square(rows, dtype=np.float64).sum(0)
    mean = total / count
    std = np.sqrt(np.maximum(squares / count - mean**2, 0.0))
    return mean.astype(np.float32), np.maximum(std, 0.01).astype(np.float32)


class _Contextual:
    """Word vectors in context and sentence vectors of the captions that are learnt from, kept in a file."""

    def __init__(self, entries: list[Entry], encoder: TextEncoder, cache: Path) -> None:
        captions = sorted({c for e in entries for side in (e.captions, e.mirrored) for c in side[:CAPTIONS]})
        self._place = {caption: i for i, caption in enumerate(captions)}
        key = hashlib.sha256("\n".join(captions).encode()).hexdigest()[:16]
        path = cache / f"captions-{key}.safetensors"
        if not path.is_file():
            _encode(captions, encoder, path)
        tensors = load_file(path)
        self._words, self._starts, self._sentences = tensors["words"], tensors["starts"], tensors["sentences"]

    def __call__(self, captions: list[str]) -> tuple[tuple[Tensor, Tensor], NDArray[np.float32]]:
        """Word vectors (B, N, 384), mask (B, N) and unit sentence vectors (B, 384)."""
        at = [self._place[c] for c in captions]
        each = [self._words[self._starts[i] : self._starts[i + 1]] for i in at]
        x = np.zeros((len(at), max(map(len, each)), each[0].shape[1]), np.float32)
        mask = np.zeros(x.shape[:2], bool)
        for row, there, vectors in zip(x, mask, each, strict=True):
            row[: len(vectors)], there[: len(vectors)] = vectors, True
        return (torch.from_numpy(x), torch.from_numpy(mask)), self._sentences[at]


def _encode(captions: list[str], encoder: TextEncoder, path: Path) -> None:
    """All words (W, 384) one caption after another, half precision; `starts` (N + 1); `sentences` (N, 384)."""
    words: list[NDArray[np.float16]] = [np.zeros((0, 384), np.float16)] * len(captions)
    sentences = np.zeros((len(captions), 384), np.float32)
    order = sorted(range(len(captions)), key=lambda i: len(captions[i]))
    for start in track(range(0, len(order), 64), "encoding captions", transient=True):
        at = order[start : start + 64]
        vectors, mask, sentences[at] = encoder([captions[i] for i in at])
        for i, row, there in zip(at, vectors, mask, strict=True):
            words[i] = row[there].astype(np.float16)
    starts = np.concatenate([[0], np.cumsum([len(w) for w in words])])
    with replacing(path) as temporary:
        save_file({"words": np.concatenate(words), "starts": starts, "sentences": sentences}, temporary)
