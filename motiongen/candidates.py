"""Draw several motions for a text and keep the one that measures right.

Counts, sides and degrees can be measured in the motion itself, so a generator that gets them right sometimes gets them
right more often when the best of a few is kept. One is drawn first. Where it does all that was asked, or where nothing
that was asked can be measured, it is kept and no other is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from motiongen.generator import Generator, PromptError
from motiongen.measure.clip import observe
from motiongen.motion import Motion
from motiongen.text.asking import asked_of
from motiongen.text.claims import describe, holds, shortfall

MOST = 64
DEFAULT_CANDIDATES = 4  # each costs as much as the first, and is drawn only where the first is wrong
SKATE_STEP = 0.05  # share of foot skate within which two candidates slide alike


@runtime_checkable
class BatchGenerator(Protocol):
    """A generator that draws several motions together, text i from `seed` + i or `seed[i]`: cheaper than in turn."""

    def generate_batch(
        self,
        texts: list[str],
        *,
        seconds: float | None = None,
        seed: int | Sequence[int] = 0,
        guidance: float | None = None,
    ) -> list[Motion]: ...


@dataclass(frozen=True)
class Choice:
    """The motion that was kept: candidate `index` of `drawn`, counted from 0. `right`: whether it does all of `asked`,
    which is in words, empty where nothing could be measured."""

    motion: Motion
    index: int
    drawn: int
    asked: str
    right: bool

    def __str__(self) -> str:
        kept = f"kept {self.index + 1} of {self.drawn}"
        return f"{kept}: {self.asked}" if self.right else f"{kept}, which comes nearest to: {self.asked}"


def choose(
    generator: Generator,
    text: str,
    *,
    candidates: int,
    seconds: float | None = None,
    seed: int = 0,
    guidance: float | None = None,
) -> Choice:
    """The first candidate where it does what `text` asks for, else the one of all that falls least short of it; of
    equals the one whose feet slide less, then the first.

    Candidate i is drawn from `seed` + i, so with one candidate it is `generator.generate`. Raises PromptError for a
    number of candidates out of 1 … 64, and what the generator raises.
    """
    if not 1 <= candidates <= MOST:
        raise PromptError(f"{candidates} candidates; 1 to {MOST} are possible")
    first = generator.generate(text, seconds=seconds, seed=seed, guidance=guidance)
    return choose_from(first, generator, text, candidates=candidates, seconds=seconds, seed=seed, guidance=guidance)


def choose_from(
    first: Motion,
    generator: Generator,
    text: str,
    *,
    candidates: int,
    seconds: float | None = None,
    seed: int = 0,
    guidance: float | None = None,
) -> Choice:
    """`choose` where candidate 0 has been drawn already."""
    asked = asked_of(text)
    if asked is None or candidates == 1:
        return Choice(first, 0, 1, "", True)
    if holds(asked, observe(first)):
        return Choice(first, 0, 1, describe(asked), True)
    motions = [first, *_drawn(generator, text, candidates - 1, seconds, seed + 1, guidance)]
    seen = [observe(motion) for motion in motions]
    short = [shortfall(asked, each) for each in seen]
    skate = [round(each.skate / SKATE_STEP) for each in seen]
    best = min(range(candidates), key=lambda i: (short[i], skate[i], i))
    return Choice(motions[best], best, candidates, describe(asked), short[best] == 0.0)


def _drawn(
    generator: Generator, text: str, count: int, seconds: float | None, seed: int, guidance: float | None
) -> list[Motion]:
    if isinstance(generator, BatchGenerator):
        return generator.generate_batch([text] * count, seconds=seconds, seed=seed, guidance=guidance)
    return [generator.generate(text, seconds=seconds, seed=seed + i, guidance=guidance) for i in range(count)]
