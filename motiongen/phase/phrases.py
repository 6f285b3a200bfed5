"""Phrases, motions as codes, made longer, joined and blended in their signals (DiffusionPhase, Sec. 3.4 and 4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.nn import Floats
from motiongen.phase.phases import Layout, Timing, course, signals
from motiongen.phase.segments import SHORTEST

FADE = 12  # steps in which the signals of one phrase go over into those of the next
_LEAST = 3  # steps: a head or a tail that would be shorter is none


@dataclass(frozen=True)
class Phrase:
    """A motion: its `code` (width,), and how many steps from frame to frame its `head`, the `period` of its primary
    segment and its `tail` have; the segment is shown for `loop` steps, once over in as many as the period."""

    code: Floats
    head: int
    period: int
    tail: int
    loop: int

    @property
    def frames(self) -> int:
        """How many it has."""
        return self.head + self.loop + self.tail + 1


def phrase_of(code: Floats, frames: int, layout: Layout) -> Phrase:
    """The phrase of a code that was drawn for so many frames: its timing token says how they are shared out.

    Raises ValueError for fewer than two frames.
    """
    if frames < 2:
        raise ValueError(f"a phrase has two frames or more, not {frames}")
    steps = frames - 1
    shares = np.maximum(code[layout.tokens[-1]].astype(float), 0)
    most = max(0.0, 1 - SHORTEST / steps)  # that may be head and tail
    head, tail = (
        int(n) if n >= _LEAST else 0 for n in np.rint(shares * min(1.0, most / max(shares.sum(), 1e-9)) * steps)
    )
    period = steps - head - tail
    return Phrase(code, head, period, tail, period)


def lasting(phrase: Phrase, frames: int) -> Phrase:
    """Phase repetition: `phrase` with so many frames, its primary segment repeated as often as comes nearest.

    The period changes as far as is needed to end with a whole turn; what then is left over goes to the tail, or, where
    there is none, the last turn is cut off. Raises ValueError where nothing would be left of the segment.
    """
    loop = frames - 1 - phrase.head - phrase.tail
    if loop < SHORTEST:
        raise ValueError(f"{frames} frames; this phrase needs {phrase.frames - phrase.loop + SHORTEST} or more")
    turns = max(1, round(loop / phrase.period))
    period = max(SHORTEST, round(loop / turns))
    rest = loop - period * turns if phrase.tail else 0
    if phrase.tail + rest < 0:
        period, rest = period - 1, rest + turns
    return Phrase(phrase.code, phrase.head, period, phrase.tail + rest, loop - rest)


def whole_turns(phrase: Phrase) -> Phrase:
    """`phrase` with the nearest number of whole turns, so that its primary segment ends as it begins."""
    return replace(phrase, loop=max(1, round(phrase.loop / phrase.period)) * phrase.period)


def phrase_signals(phrase: Phrase, layout: Layout, at: NDArray[Any]) -> Floats:
    """Signals (T, C) of a phrase at its frames `at` (T,), which may lie between two; see `course` for those beyond."""
    head, period, tail, loop = (np.array([n]) for n in (phrase.head, phrase.period, phrase.tail, phrase.loop))
    return signals(phrase.code[None], course(Timing(head, period, tail), at, loop), layout)[0]


def looped_signals(phrase: Phrase, layout: Layout, at: NDArray[Any]) -> Floats:
    """Signals (T, C) of the primary segment alone, going round for ever both ways; `at` (T,) counts from its start."""
    return phrase_signals(replace(phrase, head=0, tail=0), layout, at)


def blended(a: Floats, b: Floats, weight: float | NDArray[np.floating]) -> Floats:
    """Signals (T, C) between those of two phrases: a where the `weight`, one or (T,), is 0, and b where it is 1."""
    w = np.broadcast_to(np.asarray(weight, np.float32), (len(a),))[:, None]
    return np.where(w == 0, a, np.where(w == 1, b, (1 - w) * a + w * b))


def joined_signals(phrases: Sequence[Phrase], layout: Layout, at: NDArray[Any]) -> Floats:
    """Signals (T, C) of phrases one after the other at frames `at` (T,) of the whole.

    The first has its head and the last its tail. Between, one primary segment goes over into the next while both go
    round.
    """
    first, last = phrases[0], phrases[-1]
    if len(phrases) == 1:
        return phrase_signals(first, layout, at)
    ends = np.cumsum([0, *(p.loop for p in phrases)])
    at = at - first.head  # counted from the start of the first segment
    voices = [looped_signals(p, layout, at - start) for p, start in zip(phrases, ends[:-1], strict=True)]
    voices[0] = np.where((at < 0)[:, None], phrase_signals(first, layout, at + first.head), voices[0])
    voices[-1] = np.where((at > ends[-1])[:, None], phrase_signals(last, layout, at - ends[-2] + last.head), voices[-1])
    out = voices[0]
    for end, voice in zip(ends[1:-1], voices[1:], strict=True):
        out = blended(out, voice, np.clip((at - end) / FADE + 0.5, 0, 1))
    return out


def joined_frames(phrases: Sequence[Phrase]) -> int:
    """Frames of phrases one after the other."""
    return phrases[0].head + sum(p.loop for p in phrases) + phrases[-1].tail + 1
