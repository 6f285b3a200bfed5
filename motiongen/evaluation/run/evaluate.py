"""The whole evaluation: ask every subject for the same things, measure what it shows, and say so with intervals."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime

from motiongen.data.dataset import Dataset
from motiongen.evaluation.metrics import BATCH
from motiongen.evaluation.protocol import embed
from motiongen.evaluation.run.judges import open_judges
from motiongen.evaluation.run.measure import (
    GATE,
    Found,
    Shown,
    content_figures,
    evaluator_figures,
    language_figures,
    motion_figures,
    speed_figure,
)
from motiongen.evaluation.run.results import VERSION, Results, ResultsError, Subject
from motiongen.evaluation.run.sets import Sets, make_sets, require_held_out
from motiongen.evaluation.run.show import Tell, Wish, show
from motiongen.evaluation.subjects import REAL, Opened, data_digest, open_subject
from motiongen.motion import Motion

Gate = Callable[[Sequence[Motion]], tuple[str, int]]  # name of the rig and its mount, and how many motions passed
EXAMPLES = 3  # held-out captions with an example in the report, …
SHOWN = ("counts", "degrees", "two at once", "sequences")  # … and categories of the language tests with one


@dataclass(frozen=True)
class Example:
    """A motion of a subject to look at, and what it was asked for."""

    subject: str
    text: str
    motion: Motion


def evaluate(
    names: Sequence[str], data: Dataset, wish: Wish, tell: Tell, gate: Gate | None = None
) -> tuple[Results, Sets, tuple[Example, ...]]:
    """Evaluate subjects (see `open_subject`) on the held-out clips of a data set; what they were asked for, and some
    examples of each. `gate` puts motions through physics.

    Raises ResultsError for a name given twice or too few clips, and what opening, drawing and judging raise.
    """
    require_held_out(data)
    opened = _open(names, data)
    judges = open_judges(data, wish.judges, wish.plan, lambda what: tell(what, 0, 0))
    sets = make_sets(data, list(judges.real_contents), wish.plan, wish.seed, styles=judges.style is not None)
    references = [embed(evaluator, sets.reference) for evaluator in judges.evaluators]
    texts: dict[str, tuple[str, ...]] = {}
    subjects, examples = [], []
    for subject in opened:
        shown, refused = show(subject, data, sets, wish, judges, tell)
        tell(f"{subject.name}: measuring", 0, 0)
        found = Found()
        for evaluator, reference in zip(judges.evaluators, references, strict=True):
            evaluator_figures(found, evaluator, reference, shown, wish.seed)
        content_figures(found, judges, shown)
        language_figures(found, judges, shown)
        motion_figures(found, shown.clips)
        if gate is not None:
            tell(f"{subject.name}: physics", 0, 0)
            some = shown.clips.motions[: wish.plan.gate]
            rig, passed = gate(some)
            found.share(GATE, f"passes on {rig}", passed, len(some))
        speed_figure(found, shown.pace)
        subjects.append(_subject(subject, wish, refused, found))
        texts |= found.texts
        examples += _examples(subject.name, shown)
    results = Results(
        version=VERSION,
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        machine=f"{platform.machine()} {platform.system()}, {os.cpu_count()} cores",
        data=data.folder.resolve().name,
        data_digest=data_digest(data),
        plan=asdict(wish.plan),
        seed=wish.seed,
        judges=judges.digests,
        texts=texts,
        subjects=tuple(subjects),
    )
    return results, sets, tuple(examples)


def _open(names: Sequence[str], data: Dataset) -> list[Opened]:
    opened: list[Opened] = []
    for name in names:
        subject = open_subject(name, data)
        if subject.name in [other.name for other in opened]:
            raise ResultsError(f"there are two subjects {subject.name!r}; give each a name of its own")
        if subject.clips is not None and len(subject.clips.captions) < BATCH:
            raise ResultsError(f"{name}: {len(subject.clips.captions)} clips; an evaluation needs at least {BATCH}")
        opened.append(subject)
    return opened


def _subject(subject: Opened, wish: Wish, refused: int, found: Found) -> Subject:
    candidates = wish.candidates if subject.generator is not None else 1
    figures, items = tuple(found.figures), tuple(found.items)
    return Subject(subject.name, subject.digest, subject.licence, candidates, refused, figures, items)


def _examples(name: str, shown: Shown) -> list[Example]:
    """The first held-out captions, and the first prompt of some categories; clips are not asked for these."""
    out = [Example(name, c, m) for c, m in zip(shown.clips.captions[:EXAMPLES], shown.clips.motions, strict=False)]
    for category in SHOWN if name != REAL else ():
        there = [(p.text, m) for p, m, _ in shown.language if p.category == category]
        if there and there[0][1] is not None:
            out.append(Example(name, there[0][0], there[0][1]))
    return out
