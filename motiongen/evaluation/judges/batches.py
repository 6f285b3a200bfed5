"""Batches for training an evaluator: clips by rarity, a side, a stretch, a caption each."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from rich.progress import track
from torch import Tensor

from motiongen.data.dataset import Dataset, Entry
from motiongen.data.texts import data_texts
from motiongen.evaluation.judges.judge import Kind, padded, words
from motiongen.evaluation.judges.negatives import may_be_same, telling
from motiongen.evaluation.judges.seen import MOST_FRAMES, WIDTH, mirror_seen, see
from motiongen.nn import Floats
from motiongen.text.captions import swap_sides
from motiongen.text.encoder import TextEncoder

RARITY = 0.5  # a label with n clips is drawn n ** (1 - RARITY) times as often as one with a single clip


class Batches:
    """Draws batches from the training clips of a data set; the draw depends on the step alone.

    Raises ValueError where there are fewer training clips than `batch`.
    """

    def __init__(self, data: Dataset, kind: Kind, batch: int, seed: int) -> None:
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
        said = [c for e in self._entries for c in (*e.captions, *e.mirrored)]
        self._texts = data_texts(data, said) if kind == "tmr" else None

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
            captions.append(said[rng.integers(len(said))])
            labels.append(swap_sides(clip_label(entry)) if mirrored else clip_label(entry))
        told = telling(captions)
        if self._texts is None:
            texts, sentences = words(self._encoder, captions, self._kind), None
        else:
            vectors, mask, sentences = self._texts.batch(captions)
            texts = torch.from_numpy(vectors), torch.from_numpy(mask)
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
