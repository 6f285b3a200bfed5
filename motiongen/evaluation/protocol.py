"""The published protocol: every measure, over 20 replications, with 95 % intervals (Guo et al. 2022).

An evaluator embeds texts and motions in one space; it is the judge, and judges disagree, so name it with each figure.
Motions come as a list: from a generator, or read from files that another one wrote.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from motiongen.evaluation.metrics import (
    PAIRS,
    accuracy,
    distances,
    diversity,
    draw_batches,
    fid,
    interval,
    kid,
    mm_dist,
    multimodality,
    precision_recall,
    r_precision,
    require_embeddings,
    require_pairs,
)
from motiongen.motion import SMPL_JOINTS, Motion
from motiongen.rotation import Array

REPLICATIONS = 20
MOST_PASSES = 50  # denoising passes a motion: figures from more are not comparable with ours
REPEATED_PAIRS = 10  # MultiModality: pairs for each text


class Evaluator(Protocol):
    """A judge: texts and motions in one space of D dimensions, near where they say the same."""

    @property
    def name(self) -> str:
        """What to call it beside its figures."""
        ...

    def embed_texts(self, texts: Sequence[str]) -> Array:
        """Embeddings (N, D); row i says nothing of the texts beside text i."""
        ...

    def embed_motions(self, motions: Sequence[Motion]) -> Array:
        """Embeddings (N, D); row i says nothing of the motions beside motion i."""
        ...


@dataclass(frozen=True)
class Clips:
    """Motions and what each was to show. `labels` say which clips are right answers to each other's captions; they
    default to the captions, in lower case and without outer space.

    Raises ValueError, in one line, for lists of different lengths, blank captions, and another skeleton than SMPL's.
    """

    motions: tuple[Motion, ...]
    captions: tuple[str, ...]
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        labels = self.labels or tuple(" ".join(c.lower().split()) for c in self.captions)
        counts = (len(self.motions), len(self.captions), len(labels))
        if len(set(counts)) > 1:
            raise ValueError(f"{counts[0]} motions, {counts[1]} captions and {counts[2]} labels; they must be as many")
        for i, (motion, caption) in enumerate(zip(self.motions, self.captions, strict=True)):
            if not caption.strip():
                raise ValueError(f"caption {i} is blank")
            if motion.skeleton.names != SMPL_JOINTS:
                raise ValueError(
                    f"motion {i}, {caption!r}: skeleton of {len(motion.skeleton.names)} joints "
                    f"({motion.skeleton.names[0]}, …), expected the {len(SMPL_JOINTS)} of SMPL"
                )
        object.__setattr__(self, "labels", labels)


@dataclass(frozen=True)
class Embedded:
    """What an evaluator made of clips: `text` and `motion` (N, D), row by row, and the clips' `labels`.

    Raises ValueError where they do not match or are not finite.
    """

    text: Array
    motion: Array
    labels: tuple[str, ...]

    def __post_init__(self) -> None:
        text, motion = require_pairs(self.text, self.motion)
        if len(self.labels) != len(text):
            raise ValueError(f"{len(self.labels)} labels for {len(text)} clips")
        object.__setattr__(self, "text", text)
        object.__setattr__(self, "motion", motion)


@dataclass(frozen=True)
class Score:
    """A figure's mean over the replications, and half of its 95 % interval."""

    mean: float
    interval: float


@dataclass(frozen=True)
class Scores:
    """What one evaluator says of one set of clips, against the real ones.

    `r_precision`: top 1, 2 and 3, shares. `ranked`: clips in whole batches of 32, mean over the replications.
    `diversity_pairs`: 300, or all clips where there are fewer. `multimodality` is None where no text was drawn more
    than once. Higher is better for R-precision, precision and recall; lower for MM-Dist, FID and KID; Diversity is
    best where it equals that of real clips. `passes`: denoising passes a made motion took; None for what is no
    diffusion model, or was not told.
    """

    evaluator: str
    clips: int
    passes: int | None
    replications: int
    draws: int
    ranked: float
    diversity_pairs: int
    r_precision: tuple[Score, Score, Score]
    mm_dist: Score
    fid: Score
    kid: Score
    precision: Score
    recall: Score
    diversity: Score
    multimodality: Score | None


def embed(evaluator: Evaluator, clips: Clips) -> Embedded:
    """`clips` as `evaluator` sees them; raises ValueError where it answers with other shapes, NaN or infinity."""
    return Embedded(evaluator.embed_texts(clips.captions), evaluator.embed_motions(clips.motions), clips.labels)


def evaluate(
    evaluator: Evaluator,
    real: Clips,
    made: Clips | Callable[[int], Clips],
    *,
    repeated: Sequence[Sequence[Motion]] = (),
    passes: int | None = None,
    replications: int = REPLICATIONS,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Scores:
    """Score `made` against `real`: motions at hand, or a function that draws them anew for each replication.

    With motions at hand (files, for instance) the intervals tell how far the protocol's own draws move the figures,
    not how far the generator's would. `repeated`: some motions of each of some texts, equally many, for
    MultiModality. `progress` is told how many replications of how many are drawn. Raises as `Clips`, `embed`, `score`.
    """
    there = embed(evaluator, real)
    if isinstance(made, Clips):
        draws = [embed(evaluator, made)]
    else:
        draws = []
        for number in range(replications):
            draws.append(embed(evaluator, made(number)))
            if progress is not None:
                progress(number + 1, replications)
    again = _embed_repeated(evaluator, repeated) if repeated else None
    return score(evaluator.name, there, draws, repeated=again, passes=passes, replications=replications, seed=seed)


def _embed_repeated(evaluator: Evaluator, repeated: Sequence[Sequence[Motion]]) -> Array:
    """Embeddings (texts, motions, D)."""
    counts = {len(motions) for motions in repeated}
    if len(counts) > 1:
        raise ValueError(f"{min(counts)} to {max(counts)} motions a text; MultiModality needs as many of each")
    flat = evaluator.embed_motions([motion for motions in repeated for motion in motions])
    return require_embeddings(flat, "repeated motions").reshape(len(repeated), counts.pop(), -1)


def score(
    evaluator: str,
    real: Embedded,
    draws: Sequence[Embedded],
    *,
    repeated: Array | None = None,
    passes: int | None = None,
    replications: int = REPLICATIONS,
    seed: int = 0,
) -> Scores:
    """The protocol on embeddings. `draws`: one set of made clips, or one for each replication. `repeated`:
    (texts, motions, D), see `multimodality`.

    R-precision and MM-Dist are over the clips that fill batches of 32 (`draw_batches`), the rest over all clips.
    Raises ValueError for fewer than 32 clips, another number of draws, draws of different sizes, or more than 50
    `passes`.
    """
    if passes is not None and not 1 <= passes <= MOST_PASSES:
        raise ValueError(f"{passes} denoising passes a motion; the protocol takes 1 to {MOST_PASSES}")
    if replications < 1 or len(draws) not in (1, replications):
        raise ValueError(f"{len(draws)} draws for {replications} replications; give one, or one for each")
    if len({len(draw.labels) for draw in draws}) > 1:
        raise ValueError("draws of different numbers of clips cannot be one result: FID depends on it")
    pairs = min(PAIRS, len(draws[0].labels))
    # What has no draw of its own is computed once a set of clips, not once a replication.
    fixed = [(fid(real.motion, d.motion), kid(real.motion, d.motion), *_pr(real, d)) for d in draws]
    rows = []
    for number in range(replications):
        rng = np.random.default_rng([seed, number])
        draw = draws[number % len(draws)]
        at = draw_batches(draw.labels, rng).ravel()
        text, motion = draw.text[at], draw.motion[at]
        row = [len(at), *r_precision(text, motion), mm_dist(text, motion), *fixed[number % len(draws)]]
        row.append(diversity(draw.motion, rng, pairs))
        if repeated is not None:
            row.append(multimodality(repeated, rng, REPEATED_PAIRS))
        rows.append(row)
    ranked, *found = (Score(*interval(column)) for column in np.array(rows).T)
    return Scores(
        evaluator=evaluator,
        clips=len(draws[0].labels),
        passes=passes,
        replications=replications,
        draws=len(draws),
        ranked=ranked.mean,
        diversity_pairs=pairs,
        r_precision=(found[0], found[1], found[2]),
        mm_dist=found[3],
        fid=found[4],
        kid=found[5],
        precision=found[6],
        recall=found[7],
        diversity=found[8],
        multimodality=found[9] if repeated is not None else None,
    )


def _pr(real: Embedded, made: Embedded) -> tuple[float, float]:
    return precision_recall(real.motion, made.motion)


@dataclass(frozen=True)
class ActionScores:
    """Of motions made for named actions (Guo et al. 2020): `accuracy` of the judge's guess, and the rest as above;
    `multimodality` within each action."""

    accuracy: float
    fid: float
    diversity: Score
    multimodality: Score


def score_actions(
    real: Array,
    made: Array,
    said: Sequence[str],
    actions: dict[str, Array],
    *,
    replications: int = REPLICATIONS,
    seed: int = 0,
) -> ActionScores:
    """Measures of `made` (N, D) for the actions `said` (N) against `real` (M, D).

    The judge's guess is the action of `actions` (name → embedding (D,) of its text) that is nearest. Every action is
    asked for equally often, S times. Raises ValueError where it is not, or for an action that is not in `actions`.
    """
    made = require_embeddings(made, "made clips")
    if unknown := sorted(set(said) - set(actions)):
        raise ValueError(f"no embedding of action {unknown[0]!r}; there are {', '.join(sorted(actions))}")
    names = sorted(actions)
    nearest = distances(made, np.stack([actions[n] for n in names])).argmin(1)
    share = accuracy(said, [names[i] for i in nearest])
    rows = [np.flatnonzero(np.array(said) == name) for name in sorted(set(said))]
    if len({len(r) for r in rows}) > 1:
        raise ValueError("every action must be asked for equally often")
    grouped = made[np.stack(rows)]
    pairs, within = min(PAIRS, len(made)), min(REPEATED_PAIRS, grouped.shape[1])
    spread, inner = [], []
    for number in range(replications):
        rng = np.random.default_rng([seed, number])
        spread.append(diversity(made, rng, pairs))
        inner.append(multimodality(grouped, rng, within))
    return ActionScores(share, fid(real, made), Score(*interval(spread)), Score(*interval(inner)))


def table(scores: dict[str, Scores]) -> str:
    """A Markdown table of several sets of clips by name, means with ± half the 95 % interval."""
    heads = ["clips", "R@1", "R@2", "R@3", "MM-Dist", "FID", "KID", "precision", "recall", "diversity"]
    lines = ["| " + " | ".join(heads) + " |", "|" + " --- |" * len(heads)]
    for name, s in scores.items():
        figures = (*s.r_precision, s.mm_dist, s.fid, s.kid, s.precision, s.recall, s.diversity)
        lines.append("| " + " | ".join([name, *(f"{x.mean:.3f} ± {x.interval:.3f}" for x in figures)]) + " |")
    return "\n".join(lines)
