"""Which clips of a batch may be each other's wrong answers, when an evaluator is trained.

Two clips whose captions mean the same must not be pushed apart (TMR, Petrovich et al. 2023, 3.3, filters by sentence
similarity). But sentence encoders hardly hear sides and numbers, and "wave left" is the most telling wrong answer to
"wave right": captions that contradict each other in such a word are never filtered.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

SAME_TEXT = 0.8  # cosine of sentence vectors from which two captions are taken to mean the same

# Words of one row exclude each other; a caption may name more than one, and then contradicts neither.
_EXCLUSIVE = (
    ("left", "right", "both"),
    ("once", "twice|two", "three|thrice", "four", "five", "six", "seven", "eight", "nine", "ten"),
    ("slowly|slow", "quickly|quick|fast"),
    ("forward|forwards|ahead", "back|backward|backwards"),
    ("clockwise", "counterclockwise"),
)
_WORDS = tuple(tuple(re.compile(rf"\b(?:{word})\b") for word in row) for row in _EXCLUSIVE)


def telling(captions: Sequence[str]) -> NDArray[np.int64]:
    """(N, 5): which of the words that exclude each other each caption names, a bit a word."""
    said = [
        [sum(1 << i for i, word in enumerate(row) if word.search(text)) for row in _WORDS]
        for text in (caption.lower() for caption in captions)
    ]
    return np.array(said, np.int64).reshape(len(captions), len(_WORDS))


def may_be_same(
    captions: Sequence[str],
    labels: Sequence[str],
    told: NDArray[np.int64],
    sentences: NDArray[np.floating] | None = None,
) -> NDArray[np.bool_]:
    """(N, N): pairs that are no negatives, each with itself included.

    Those with an equal caption; and, unless they contradict each other, those with an equal label (content and style;
    empty where not known) and those whose unit `sentences` (N, D) are alike. `told` is `telling(captions)`.
    """
    text, label = np.array(captions), np.array(labels)
    alike = (label[:, None] == label) & (label != "")
    if sentences is not None:
        alike |= sentences @ sentences.T >= SAME_TEXT
    a, b = told[:, None], told[None]
    contradict = ((a != 0) & (b != 0) & (a & b == 0)).any(-1)
    return (text[:, None] == text) | (alike & ~contradict)
