"""The published measures of generated motion, on embeddings (N, D) that some evaluator made of motions and texts.

| measure | source |
|---|---|
| R-precision, MM-Dist, Diversity, MultiModality, intervals | Guo et al. 2022, "Generating Diverse … from Text" |
| FID | Heusel et al. 2017, "GANs Trained by a Two Time-Scale Update Rule", Eq. 6 |
| KID | Bińkowski et al. 2018, "Demystifying MMD GANs" |
| precision, recall | Kynkäänniemi et al. 2019, "Improved Precision and Recall Metric", Eq. 1–2 |
| accuracy | Guo et al. 2020, "Action2Motion" |

Every function raises ValueError, in one line, for arrays that are not (N, D), do not match, or hold NaN or infinity.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from motiongen.rotation import Array

BATCH = 32  # clips among which R-precision looks for the right one
PAIRS = 300  # drawn for Diversity
NEIGHBOURS = 3  # the k-th nearest neighbour is the radius of precision and recall


def draw_batches(labels: Sequence[str], rng: np.random.Generator, batch: int = BATCH) -> NDArray[np.int64]:
    """Rows (B, batch) of clips in random order, no two clips of a batch with the same label.

    A clip's label is its caption, or whatever says that two clips are right answers to one text: such clips must not
    be each other's wrong answers. Each clip goes to the first batch without its label; batches that do not fill up
    are dropped, as the published loader drops its last one. With all labels different, this is that loader.

    Raises ValueError where there are fewer than `batch` clips or different labels.
    """
    if len(labels) < batch:
        raise ValueError(f"{len(labels)} clips; R-precision needs at least {batch}")
    if len(set(labels)) < batch:
        often, times = Counter(labels).most_common(1)[0]
        raise ValueError(
            f"{len(set(labels))} different captions in {len(labels)} clips ({times} are {often!r}); R-precision needs "
            f"at least {batch}, since clips with the same caption cannot be each other's wrong answers"
        )
    batches: list[list[int]] = []
    held: list[set[str]] = []
    first_open = 0
    for row in rng.permutation(len(labels)):
        place = first_open
        while place < len(batches) and (len(batches[place]) == batch or labels[row] in held[place]):
            place += 1
        if place == len(batches):
            batches.append([])
            held.append(set())
        batches[place].append(int(row))
        held[place].add(labels[row])
        while first_open < len(batches) and len(batches[first_open]) == batch:
            first_open += 1
    return np.array([rows for rows in batches if len(rows) == batch])


def r_precision(text_emb: ArrayLike, motion_emb: ArrayLike, k: int = 3, batch: int = BATCH) -> Array:
    """Share (k,) of texts whose own motion is among the nearest 1 … k of `batch` motions, by Euclidean distance.

    Row i of the two (N, D) belong together; rows are taken `batch` at a time in the order given (see `draw_batches`).

    Raises ValueError also where N is not one or more whole batches, or k is not from 1 to `batch`.
    """
    text, motion = require_pairs(text_emb, motion_emb)
    if len(text) < batch or len(text) % batch:
        raise ValueError(f"{len(text)} clips are not whole batches of {batch}")
    if not 1 <= k <= batch:
        raise ValueError(f"k must be from 1 to {batch}, not {k}")
    hits = np.zeros(k)
    for start in range(0, len(text), batch):
        distance = distances(text[start : start + batch], motion[start : start + batch])
        nearest = np.argsort(distance, axis=1, kind="stable")[:, :k]
        hits += (nearest == np.arange(batch)[:, None]).sum(0)
    return np.cumsum(hits) / len(text)


def mm_dist(text_emb: ArrayLike, motion_emb: ArrayLike) -> float:
    """Mean Euclidean distance between each text and its own motion, row by row of the two (N, D)."""
    text, motion = require_pairs(text_emb, motion_emb)
    return float(np.linalg.norm(text - motion, axis=1).mean())


def fid(real_emb: ArrayLike, made_emb: ArrayLike) -> float:
    """Fréchet distance |m₁ − m₂|² + tr(C₁ + C₂ − 2 (C₁ C₂)^½) of Gaussians fitted to (N, D) and (M, D).

    Below D clips a covariance has no full rank, and at any number the distance is too large by about D/N: compare
    only figures from equal numbers of clips. Raises ValueError also where either has fewer than 2 rows.
    """
    real, made = _require_two(real_emb, made_emb)
    return frechet(real.mean(0), np.cov(real, rowvar=False), made.mean(0), np.cov(made, rowvar=False))


def frechet(mean_1: ArrayLike, cov_1: ArrayLike, mean_2: ArrayLike, cov_2: ArrayLike) -> float:
    """Squared Fréchet distance of two Gaussians with means (D,) and covariances (D, D).

    tr (C₁ C₂)^½ is the sum of the roots of the eigenvalues of S C₂ S, S the symmetric root of C₁.
    """
    c1, c2 = np.atleast_2d(np.asarray(cov_1, float)), np.atleast_2d(np.asarray(cov_2, float))
    values, vectors = np.linalg.eigh(c1)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    cross = np.sqrt(np.maximum(np.linalg.eigvalsh(root @ c2 @ root), 0.0)).sum()
    apart = np.atleast_1d(np.asarray(mean_1, float) - np.asarray(mean_2, float))
    return float(apart @ apart + np.trace(c1) + np.trace(c2) - 2.0 * cross)


def kid(real_emb: ArrayLike, made_emb: ArrayLike) -> float:
    """Unbiased squared maximum mean discrepancy under the kernel (x·y / D + 1)³; 0 on average where nothing differs.

    Taken once over all clips, where the paper averages over subsets of them: the expectation is the same. Raises
    ValueError also where either of (N, D) and (M, D) has fewer than 2 rows.
    """
    real, made = _require_two(real_emb, made_emb)
    n, m, width = len(real), len(made), real.shape[1]
    rr, mm, rm = ((a @ b.T / width + 1.0) ** 3 for a, b in ((real, real), (made, made), (real, made)))
    within = (rr.sum() - np.trace(rr)) / (n * (n - 1)) + (mm.sum() - np.trace(mm)) / (m * (m - 1))
    return float(within - 2.0 * rm.mean())


def precision_recall(real_emb: ArrayLike, made_emb: ArrayLike, k: int = NEIGHBOURS) -> tuple[float, float]:
    """Share of made clips that lie among the real ones, and of real clips that lie among the made.

    A point lies among others where it is no further from one of them than that one's k-th nearest neighbour. Raises
    ValueError also where either of (N, D) and (M, D) has no more than k rows.
    """
    real, made = _require_two(real_emb, made_emb)
    if k < 1 or min(len(real), len(made)) <= k:
        raise ValueError(
            f"{len(real)} real and {len(made)} made clips; precision and recall need more than k = {k} ≥ 1"
        )
    return _covered(made, real, k), _covered(real, made, k)


def _covered(points: Array, others: Array, k: int) -> float:
    """Share of `points` within the k-nearest-neighbour balls of `others`."""
    radius = np.sort(distances(others, others), axis=1)[:, k]  # column 0 is the point itself
    return float((distances(points, others) <= radius).any(1).mean())


def diversity(emb: ArrayLike, rng: np.random.Generator, pairs: int = PAIRS) -> float:
    """Mean distance between the rows of two draws of `pairs` from (N, D), each draw without putting back.

    The two draws are independent, so that now and then a clip meets itself, as published. Raises ValueError also
    where `pairs` is not from 1 to N.
    """
    points = require_embeddings(emb, "embeddings")
    if not 1 <= pairs <= len(points):
        raise ValueError(f"{pairs} pairs; from {len(points)} clips, Diversity draws 1 to {len(points)}")
    first, second = (rng.choice(len(points), pairs, replace=False) for _ in range(2))
    return float(np.linalg.norm(points[first] - points[second], axis=1).mean())


def multimodality(emb: ArrayLike, rng: np.random.Generator, pairs: int = 10) -> float:
    """Mean distance between two motions of one text: `pairs` drawn from each text's S motions, emb (texts, S, D).

    Published: 100 texts, 30 motions each, 10 pairs; the same places are drawn for all texts. Raises ValueError also
    where `pairs` is not from 1 to S.
    """
    points = np.asarray(emb, float)
    if points.ndim != 3 or 0 in points.shape or not 1 <= pairs <= points.shape[1]:
        raise ValueError(f"embeddings {points.shape}; MultiModality of {pairs} pairs needs (texts, ≥ {pairs} clips, D)")
    require_embeddings(points.reshape(-1, points.shape[2]), "embeddings")
    first, second = (rng.choice(points.shape[1], pairs, replace=False) for _ in range(2))
    return float(np.linalg.norm(points[:, first] - points[:, second], axis=2).mean())


def accuracy(said: Sequence[str], found: Sequence[str]) -> float:
    """Share of clips in which a judge found the action that was asked for; raises ValueError for unequal lengths."""
    if len(said) != len(found) or not said:
        raise ValueError(f"{len(said)} actions asked for, {len(found)} found; they must be as many, and some")
    return float(np.mean([a == b for a, b in zip(said, found, strict=True)]))


def interval(values: ArrayLike) -> tuple[float, float]:
    """Mean, and half the 95 % interval 1.96 σ / √n, of one figure over n replications (σ with n below the line)."""
    values = np.asarray(values, float)
    if values.ndim != 1 or not len(values):
        raise ValueError(f"values {values.shape}; an interval needs one figure for each of one or more replications")
    return float(values.mean()), float(1.96 * values.std() / np.sqrt(len(values)))


def distances(a: Array, b: Array) -> Array:
    """Euclidean distances (N, M) between the rows of (N, D) and (M, D).

    By |a|² + |b|² − 2 a·b; a row's distance from itself may come out as some 1e-7 of its length.
    """
    squared = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2.0 * a @ b.T
    return np.sqrt(np.maximum(squared, 0.0))


def require_embeddings(emb: ArrayLike, what: str) -> Array:
    """`emb` as floats (N, D); raises ValueError that names `what` where it is not that, or not finite."""
    array = np.asarray(emb, float)
    if array.ndim != 2 or 0 in array.shape:
        raise ValueError(f"{what}: shape {array.shape}, expected (clips, width)")
    fine = np.isfinite(array).all(1)
    if not fine.all():
        raise ValueError(f"{what}: row {int(fine.argmin())} holds NaN or infinity")
    return array


def require_pairs(text_emb: ArrayLike, motion_emb: ArrayLike) -> tuple[Array, Array]:
    """The two as floats (N, D); raises ValueError where they are not as many and as wide as each other."""
    text, motion = require_embeddings(text_emb, "texts"), require_embeddings(motion_emb, "motions")
    if text.shape != motion.shape:
        raise ValueError(f"texts {text.shape} and motions {motion.shape} do not match")
    return text, motion


def _require_two(real_emb: ArrayLike, made_emb: ArrayLike) -> tuple[Array, Array]:
    real, made = require_embeddings(real_emb, "real clips"), require_embeddings(made_emb, "made clips")
    if real.shape[1] != made.shape[1]:
        raise ValueError(f"real clips are {real.shape[1]} wide, made clips {made.shape[1]}")
    if min(len(real), len(made)) < 2:
        raise ValueError(f"{len(real)} real and {len(made)} made clips; at least 2 of each are needed")
    return real, made
