"""The ceiling of the language tests: held-out clips of a data set, asked for what their own captions say."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from motiongen.data.dataset import Dataset
from motiongen.evaluation.language.discriminants import STYLED
from motiongen.evaluation.language.prompts import RARE, STYLES, Prompt, family
from motiongen.motion import Motion
from motiongen.text.asking import asked_of
from motiongen.text.claims import Asked


def real_prompts(dataset: Dataset, each: int, seed: int = 0) -> tuple[tuple[Prompt, ...], list[Motion]]:
    """Up to `each` prompts of every category that captions speak of, and the held-out clip, or its mirror image, that
    has the caption."""
    rng = np.random.default_rng(seed)
    by_category: dict[str, list[tuple[Prompt, int, bool]]] = defaultdict(list)
    held_out = [i for i, entry in enumerate(dataset.entries) if entry.split == "test"]
    for i in rng.permutation(held_out):
        mirrored = bool(rng.random() < 0.5)
        for prompt in _of_clip(dataset, int(i), mirrored, rng):
            by_category[prompt.category].append((prompt, int(i), mirrored))
    chosen = [case for name in sorted(by_category) for case in by_category[name][:each]]
    return tuple(prompt for prompt, *_ in chosen), [dataset.motion(i, mirrored) for _, i, mirrored in chosen]


def _of_clip(dataset: Dataset, i: int, mirrored: bool, rng: np.random.Generator) -> list[Prompt]:
    entry = dataset.entries[i]
    said = dataset.captions(i, mirrored)
    if not said or entry.content in RARE:
        return []
    text = said[int(rng.integers(len(said)))]
    out = []
    if entry.content:
        where = "motion capture" if entry.style else "gestures"
        out.append(Prompt(text, f"content: {where}", content=family(entry.content)))
    if entry.style in STYLES and family(entry.content) in STYLED:
        out.append(Prompt(text, "style", content=family(entry.content), style=entry.style))
    asked = asked_of(text)
    if asked is not None:
        out.append(Prompt(text, _category(asked), asked))
    return out


def _category(asked: Asked) -> str:
    if len(asked.claims) > 1:
        return {"then": "sequences", "while": "two at once", "any": "two things"}[asked.order]
    claim = asked.claims[0]
    for name, said in (("counts", claim.count), ("degrees", claim.degrees), ("speed", claim.pace)):
        if said:
            return name
    return "left and right" if claim.side else "action"
