"""Text vectors of many captions, encoded once and kept in a folder beside what needs them.

A part of the cache is four files. `texts-0000.json` lists its captions; `texts-0000-words.npy`, memory-mapped, holds
one row a token of all of them in half precision; `-starts.npy` and `-sentences.npy` have one row a caption. Captions
that no part has become a new part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from motiongen.data.dataset import Dataset
from motiongen.files import replacing
from motiongen.text.encoder import MAX_TOKENS, WIDTH, TextEncoder

_BATCH = 256
_ARRAYS = ("words", "starts", "sentences")


@dataclass(frozen=True)
class _Part:
    """`words` (tokens, 384) float16: caption i has rows `starts[i]` to `starts[i + 1]`; `sentences` (N, 384)."""

    words: NDArray[np.float16]
    starts: NDArray[np.int64]
    sentences: NDArray[np.float32]


@dataclass(frozen=True)
class Texts:
    """Vectors of captions; `place` tells the part and the row of each."""

    place: dict[str, tuple[int, int]]
    parts: tuple[_Part, ...]

    def batch(self, captions: Sequence[str]) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]:
        """Token vectors (B, longest, 384), which of them are words (B, longest), and sentence vectors (B, 384).

        Raises KeyError for a caption that was not encoded.
        """
        said = [self._words(caption) for caption in captions]
        counts = np.array([len(each) for each in said])
        mask = np.arange(counts.max()) < counts[:, None]
        words = np.zeros((*mask.shape, WIDTH), np.float32)
        words[mask] = np.concatenate(said)
        return words, mask, self.sentences(captions)

    def sentences(self, captions: Sequence[str]) -> NDArray[np.float32]:
        """Unit sentence vectors (B, 384); raises KeyError for a caption that was not encoded."""
        places = (self.place[caption] for caption in captions)
        return np.stack([self.parts[part].sentences[row] for part, row in places])

    def _words(self, caption: str) -> NDArray[np.float16]:
        number, row = self.place[caption]
        part = self.parts[number]
        return part.words[part.starts[row] : part.starts[row + 1]]


def encode_texts(
    captions: Sequence[str], folder: Path, *, progress: Callable[[int, int], None] = lambda *_: None
) -> Texts:
    """Vectors of the different `captions`: those that `folder` has are read, the others encoded and kept there.

    `progress` is told how many of how many are done. Raises OSError where `folder` cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    texts = _read(folder)
    missing = sorted(set(captions) - set(texts.place), key=lambda c: (len(c), c))  # of like length: less padding
    if missing:
        name = f"texts-{len(texts.parts):04d}"
        arrays = _encode(missing, progress)
        for kind in _ARRAYS:
            with replacing(folder / f"{name}-{kind}.npy") as temporary:
                np.save(temporary, getattr(arrays, kind), allow_pickle=False)
        with replacing(folder / f"{name}.json") as temporary:  # last: whoever sees it finds the part whole
            temporary.write_bytes(msgspec.json.encode(missing))
        texts = _read(folder)
    return texts


def data_texts(
    data: Dataset, captions: Sequence[str], *, progress: Callable[[int, int], None] = lambda *_: None
) -> Texts:
    """Vectors of captions of a data set, kept in its folder `texts`; see `encode_texts`."""
    return encode_texts(captions, data.folder / "texts", progress=progress)


def _read(folder: Path) -> Texts:
    place: dict[str, tuple[int, int]] = {}
    parts: list[_Part] = []
    while (path := folder / f"texts-{len(parts):04d}.json").is_file():
        captions = msgspec.json.decode(path.read_bytes(), type=list[str])
        place |= {caption: (len(parts), row) for row, caption in enumerate(captions)}
        words, starts, sentences = (  # plain arrays on the mapped memory: numpy's memmap takes its time for every row
            np.asarray(np.load(path.with_name(f"{path.stem}-{kind}.npy"), mmap_mode="r", allow_pickle=False))
            for kind in _ARRAYS
        )
        parts.append(_Part(words, starts, sentences))
    return Texts(place, tuple(parts))


def _encode(captions: Sequence[str], progress: Callable[[int, int], None]) -> _Part:
    encoder = TextEncoder()
    words = np.zeros((len(captions) * MAX_TOKENS, WIDTH), np.float16)
    starts, sentences = np.zeros(len(captions) + 1, np.int64), np.zeros((len(captions), WIDTH), np.float32)
    for at in range(0, len(captions), _BATCH):
        progress(at, len(captions))
        vectors, mask, said = encoder(list(captions[at : at + _BATCH]))
        starts[at + 1 : at + 1 + len(said)] = starts[at] + np.cumsum(mask.sum(1))
        words[starts[at] : starts[at + len(said)]] = vectors[mask]
        sentences[at : at + len(said)] = said
    progress(len(captions), len(captions))
    return _Part(words[: starts[-1]], starts, sentences)
