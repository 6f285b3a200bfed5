"""Training clips from a folder of Bandai-Namco BVH files: features, content, style and split, in one file.

python -m motiongen.corpus ~/motion-data runs/corpus.npz
"""

from __future__ import annotations

import hashlib
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

from motiongen.bvh import read_bvh
from motiongen.captions import CONTENTS, STYLES, style_name, swap_sides
from motiongen.features import WIDTH, mirror, motion_to_features

HELD_OUT = 8  # one clip in eight of every content, at least two where there are eight


@dataclass(frozen=True)
class Corpus:
    """`frames` (F, 140): features of all clips, one after another; clip i is `frames[starts[i]:starts[i + 1]]`.

    `contents` and `styles` name each clip; `held_out` (N,) says which are kept out of training; `offsets` (22, 3) is
    the skeleton's.
    """

    frames: NDArray[np.float16]
    starts: NDArray[np.int64]
    contents: tuple[str, ...]
    styles: tuple[str, ...]
    held_out: NDArray[np.bool_]
    offsets: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.contents)

    def clip(self, i: int, mirrored: bool = False) -> NDArray[np.float32]:
        """Features (T, 140) of clip i, or of its mirror image."""
        frames = self.frames[self.starts[i] : self.starts[i + 1]].astype(np.float32)
        return mirror(frames) if mirrored else frames

    def content(self, i: int, mirrored: bool = False) -> str:
        """Name of what clip i, or its mirror image, shows."""
        return swap_sides(self.contents[i]) if mirrored else self.contents[i]


def build(folder: Path) -> Corpus:
    """Read every `dataset-N_content_style_NNN.bvh` under `folder`; raises ValueError where there is none."""
    files = sorted(folder.rglob("dataset-[12]_*_*_*.bvh"), key=lambda p: p.name)
    if not files:
        raise ValueError(f"no dataset-1_… or dataset-2_… .bvh files under {folder}")
    clips, contents, styles = [], [], []
    offsets = np.zeros(0)
    for path in track(files, "reading clips"):
        name = re.fullmatch(r"dataset-\d_(.+)_(.+)_\d+", path.stem)
        if name is None or name[1] not in CONTENTS:
            raise ValueError(f"{path.name}: unknown content; known are {', '.join(CONTENTS)}")
        motion = read_bvh(path)
        clips.append(motion_to_features(motion).astype(np.float16))
        contents.append(name[1])
        styles.append(style_name(name[2]))
        offsets = motion.skeleton.offsets
    starts = np.concatenate([[0], np.cumsum([len(c) for c in clips])])
    held_out = _split([p.stem for p in files], contents)
    return Corpus(np.concatenate(clips), starts, tuple(contents), tuple(styles), held_out, offsets)


def _split(names: list[str], contents: list[str]) -> NDArray[np.bool_]:
    """Of each content's clips, in the order of their names' hashes, the first eighth."""
    held_out = np.zeros(len(names), bool)
    for content in set(contents):
        rows = [i for i, c in enumerate(contents) if c == content]
        rows.sort(key=lambda i: hashlib.sha256(names[i].encode()).digest())
        count = max(2, len(rows) // HELD_OUT) if len(rows) >= HELD_OUT else 0
        held_out[rows[:count]] = True
    return held_out


def save(corpus: Corpus, path: Path) -> None:
    """Write the corpus as one uncompressed .npz."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(
        path,
        frames=corpus.frames,
        starts=corpus.starts,
        contents=np.array([list(CONTENTS).index(c) for c in corpus.contents], np.int16),
        styles=np.array([list(STYLES).index(s) for s in corpus.styles], np.int16),
        held_out=corpus.held_out,
        offsets=corpus.offsets,
    )


def load(path: Path) -> Corpus:
    """Read a corpus; raises ValueError where the file is another kind, OSError where it is not there."""
    with np.load(path, allow_pickle=False) as file:
        if "frames" not in file or file["frames"].shape[1:] != (WIDTH,):
            raise ValueError(
                f"{path}: not a corpus of {WIDTH}-wide features; build one with python -m motiongen.corpus"
            )
        contents = tuple(list(CONTENTS)[c] for c in file["contents"])
        styles = tuple(list(STYLES)[s] for s in file["styles"])
        return Corpus(file["frames"], file["starts"], contents, styles, file["held_out"], file["offsets"])


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python -m motiongen.corpus FOLDER OUT.npz")
    made = build(Path(sys.argv[1]).expanduser())
    save(made, Path(sys.argv[2]))
    hours = len(made.frames) / 30 / 3600
    print(f"{len(made)} clips, {hours:.2f} h, {int(made.held_out.sum())} held out")
