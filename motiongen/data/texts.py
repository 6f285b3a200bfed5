"""Text vectors of many captions, encoded once and kept beside the data set or the training run.

`texts-KEY-words.npy` holds one row a token, of all captions one after another, in half precision; it stays on disk and
is memory-mapped. The key is a hash of the captions.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen.files import replacing
from motiongen.text import MAX_TOKENS, WIDTH, TextEncoder

_BATCH = 256


@dataclass(frozen=True)
class Texts:
    """`words` (tokens, 384) float16: caption i has rows `starts[i]` to `starts[i + 1]`; `sentences` (N, 384);
    `row` is the number of each caption."""

    row: dict[str, int]
    words: NDArray[np.float16]
    starts: NDArray[np.int64]
    sentences: NDArray[np.float32]

    def batch(self, captions: Sequence[str]) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]:
        """Token vectors (B, longest, 384), which of them are words (B, longest), and sentence vectors (B, 384).

        Raises KeyError for a caption that was not encoded.
        """
        rows = np.array([self.row[caption] for caption in captions])
        counts = self.starts[rows + 1] - self.starts[rows]
        mask = np.arange(counts.max()) < counts[:, None]
        words = np.zeros((*mask.shape, WIDTH), np.float32)
        for out, row, count in zip(words, rows, counts, strict=True):
            out[:count] = self.words[self.starts[row] : self.starts[row] + count]
        return words, mask, self.sentences[rows]


def encode_texts(
    captions: Sequence[str], folder: Path, *, progress: Callable[[int, int], None] = lambda *_: None
) -> Texts:
    """Vectors of the different `captions`, from `folder` where they are there already, else encoded and kept there.

    `progress` is told how many of how many are done. Raises OSError where `folder` cannot be written.
    """
    captions = sorted(set(captions), key=lambda c: (len(c), c))  # texts of like length together: less padding
    key = hashlib.sha256("\n".join(captions).encode()).hexdigest()[:16]
    paths = [folder / f"texts-{key}-{part}.npy" for part in ("words", "starts", "sentences")]
    if not all(path.is_file() for path in paths):
        folder.mkdir(parents=True, exist_ok=True)
        words, starts, sentences = _encode(captions, progress)
        for path, rows in zip(paths, (words, starts, sentences), strict=True):
            with replacing(path) as temporary:
                np.save(temporary, np.asarray(rows), allow_pickle=False)
    words, starts, sentences = (np.load(path, mmap_mode="r", allow_pickle=False) for path in paths)
    return Texts({caption: i for i, caption in enumerate(captions)}, words, np.array(starts), np.array(sentences))


def _encode(
    captions: Sequence[str], progress: Callable[[int, int], None]
) -> tuple[NDArray[np.float16], NDArray[np.int64], NDArray[np.float32]]:
    encoder = TextEncoder()
    words = np.zeros((len(captions) * MAX_TOKENS, WIDTH), np.float16)
    starts, sentences = np.zeros(len(captions) + 1, np.int64), np.zeros((len(captions), WIDTH), np.float32)
    for at in range(0, len(captions), _BATCH):
        progress(at, len(captions))
        vectors, mask, said = encoder(list(captions[at : at + _BATCH]))
        counts = mask.sum(1)
        starts[at + 1 : at + 1 + len(said)] = starts[at] + np.cumsum(counts)
        words[starts[at] : starts[at + len(said)]] = vectors[mask]
        sentences[at : at + len(said)] = said
    progress(len(captions), len(captions))
    return words[: starts[-1]], starts, sentences
