"""The benchmark's tables: every metric as computed independently, and targets as worked by hand."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from motiongen.evaluation.run.results import VERSION, Figure, Items, Results, Subject

sys.path.insert(0, str(Path(__file__).parent.parent / "benchmarks"))
from evaluation import independent, targets
from lines import Line


def subject(name: str, together: float, in_order: float, figures: tuple[Figure, ...] = ()) -> Subject:
    """A subject with two at once right in `together` of 100 prompts, and sequences in `in_order` of 300."""
    combined = (
        Figure("language", "two at once", together, 0, 1, 100),
        Figure("language", "sequences", in_order, 0, 1, 300),
    )
    degrees = Items("language", "degrees", "texts", (1.0, 0.0, 1.0, 1.0), True)
    return Subject(name, "", "", 1, 0, (*combined, *figures), (degrees,))


def by_name(lines: list[Line]) -> dict[str, Line]:
    return {line.name: line for line in lines}


def test_every_metric_agrees_with_the_second_computation() -> None:
    lines = independent()
    assert len(lines) == 10
    assert [line.name for line in lines if not line.holds] == []


def test_targets_are_read_from_results() -> None:
    figures = (
        Figure("language", "in scope: not warned", 0.93, 0, 1, 200),
        Figure("language", "counts", 0.7, 0, 1, 200),
    )
    model, rival = subject("mdm", 0.6, 0.8, figures), subject("retrieval", 0.1, 0.7)
    texts = {"texts": ("bow by thirty degrees", "turn left ninety degrees", "turn right", "raise the left arm")}
    results = Results(VERSION, "", "", "", "", {}, 0, {}, texts, (model, rival))
    found = by_name(targets(results, "mdm"))
    assert found["turns within 20 degrees"].found == 0.5
    assert found["warned for nothing"].found == pytest.approx(0.07)
    assert not found["warned for nothing"].holds
    assert found["counts, exact"].holds
    # (0.6 · 100 + 0.8 · 300) / 400 − (0.1 · 100 + 0.7 · 300) / 400 = 0.75 − 0.55
    assert found["combinations never trained on, over retrieval"].found == pytest.approx(0.2)
    assert found["left and right"].found is None
    assert not found["left and right"].holds
