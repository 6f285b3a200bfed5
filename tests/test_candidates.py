"""Of several motions the one is kept that measures right."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from motiongen.candidates import MOST, choose
from motiongen.generator import Familiarity, PromptError
from motiongen.gestures.catalogue import perform
from motiongen.measure.clip import observe
from motiongen.motion import Motion


@dataclass
class Waver:
    """Waves as often as the seed says, whatever the text; one after another, or all in one batch."""

    name: str = "waver"
    licence: str = "CC0"
    seeds: list[int] = field(default_factory=list)

    def familiarity(self, text: str) -> Familiarity:
        return Familiarity("wave" in text, 1.0, ("wave",))

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        self.seeds.append(seed)
        return perform("wave", side="left", count=seed)


class BatchWaver(Waver):
    def generate_batch(
        self, texts: list[str], *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> list[Motion]:
        return [self.generate(text, seed=seed + i) for i, text in enumerate(texts)]


@pytest.mark.parametrize("generator", [Waver(), BatchWaver()], ids=["one by one", "batch"])
def test_the_candidate_that_measures_right_is_kept(generator: Waver) -> None:
    generator.seeds.clear()
    kept = choose(generator, "wave three times with the left hand", candidates=4, seed=1)
    assert (kept.index, kept.drawn, kept.right) == (2, 4, True)
    assert observe(kept.motion).totals.left_waves == 3
    assert generator.seeds == [1, 2, 3, 4]
    assert str(kept) == "kept 3 of 4: waves three times (left)"


def test_nothing_more_is_drawn_than_is_needed() -> None:
    generator = Waver()
    assert choose(generator, "wave twice with the left hand", candidates=8, seed=2).drawn == 1
    assert choose(generator, "dance to music", candidates=8, seed=1).drawn == 1
    assert choose(generator, "wave five times with the left hand", candidates=1, seed=1).drawn == 1
    assert generator.seeds == [2, 1, 1]


def test_where_none_is_right_the_nearest_is_kept() -> None:
    kept = choose(Waver(), "wave five times with the left hand", candidates=3, seed=1)
    assert (kept.index, kept.right) == (2, False)
    assert str(kept) == "kept 3 of 3, which comes nearest to: waves five times (left)"


@pytest.mark.parametrize("count", [0, -1, MOST + 1])
def test_a_number_of_candidates_that_makes_no_sense_is_refused(count: int) -> None:
    with pytest.raises(PromptError, match=str(count)):
        choose(Waver(), "wave", candidates=count)
