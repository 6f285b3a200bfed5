"""Compare two evaluations prompt by prompt: is B better than A, or would chance do as much?

| values | test | source |
|---|---|---|
| right or wrong | exact test of the prompts on which the two differ | McNemar 1947 |
| amounts | bootstrap of the differences, shifted to mean 0 | Efron & Tibshirani 1993, 16.4 |

With many measures some differ by chance: the verdicts take Holm's step-down correction (1979) at 5 % over all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from motiongen.evaluation.run.results import Better, Items, Results, ResultsError, Subject, read_results

RESAMPLES = 10_000
LEVEL = 0.05
_AT_ONCE = 500  # resamples


@dataclass(frozen=True)
class Row:
    """One measure over the `n` prompts that both have: means `a` and `b`, `difference` b − a with its 95 % interval
    from `low` to `high`, `p` before correction, and what to think of B: better, worse, different, or ""."""

    group: str
    name: str
    n: int
    a: float
    b: float
    difference: float
    low: float
    high: float
    p: float
    verdict: str = ""


@dataclass(frozen=True)
class Comparison:
    """All measures that both have, and what they come to in a sentence."""

    a: str
    b: str
    rows: tuple[Row, ...]
    sentence: str


def mcnemar(right_a: ArrayLike, right_b: ArrayLike) -> float:
    """Two-sided p of the exact test: of the prompts on which one is right alone, each is as often it as the other.

    Both (N,) of 0 and 1. Raises ValueError where they are not as many.
    """
    a, b = _pair(right_a, right_b)
    only_a, only_b = int(((a == 1) & (b == 0)).sum()), int(((a == 0) & (b == 1)).sum())
    n, few = only_a + only_b, min(only_a, only_b)
    return min(1.0, 2 * sum(comb(n, k) for k in range(few + 1)) / 2**n)


def bootstrap(a: ArrayLike, b: ArrayLike, seed: int = 0) -> tuple[float, float, float]:
    """95 % interval (low, high) of the mean of b − a, and the two-sided p of its being 0; both (N,).

    Percentiles of 10,000 resampled means; p is the share of those, shifted to mean 0, that are as far from it. Raises
    ValueError where a and b are not as many.
    """
    a, b = _pair(a, b)
    off = b - a
    rng = np.random.default_rng(seed)
    means = np.concatenate(
        [off[rng.integers(0, len(off), (_AT_ONCE, len(off)))].mean(1) for _ in range(RESAMPLES // _AT_ONCE)]
    )
    low, high = np.quantile(means, [LEVEL / 2, 1 - LEVEL / 2])
    # A mean of equal numbers is off by rounding; that is no reason to count a resample as nearer to 0.
    as_far = np.abs(means - off.mean()) >= abs(off.mean()) - 1e-12
    return float(low), float(high), float((1 + as_far.sum()) / (1 + RESAMPLES))


def holm(p: Sequence[float], level: float = LEVEL) -> list[bool]:
    """Which of some p-values stand, so that with `level` chance at most one does that should not (Holm 1979)."""
    stands = [False] * len(p)
    for rank, i in enumerate(sorted(range(len(p)), key=lambda i: p[i])):
        if p[i] > level / (len(p) - rank):
            break
        stands[i] = True
    return stands


def compare_files(a: str, b: str) -> Comparison:
    """Compare two results: each the path of a results.json or its folder, `#SUBJECT` behind it where it holds several.

    Raises ResultsError for a file or subject that is not there, and for runs that cannot be compared.
    """
    (one, first), (other, second) = _open(a), _open(b)
    return compare(one, first, other, second)


def compare(one: Results, a: Subject, other: Results, b: Subject) -> Comparison:
    """Compare subject `a` of one run with `b` of another, or of the same.

    Raises ResultsError where they were not asked the same, or were judged by others.
    """
    for what, left, right in (
        ("data set", one.data_digest, other.data_digest),
        ("seed", one.seed, other.seed),
        ("plan", one.plan, other.plan),
        ("judges", one.judges, other.judges),
    ):
        if left != right:
            raise ResultsError(f"the two runs have another {what} ({left} and {right}) and cannot be compared")
    there = {(items.group, items.name): items for items in b.items}
    rows = []
    for items in a.items:
        same = there.get((items.group, items.name))
        if same is not None and same.texts == items.texts and (row := _row(items, same)) is not None:
            rows.append((row, items.better))
    if not rows:
        raise ResultsError(f"{a.name} and {b.name} were asked nothing in common; a folder or real clips have no pairs")
    stands = holm([row.p for row, _ in rows])
    judged = tuple(
        replace(row, verdict=_verdict(row.difference, better)) if sure else row
        for (row, better), sure in zip(rows, stands, strict=True)
    )
    names = (a.name, b.name) if a.name != b.name else (f"{a.name} (A)", f"{b.name} (B)")
    return Comparison(*names, judged, _sentence(*names, judged))


def _open(where: str) -> tuple[Results, Subject]:
    path, _, name = where.partition("#")
    file = Path(path) / "results.json" if Path(path).is_dir() else Path(path)
    if not file.is_file():
        raise ResultsError(f"{file}: no such file; rigcast eval writes one")
    results = read_results(file)
    names = [subject.name for subject in results.subjects]
    if not name and len(names) > 1:
        raise ResultsError(f"{file} holds {', '.join(names)}; say which, as in {path}#{names[0]}")
    if name and name not in names:
        raise ResultsError(f"{file}: no subject {name!r}; it holds {', '.join(names)}")
    return results, results.subjects[names.index(name) if name else 0]


def _row(a: Items, b: Items) -> Row | None:
    pairs = [(x, y) for x, y in zip(a.values, b.values, strict=True) if x is not None and y is not None]
    if not pairs:
        return None
    left, right = (np.array(column, float) for column in zip(*pairs, strict=True))
    low, high, p = bootstrap(left, right)
    if a.share:
        p = mcnemar(left, right)
    means = float(left.mean()), float(right.mean())
    return Row(a.group, a.name, len(pairs), *means, means[1] - means[0], low, high, p)


def _verdict(difference: float, better: Better) -> str:
    if not better:
        return "different"
    return "better" if (difference > 0) == (better == "more") else "worse"


def _sentence(a: str, b: str, rows: Sequence[Row]) -> str:
    said = []
    for verdict in ("better", "worse", "different"):
        names = [f"{row.name} ({row.group})" for row in rows if row.verdict == verdict]
        if names:
            said.append(f"{verdict} in {len(names)} of {len(rows)} measures: {', '.join(names)}")
    if not said:
        return f"{b} does not differ from {a} in any of {len(rows)} measures by more than chance would have it."
    return f"Beyond chance, {b} against {a} is {'; '.join(said)}."


def _pair(a: ArrayLike, b: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    first, second = np.asarray(a, float), np.asarray(b, float)
    if first.ndim != 1 or first.shape != second.shape or not len(first):
        raise ValueError(f"values {first.shape} and {second.shape}; a pair is needed for each prompt")
    return first, second
