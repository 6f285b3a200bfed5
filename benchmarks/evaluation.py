"""Can the evaluation be believed, and does the model hold what is asked of it?

    python benchmarks/evaluation.py [--quick] [--json] [--gate]
    python benchmarks/evaluation.py --data runs/data --evaluators runs/results/evaluators --results runs/results

Three tables: every metric against an independent computation; with `--data` and `--evaluators`, what evaluators say of
real clips, of shuffled captions and of noise; with `--results`, a model's figures against its targets.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
from lines import Line, gate, text
from scipy.linalg import sqrtm

from motiongen.evaluation import metrics
from motiongen.evaluation.run.results import Results, Subject, read_results

CLIPS, QUICK_CLIPS = 400, 128
EXACT = 1e-6
CEILING, CHANCE = (
    0.5,
    0.1,
)  # R-precision, top 3: real clips are above the one, shuffled captions within the other of 3/32


def main() -> int:
    """Print the tables; exit 1 with `--gate` where a target falls short."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a built data set, for the sanity table")
    parser.add_argument("--evaluators", type=Path, help="folder of the evaluators trained on it")
    parser.add_argument("--results", type=Path, help="folder that rigcast eval wrote, for the targets")
    parser.add_argument("--subject", default="mdm", help="whose figures are held against the targets")
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed or was not measured")
    options = parser.parse_args()
    lines = independent()
    if options.data and options.evaluators:
        lines += sane(options.data, options.evaluators, QUICK_CLIPS if options.quick else CLIPS)
    if options.results:
        lines += targets(read_results(options.results / "results.json"), options.subject)
    if options.json:
        print(json.dumps([asdict(line) | {"holds": line.holds} for line in lines], indent=1))
    else:
        print("\n".join(map(text, lines)))
    return gate(lines, options.gate)


def independent() -> list[Line]:
    """Differences between our metrics and closed forms, scipy, or the definitions read aloud in loops."""
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(96, 12)), rng.normal(0.3, 1.4, size=(96, 12))
    variances = rng.uniform(0.5, 2.0, (2, 12))
    means = rng.normal(size=(2, 12))
    closed = ((means[0] - means[1]) ** 2).sum() + ((np.sqrt(variances[0]) - np.sqrt(variances[1])) ** 2).sum()
    frechet = metrics.frechet(means[0], np.diag(variances[0]), means[1], np.diag(variances[1]))
    text, motion = rng.normal(size=(32 * 400, 8)), rng.normal(size=(32 * 400, 8))
    chance = metrics.r_precision(text, motion)
    hand = np.array([[0.0, 0.0], [3.0, 4.0]])
    found = {
        "FID of Gaussians with diagonal covariance, closed form": abs(frechet - closed),
        "FID against scipy's matrix square root": abs(metrics.fid(a, b) - _fid(a, b)),
        "R-precision against sorting in a loop": np.abs(metrics.r_precision(a, b) - _r_precision(a, b)).max(),
        "R-precision of a perfect embedding, from 1": np.abs(metrics.r_precision(a, a) - 1).max(),
        "MM-Dist against a loop": abs(
            metrics.mm_dist(a, b) - np.mean([_apart(x, y) for x, y in zip(a, b, strict=True)])
        ),
        "KID against a loop": abs(metrics.kid(a, b) - _kid(a, b)),
        "precision and recall against loops": np.abs(
            np.subtract(metrics.precision_recall(a, b), _manifold(a, b))
        ).max(),
        # Two clips 5 apart: each draw of two is an order of both, so the mean is 0 or 5, and 2.5 over many draws.
        "diversity of two clips 5 apart, from 0 or 5": min(
            abs(metrics.diversity(hand, np.random.default_rng(1), 2) - x) for x in (0.0, 5.0)
        ),
        "multimodality of three equal motions, from 0": metrics.multimodality(
            np.ones((4, 3, 2)), np.random.default_rng(1), 3
        ),
    }
    lines = [Line("metrics", name, float(off), EXACT, at_least=False) for name, off in found.items()]
    off = float(np.abs(chance - np.arange(1, 4) / 32).max())
    return [*lines, Line("metrics", "R-precision of random embeddings, from k/32", off, 0.006, at_least=False)]


def _apart(x: np.ndarray, y: np.ndarray) -> float:
    return float(sum((p - q) ** 2 for p, q in zip(x, y, strict=True)) ** 0.5)


def _fid(a: np.ndarray, b: np.ndarray) -> float:
    one, two = np.cov(a.T), np.cov(b.T)
    return float(((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(one + two - 2 * sqrtm(one @ two).real))


def _r_precision(texts: np.ndarray, motions: np.ndarray) -> np.ndarray:
    hits = np.zeros(3)
    for i in range(len(texts)):
        group = range(i // 32 * 32, i // 32 * 32 + 32)
        rank = sum(_apart(texts[i], motions[j]) < _apart(texts[i], motions[i]) for j in group)
        hits += [rank < k for k in (1, 2, 3)]
    return hits / len(texts)


def _kid(a: np.ndarray, b: np.ndarray) -> float:
    def kernel(x: np.ndarray, y: np.ndarray) -> float:
        return (float(x @ y) / len(x) + 1) ** 3

    def within(points: np.ndarray) -> float:
        return float(np.mean([kernel(x, y) for i, x in enumerate(points) for j, y in enumerate(points) if i != j]))

    return within(a) + within(b) - 2 * float(np.mean([kernel(x, y) for x in a for y in b]))


def _manifold(real: np.ndarray, made: np.ndarray) -> tuple[float, float]:
    def covered(points: np.ndarray, others: np.ndarray) -> float:
        radius = [sorted(_apart(x, y) for y in others)[3] for x in others]
        return float(np.mean([any(_apart(p, x) <= r for x, r in zip(others, radius, strict=True)) for p in points]))

    return covered(made, real), covered(real, made)


def sane(folder: Path, evaluators: Path, clips: int) -> list[Line]:
    """Whether each evaluator tells real clips, shuffled captions and noise apart."""
    from motiongen.data.dataset import open_dataset
    from motiongen.evaluation.judges.judge import load_judge
    from motiongen.evaluation.judges.sanity import held_out, sanity
    from motiongen.evaluation.protocol import Clips

    held = held_out(open_dataset(folder))
    rows = np.random.default_rng(0).permutation(len(held.captions))[:clips]
    tested = Clips(*(tuple(v[i] for i in rows) for v in (held.motions, held.captions, held.labels)))
    lines = []
    for path in sorted(evaluators.glob("*/judge.safetensors")):
        judge = load_judge(path)
        found = sanity(judge, tested)
        top = {name: scores.r_precision[2].mean for name, scores in found.items()}
        off, noise = abs(top["captions shuffled"] - 3 / 32), found["noise"].fid.mean / found["real"].fid.mean
        lines += [
            Line("sanity", f"{judge.name}: R-precision (top 3) of real clips", top["real"], CEILING, at_least=True),
            Line("sanity", f"{judge.name}: of shuffled captions, from 3/32", off, CHANCE, at_least=False),
            Line("sanity", f"{judge.name}: FID of noise over that of real clips", noise, 10.0, at_least=True),
        ]
    return lines


def targets(results: Results, name: str) -> list[Line]:
    """A model's figures against what is asked of it; raises SystemExit where the results do not have the model."""
    by_name = {subject.name: subject for subject in results.subjects}
    if name not in by_name:
        raise SystemExit(f"no subject {name!r} in the results; there are {', '.join(by_name)}")
    model, retrieval = by_name[name], by_name.get("retrieval")
    false = _value(model, "language", "in scope: not warned")
    new = _combinations(model)
    old = None if retrieval is None else _combinations(retrieval)
    return [
        Line("targets", "content, share of real clips' score", _value(model, "content", OF_REAL), 0.9, at_least=True),
        Line("targets", "left and right", _value(model, "language", "left and right"), 0.99, at_least=True),
        Line("targets", "counts, exact", _value(model, "language", "counts"), 0.7, at_least=True),
        Line("targets", "turns within 20 degrees", _turns(model, results), 0.8, at_least=True),
        Line("targets", "warned, out of scope", _value(model, "language", "out of scope: warned"), 0.9, at_least=True),
        Line("targets", "warned for nothing", None if false is None else 1 - false, 0.05, at_least=False),
        Line(
            "targets",
            "combinations never trained on, over retrieval",
            None if new is None or old is None else new - old,
            0.2,
            at_least=True,
        ),
    ]


OF_REAL = "share of real clips' score"


def _value(subject: Subject, group: str, name: str) -> float | None:
    figure = subject.figure(group, name)
    return None if figure is None else figure.value


def _turns(subject: Subject, results: Results) -> float | None:
    """Of the prompts about degrees, those that ask for a turn."""
    for items in subject.items:
        if (items.group, items.name) == ("language", "degrees"):
            asked = zip(results.texts[items.texts], items.values, strict=True)
            right = [value for said, value in asked if "turn" in said and value is not None]
            return float(np.mean(right)) if right else None
    return None


def _combinations(subject: Subject) -> float | None:
    """The share that is right of two things at once and of sequences, all prompts taken together."""
    found = [f for n in ("two at once", "sequences") if (f := subject.figure("language", n)) is not None]
    return sum(f.value * f.n for f in found) / sum(f.n for f in found) if found else None


if __name__ == "__main__":
    sys.exit(main())
