"""Does an evaluator tell what it must? Real clips near the ceiling, shuffled captions at chance, noise far off.

python -m motiongen.evaluation.judges.sanity my-data runs/judge/judge.safetensors
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from motiongen.data.dataset import Dataset, open_dataset
from motiongen.evaluation.judges.batches import clip_label
from motiongen.evaluation.judges.judge import load_judge
from motiongen.evaluation.protocol import Clips, Embedded, Evaluator, Scores, embed, score, table
from motiongen.features import FPS, WIDTH, features_to_motion
from motiongen.motion import Motion
from motiongen.smpl import SMPL_SKELETON


def held_out(data: Dataset, split: str = "test", seed: int = 0) -> Clips:
    """The clips of a split, each with one of its captions, drawn by `seed`; labels are content and style, where known.

    Raises ValueError where the split has no clip.
    """
    rows = [i for i, e in enumerate(data.entries) if e.split == split]
    if not rows:
        raise ValueError(f"{data.folder}: no clip in split {split!r}")
    rng = np.random.default_rng(seed)
    captions = [str(rng.choice(data.captions(i))) for i in rows]
    labels = [clip_label(data.entries[i]) or caption for i, caption in zip(rows, captions, strict=True)]
    return Clips(tuple(data.motion(i) for i in rows), tuple(captions), tuple(labels))


def noise(motions: Sequence[Motion], seed: int = 0) -> list[Motion]:
    """Motions as long as these, on the standard body, of independent random numbers in every frame."""
    rng = np.random.default_rng(seed)
    drawn = [rng.normal(size=(max(2, round(m.duration * FPS) + 1), WIDTH)) for m in motions]
    return [features_to_motion(x, SMPL_SKELETON) for x in drawn]


def sanity(evaluator: Evaluator, clips: Clips, seed: int = 0) -> dict[str, Scores]:
    """Scores, against half of `clips`, of the other half: as it is, with captions shuffled, and noise in its place.

    Halves, since clips against themselves would have an FID of 0 from any evaluator. Raises ValueError as `score`.
    """
    order = np.random.default_rng(seed).permutation(len(clips.captions))
    there, other = (_some(embed(evaluator, clips), rows) for rows in (order[::2], order[1::2]))
    shuffled = np.random.default_rng(seed).permutation(len(other.labels))
    still = evaluator.embed_motions(noise([clips.motions[i] for i in order[1::2]], seed))
    sets = {
        "real": other,
        "captions shuffled": replace(other, motion=other.motion[shuffled]),
        "noise": replace(other, motion=still),
    }
    return {name: score(evaluator.name, there, [made], seed=seed) for name, made in sets.items()}


def _some(embedded: Embedded, rows: np.ndarray) -> Embedded:
    return Embedded(embedded.text[rows], embedded.motion[rows], tuple(embedded.labels[i] for i in rows))


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: python -m motiongen.evaluation.judges.sanity DATASET JUDGE.safetensors …")
    tested = held_out(open_dataset(sys.argv[1]))
    for path in sys.argv[2:]:
        judge = load_judge(Path(path))
        print(f"\n{judge.name} ({path}), {len(tested.captions)} clips, in halves\n\n{table(sanity(judge, tested))}")
