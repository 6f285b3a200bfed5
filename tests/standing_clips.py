"""A data set in memory whose clips are told apart by how long they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from motions import stand

from motiongen.data.dataset import Dataset, Entry, Head
from motiongen.features import motion_to_features

SHORTEST = 40  # frames of clip 0; each has one more than the one before


def dataset(folder: Path, tested: int = 70, trained: int = 0, contents: tuple[str, ...] = ("bow", "nod")) -> Dataset:
    """`trained` training and `tested` held-out clips of somebody standing, called `contents` in turn."""
    rows = motion_to_features(stand(12.0)).astype(np.float16)
    body = stand().skeleton
    offsets = tuple((float(x), float(y), float(z)) for x, y, z in body.offsets)
    entries = []
    for i in range(trained + tested):
        frames, split = SHORTEST + i, "train" if i < trained else "test"
        said = (f"dwells for {frames} frames",)
        content = contents[i % len(contents)]
        entries.append(
            Entry(
                f"clip-{i}",
                "folder",
                "",
                "none",
                split,
                0,
                frames,
                said,
                said,
                content,
                f"style {i}",
                offsets,
                body.foot_height,
            )
        )
    mean = tuple(map(float, rows.mean(0, dtype=float)))
    head = Head(1, (), len(entries), finished=True, mean=mean, std=(1.0,) * rows.shape[1])
    return Dataset(folder, head, tuple(entries), (), (0,) * len(entries), (rows,))
