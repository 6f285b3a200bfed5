"""What a denoiser is told: a text, an action of the training data, or nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from motiongen.nn import Floats

Encoder = Callable[[list[str]], tuple[Floats, NDArray[np.bool_], Floats]]

TEXT_WIDTH = 384


@dataclass(frozen=True)
class Said:
    """B conditions: `words` (B, N, 384), `word_mask` (B, N) and `sentence` (B, 384) of texts; where `keep` (B,) is
    false, nothing is said. Where there is an `action` (B,), it stands for the text."""

    words: Floats
    word_mask: NDArray[np.bool_]
    sentence: Floats
    keep: NDArray[np.bool_]
    action: NDArray[np.int_] | None = None


def texts(encoder: Encoder, said: Sequence[str]) -> Said:
    """A text for each."""
    words, mask, sentence = encoder(list(said))
    return Said(words, mask, sentence, np.ones(len(said), bool))


def action(index: int, count: int = 1) -> Said:
    """The same action `count` times."""
    return replace(nothing(count), keep=np.ones(count, bool), action=np.full(count, index))


def nothing(count: int = 1) -> Said:
    """Nothing, `count` times."""
    words, mask = np.zeros((count, 1, TEXT_WIDTH), np.float32), np.ones((count, 1), bool)
    return Said(words, mask, words[:, 0], np.zeros(count, bool))


def with_nothing(said: Said) -> Said:
    """`said`, and after it as many times nothing: what both passes of guidance are told, in one batch."""
    words, mask, sentence = (np.concatenate([y, y]) for y in (said.words, said.word_mask, said.sentence))
    act = None if said.action is None else np.concatenate([said.action, said.action])
    return Said(words, mask, sentence, np.concatenate([said.keep, np.zeros_like(said.keep)]), act)
