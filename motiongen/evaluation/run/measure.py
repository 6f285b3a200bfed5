"""From what a subject showed to figures with intervals, and to each prompt's outcome."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from motiongen.evaluation.language.prompts import Prompt
from motiongen.evaluation.language.run import interval as share_interval
from motiongen.evaluation.language.run import verdicts
from motiongen.evaluation.metrics import interval
from motiongen.evaluation.physical import Physical, measure_physics
from motiongen.evaluation.protocol import Clips, Embedded, Evaluator, Score, Scores, score
from motiongen.evaluation.run.judges import Judges
from motiongen.evaluation.run.results import Better, Figure, Items, digest_of
from motiongen.motion import Motion

CONTENT, MOTION, LANGUAGE, GATE, SPEED = "content", "motion", "language", "gate", "speed"
RIGHT, OF_REAL = "right, macro average", "share of real clips' score"
REAL_TIME = "times faster than real time"


@dataclass(frozen=True)
class Shown:
    """What a subject showed. `clips`: for the held-out captions; `repeated`: several for each of some of them.
    `contents`: text, the content asked for, and what came of it, None where the subject refused; `language`: prompts,
    what came of them, and whether the subject took them for known. `pace`: see `Drawn`."""

    clips: Clips
    repeated: tuple[tuple[Motion, ...], ...] = ()
    contents: tuple[tuple[str, str, Motion | None], ...] = ()
    language: tuple[tuple[Prompt, Motion | None, bool], ...] = ()
    pace: tuple[tuple[float, float], ...] = ()
    passes: int | None = None


@dataclass
class Found:
    """Figures and items as they come, and the texts that items are about."""

    figures: list[Figure] = field(default_factory=list)
    items: list[Items] = field(default_factory=list)
    texts: dict[str, tuple[str, ...]] = field(default_factory=dict)

    def share(self, group: str, name: str, right: int, n: int, better: Better = "more") -> None:
        """Add a share with its Wilson interval."""
        self.figures.append(Figure(group, name, right / n, *share_interval(right, n), n, "", better))

    def each(
        self,
        group: str,
        name: str,
        texts: Sequence[str],
        values: Sequence[float | None],
        better: Better,
        *,
        share: bool,
    ) -> None:
        """Add one value a text."""
        digest = digest_of(texts)
        self.texts[digest] = tuple(texts)
        rounded = tuple(None if v is None else float(f"{v:.6g}") for v in values)
        self.items.append(Items(group, name, digest, rounded, share, better))


def evaluator_figures(found: Found, evaluator: Evaluator, reference: Embedded, shown: Shown, seed: int) -> None:
    """The published measures by one evaluator; raises ValueError as `score`, for fewer than 32 clips for one."""
    clips = shown.clips
    made = Embedded(evaluator.embed_texts(clips.captions), evaluator.embed_motions(clips.motions), clips.labels)
    again = None
    if shown.repeated:
        flat = evaluator.embed_motions([motion for motions in shown.repeated for motion in motions])
        again = flat.reshape(len(shown.repeated), -1, flat.shape[1])
    scores = score(evaluator.name, reference, [made], repeated=again, passes=shown.passes, seed=seed)
    group = f"evaluator {evaluator.name}"
    found.figures += [Figure(group, name, *_range(s), scores.clips, "", better) for name, s, better in _named(scores)]
    distance = np.linalg.norm(made.text - made.motion, axis=1)
    found.each(group, "MM-Dist", clips.captions, distance.tolist(), "less", share=False)


def _named(scores: Scores) -> list[tuple[str, Score, Better]]:
    one, two, three = scores.r_precision
    named: list[tuple[str, Score | None, Better]] = [
        ("R-precision, top 1", one, "more"),
        ("R-precision, top 2", two, "more"),
        ("R-precision, top 3", three, "more"),
        ("MM-Dist", scores.mm_dist, "less"),
        ("FID", scores.fid, "less"),
        ("KID", scores.kid, "less"),
        ("precision", scores.precision, "more"),
        ("recall", scores.recall, "more"),
        ("diversity", scores.diversity, ""),
        ("multimodality", scores.multimodality, ""),
    ]
    return [(name, s, better) for name, s, better in named if s is not None]


def _range(s: Score) -> tuple[float, float, float]:
    return s.mean, s.mean - s.interval, s.mean + s.interval


def content_figures(found: Found, judges: Judges, shown: Shown) -> None:
    """How often the classifier finds the content that was asked for: macro average, in relation to held-out real clips,
    and content by content."""
    if not shown.contents:
        return
    there = [motion for *_, motion in shown.contents if motion is not None]
    said = iter(judges.content(there) if there else [])
    right = [motion is not None and next(said) == content for _, content, motion in shown.contents]
    by_content: dict[str, list[bool]] = {}
    for (_, content, _), good in zip(shown.contents, right, strict=True):
        by_content.setdefault(content, []).append(good)
    shares = [(sum(each), len(each)) for each in by_content.values()]
    macro, half = _macro(shares)
    real, _ = _macro([judges.real_contents[content] for content in by_content])
    low, high, n = max(0.0, macro - half), min(1.0, macro + half), len(right)
    found.figures.append(Figure(CONTENT, RIGHT, macro, low, high, n, "", "more"))
    if real > 0:
        found.figures.append(Figure(CONTENT, OF_REAL, macro / real, low / real, high / real, n, "", "more"))
    for content, answers in by_content.items():
        found.share("content by content", content, sum(answers), len(answers))
    texts = [f"{text} [{content}]" for text, content, _ in shown.contents]
    found.each(CONTENT, "right", texts, [float(g) for g in right], "more", share=True)


def _macro(shares: Sequence[tuple[int, int]]) -> tuple[float, float]:
    """Mean of shares (right, of how many), and half its 95 % interval: shares are independent binomials.

    Their variance is taken at (right + 1) / (n + 2), or one right answer of one would count as certain.
    """
    right, n = np.array(shares, float).T
    p = (right + 1) / (n + 2)
    return float((right / n).mean()), float(1.96 * np.sqrt((p * (1 - p) / n).sum()) / len(n))


def language_figures(found: Found, judges: Judges, shown: Shown) -> None:
    """The share of prompts that were done right, by category."""
    if not shown.language:
        return
    asked, motions, known = (list(column) for column in zip(*shown.language, strict=True))
    right = verdicts(asked, motions, known, judges.content, judges.style or judges.content)
    for category in dict.fromkeys(prompt.category for prompt in asked):
        rows = [i for i, prompt in enumerate(asked) if prompt.category == category]
        found.share(LANGUAGE, category, sum(right[i] for i in rows), len(rows))
        texts = [asked[i].text for i in rows]
        found.each(LANGUAGE, category, texts, [float(right[i]) for i in rows], "more", share=True)


_PHYSICAL: tuple[tuple[str, str, str, Better], ...] = (
    ("skate_ratio", "foot skate", "share of contact", "less"),
    ("skate_speed", "speed of low toes", "m/s", "less"),
    ("jerk", "jerk", "m/s³", ""),
    ("penetration", "penetration", "m", "less"),
    ("floating", "floating", "m", "less"),
)


def motion_figures(found: Found, clips: Clips) -> None:
    """How the motions move, whatever they were to show; see `physical`."""
    each: list[Physical] = [measure_physics(motion) for motion in clips.motions]
    for field_name, name, unit, better in _PHYSICAL:
        values: list[float | None] = [getattr(p, field_name) for p in each]
        there = [v for v in values if v is not None]
        if there:
            mean, half = interval(there)
            found.figures.append(Figure(MOTION, name, mean, mean - half, mean + half, len(there), unit, better))
        found.each(MOTION, name, clips.captions, values, better, share=False)
    found.share(MOTION, "broken", sum(bool(p.broken) for p in each), len(each), "less")


def speed_figure(found: Found, pace: Sequence[tuple[float, float]]) -> None:
    """Seconds of motion made in a second of computing, chunk by chunk; nothing where nothing was drawn."""
    ratios = [made / spent for made, spent in pace if made > 0]
    if ratios:
        mean, half = interval(ratios)
        found.figures.append(Figure(SPEED, REAL_TIME, mean, mean - half, mean + half, len(ratios), "×", "more"))
