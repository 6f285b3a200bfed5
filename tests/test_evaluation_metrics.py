"""The measures against closed forms, hand-worked numbers and a plain second reading of the published protocol."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from motiongen.evaluation.metrics import (
    accuracy,
    diversity,
    draw_batches,
    fid,
    frechet,
    interval,
    kid,
    mm_dist,
    multimodality,
    precision_recall,
    r_precision,
)


def normal(*shape: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=shape)


def with_moments(x: np.ndarray, mean: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """`x` moved so that its sample mean and covariance are exactly these."""
    white = (x - x.mean(0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(x, rowvar=False))).T
    return white @ np.linalg.cholesky(cov).T + mean


def test_fid_of_gaussians_that_commute_is_a_sum_over_axes() -> None:
    s1, s2, apart = np.array([1.0, 4.0, 0.25]), np.array([9.0, 1.0, 0.25]), np.array([1.0, -2.0, 0.5])
    known = (apart**2).sum() + ((np.sqrt(s1) - np.sqrt(s2)) ** 2).sum()
    turn = np.linalg.qr(normal(3, 3))[0]
    c1, c2 = turn * s1 @ turn.T, turn * s2 @ turn.T
    assert frechet(np.zeros(3), c1, apart, c2) == pytest.approx(known, abs=1e-9)
    real, made = with_moments(normal(50, 3), np.zeros(3), c1), with_moments(normal(80, 3, seed=1), apart, c2)
    assert fid(real, made) == pytest.approx(known, abs=1e-9)


def test_fid_equals_scipys_matrix_root_where_covariances_do_not_commute() -> None:
    a, b = normal(200, 8) @ normal(8, 8, seed=2), normal(300, 8, seed=1) @ normal(8, 8, seed=3) + 1
    ca, cb = np.cov(a, rowvar=False), np.cov(b, rowvar=False)
    cross = scipy.linalg.sqrtm(ca @ cb).real
    known = ((a.mean(0) - b.mean(0)) ** 2).sum() + np.trace(ca + cb - 2 * cross)
    assert fid(a, b) == pytest.approx(known, rel=1e-9)
    assert fid(a, a) == pytest.approx(0, abs=1e-6)


def test_fid_of_fewer_clips_than_dimensions_is_finite() -> None:
    a = normal(20, 64)
    assert fid(a, a + 2.0) == pytest.approx(64 * 4.0, rel=1e-6)


def test_kid_is_the_double_sum_and_nothing_on_average() -> None:
    x, y = normal(6, 4), normal(5, 4, seed=1) + 0.5

    def k(a: np.ndarray, b: np.ndarray) -> float:
        return float((a @ b / 4 + 1) ** 3)

    xx = np.mean([k(x[i], x[j]) for i in range(6) for j in range(6) if i != j])
    yy = np.mean([k(y[i], y[j]) for i in range(5) for j in range(5) if i != j])
    xy = np.mean([k(a, b) for a in x for b in y])
    assert kid(x, y) == pytest.approx(xx + yy - 2 * xy, rel=1e-12)
    drawn = [kid(normal(40, 3, seed=2 * s), normal(40, 3, seed=2 * s + 1)) for s in range(200)]
    mean, half = interval(drawn)
    assert abs(mean) < 2 * half


def test_precision_and_recall_of_points_on_a_line() -> None:
    real = np.arange(10.0)[:, None]  # third neighbours lie 2 or, at the ends, 3 away
    made = np.array([0.5, 4.0, 9.5, 30.0, 31.0, 32.0, 33.0])[:, None]
    precision, recall = precision_recall(real, made)
    assert precision == pytest.approx(3 / 7)
    assert recall == 1.0  # balls of made points reach some 25 to the left
    assert precision_recall(real, real + 100.0) == (0.0, 0.0)
    assert precision_recall(real, real) == (1.0, 1.0)


def test_r_precision_of_random_embeddings_is_chance() -> None:
    text, motion = normal(32 * 200, 8), normal(32 * 200, 8, seed=1)
    found = r_precision(text, motion, k=5)
    chance = np.arange(1, 6) / 32
    assert np.all(np.abs(found - chance) < 4 * np.sqrt(chance * (1 - chance) / len(text)))


def test_r_precision_of_perfect_embeddings_is_one_and_of_known_ranks_known() -> None:
    x = normal(64, 16)
    assert r_precision(x, x).tolist() == [1, 1, 1]
    line = np.arange(32.0)[:, None]
    moved = line + 0.6  # nearest to i is the motion of i - 1 (at i - 0.4); only text 0 has its own nearest
    assert r_precision(line, moved) == pytest.approx([1 / 32, 1, 1])


def test_r_precision_compares_within_batches_alone() -> None:
    x = normal(32, 4)
    twice = np.concatenate([x, x])  # across batches every clip has a double
    assert r_precision(twice, twice)[0] == 1


def test_mm_dist_by_hand() -> None:
    assert mm_dist([[0, 0], [1, 1]], [[3, 4], [1, 2]]) == pytest.approx((5 + 1) / 2)


class Fixed(np.random.Generator):
    """Draws what it is told."""

    def __init__(self, *draws: list[int]) -> None:
        super().__init__(np.random.PCG64(0))
        self._draws = list(draws)

    def choice(self, a, size=None, replace=True, p=None, axis=0, shuffle=True):
        assert not replace
        drawn = self._draws.pop(0)
        assert len(drawn) == size
        assert max(drawn) < a
        return np.array(drawn)


def test_diversity_by_hand() -> None:
    points = np.array([[0.0, 0], [3, 4], [0, 1], [6, 8]])
    assert diversity(points, Fixed([0, 1, 2], [1, 3, 2]), pairs=3) == pytest.approx((5 + 5 + 0) / 3)


def test_multimodality_by_hand() -> None:
    points = np.array([[[0.0], [1], [4]], [[10], [10], [13]]])
    assert multimodality(points, Fixed([0, 1], [2, 0]), pairs=2) == pytest.approx((4 + 1 + 3 + 0) / 4)


def test_interval_by_hand() -> None:
    mean, half = interval([1.0, 3.0])
    assert (mean, half) == pytest.approx((2.0, 1.96 * 1.0 / np.sqrt(2)))
    assert interval([5.0]) == (5.0, 0.0)


def test_accuracy() -> None:
    assert accuracy(["walk", "run", "bow"], ["walk", "bow", "bow"]) == pytest.approx(2 / 3)


def test_batches_of_different_captions_are_the_published_loaders() -> None:
    labels = [str(i) for i in range(100)]
    drawn = draw_batches(labels, np.random.default_rng(3))
    order = np.random.default_rng(3).permutation(100)
    assert np.array_equal(drawn, order[:96].reshape(3, 32))


def test_no_batch_holds_a_caption_twice() -> None:
    rng = np.random.default_rng(0)
    labels = [str(x) for x in rng.choice(60, 500, p=np.arange(60, 0, -1) / 1830)]
    drawn = draw_batches(labels, rng)
    assert len(drawn) >= 10
    assert len(set(drawn.ravel())) == drawn.size
    for batch in drawn:
        assert len({labels[i] for i in batch}) == 32


def test_clips_of_one_caption_are_not_each_others_wrong_answers() -> None:
    labels = [str(i // 2) for i in range(128)]  # every caption twice, the same motion twice
    x = np.repeat(normal(64, 8), 2, axis=0)
    at = draw_batches(labels, np.random.default_rng(0)).ravel()
    assert r_precision(x[at], x[at])[0] == 1
    ignoring = np.arange(128)
    assert r_precision(x[ignoring], x[ignoring])[0] == 0.5


def test_a_judge_that_cannot_tell_is_at_chance() -> None:
    same = np.zeros((320, 4))
    assert r_precision(same, same) == pytest.approx([1 / 32, 2 / 32, 3 / 32])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: draw_batches(["a"] * 31, np.random.default_rng(0)), "31 clips; R-precision needs at least 32"),
        (lambda: draw_batches(["a", "b"] * 20, np.random.default_rng(0)), "2 different captions in 40 clips"),
        (lambda: r_precision(normal(31, 4), normal(31, 4)), "31 clips are not whole batches of 32"),
        (lambda: r_precision(normal(32, 4), normal(32, 4), k=33), "k must be from 1 to 32, not 33"),
        (lambda: mm_dist(normal(3, 4), normal(4, 4)), r"texts \(3, 4\) and motions \(4, 4\) do not match"),
        (lambda: mm_dist(normal(3), normal(3)), r"texts: shape \(3,\), expected \(clips, width\)"),
        (lambda: fid([[0, np.nan], [1, 1]], [[0, 0], [1, 1]]), "real clips: row 0 holds NaN"),
        (lambda: fid(normal(5, 3), normal(5, 4)), "real clips are 3 wide, made clips 4"),
        (lambda: kid(normal(1, 3), normal(5, 3)), "1 real and 5 made clips; at least 2"),
        (lambda: precision_recall(normal(3, 3), normal(5, 3)), "need more than k = 3"),
        (lambda: diversity(normal(5, 3), np.random.default_rng(0)), "300 pairs; from 5 clips"),
        (lambda: multimodality(normal(5, 3), np.random.default_rng(0)), r"embeddings \(5, 3\); MultiModality of 10"),
        (lambda: multimodality(normal(5, 3, 2), np.random.default_rng(0)), "≥ 10 clips"),
        (lambda: accuracy(["a"], []), "1 actions asked for, 0 found"),
        (lambda: interval([]), "one or more replications"),
    ],
)
def test_bad_input_is_one_line(call, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
