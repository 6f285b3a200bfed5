"""Text vectors of many captions, encoded once and kept in a folder beside what needs them.

Reading them takes numpy alone: where all captions are encoded, no encoder is loaded, nor need it be there.

A part of the cache is four files of at most 30 MB. `texts-0000.json` lists its captions; `texts-0000-words.npy`,
memory-mapped, holds one row a token of all of them in half precision; `-starts.npy` and `-sentences.npy` have one row a
caption. Captions that no part has become new parts.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen.data.dataset import Dataset
from motiongen.files import replacing

_BATCH = 256
_PART_BYTES = 30_000_000  # of a part's largest file
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
        words = np.zeros((*mask.shape, said[0].shape[1]), np.float32)
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
    if not missing:
        return texts
    for number, (said, part) in enumerate(_encode(missing, progress), start=len(texts.parts)):
        name = f"texts-{number:04d}"
        for kind in _ARRAYS:
            with replacing(folder / f"{name}-{kind}.npy") as temporary:
                np.save(temporary, getattr(part, kind), allow_pickle=False)
        with replacing(folder / f"{name}.json") as temporary:  # last: whoever sees it finds the part whole
            temporary.write_text(json.dumps(said), encoding="utf-8")
    return _read(folder)


def data_texts(
    data: Dataset, captions: Sequence[str], *, progress: Callable[[int, int], None] = lambda *_: None
) -> Texts:
    """Vectors of captions of a data set, kept in its folder `texts`; see `encode_texts`."""
    return encode_texts(captions, data.folder / "texts", progress=progress)


def _read(folder: Path) -> Texts:
    place: dict[str, tuple[int, int]] = {}
    parts: list[_Part] = []
    while (path := folder / f"texts-{len(parts):04d}.json").is_file():
        captions = json.loads(path.read_text(encoding="utf-8"))
        place |= {caption: (len(parts), row) for row, caption in enumerate(captions)}
        words, starts, sentences = (  # plain arrays on the mapped memory: numpy's memmap takes its time for every row
            np.asarray(np.load(path.with_name(f"{path.stem}-{kind}.npy"), mmap_mode="r", allow_pickle=False))
            for kind in _ARRAYS
        )
        parts.append(_Part(words, starts, sentences))
    return Texts(place, tuple(parts))


def _encode(captions: Sequence[str], progress: Callable[[int, int], None]) -> Iterator[tuple[list[str], _Part]]:
    """Captions and their part, as many at a time as a part holds."""
    from motiongen.text.encoder import TextEncoder

    encoder = TextEncoder()
    said: list[str] = []
    encoded: list[tuple[list[NDArray[np.float16]], NDArray[np.float32]]] = []
    room = _PART_BYTES
    for at in range(0, len(captions), _BATCH):
        progress(at, len(captions))
        batch = list(captions[at : at + _BATCH])
        vectors, mask, sentences = encoder(batch)
        words = [clip[real].astype(np.float16) for clip, real in zip(vectors, mask, strict=True)]
        size = sum(clip.nbytes for clip in words)
        if said and size > room:
            yield said, _part(encoded)
            said, encoded, room = [], [], _PART_BYTES
        said, room = said + batch, room - size
        encoded.append((words, sentences))
    progress(len(captions), len(captions))
    yield said, _part(encoded)


def _part(encoded: Sequence[tuple[list[NDArray[np.float16]], NDArray[np.float32]]]) -> _Part:
    words = [clip for batch, _ in encoded for clip in batch]
    starts = np.cumsum([0, *map(len, words)])
    return _Part(np.concatenate(words), starts, np.concatenate([sentences for _, sentences in encoded]))
