"""Constraints on x_0 against linear algebra and against the Gaussian that they condition."""

import math

import numpy as np
import pytest

from motiongen.diffusion.constraints import keep_known, with_total
from motiongen.diffusion.samplers import SAMPLERS, Denoiser
from motiongen.diffusion.schedule import LINEAR, even_ratios, even_times

CLIPS, FRAMES, WIDTH = 3, 8, 4
SPREAD = 0.6


def independent(x: np.ndarray, t: float) -> np.ndarray:
    """E[x_0 | x_t] where every number is N(0, SPREAD²)."""
    alpha, sigma = LINEAR.signal_and_noise(t)
    return alpha * SPREAD**2 / (alpha**2 * SPREAD**2 + sigma**2) * x


def draw(name: str, denoise: Denoiser, count: int = CLIPS, width: int = WIDTH) -> np.ndarray:
    random = np.random.default_rng(0)
    times = even_ratios(LINEAR, 20) if name == "dpm-solver-2m" else even_times(200)
    return SAMPLERS[name](denoise, lambda: random.standard_normal((count, FRAMES, width), np.float32), LINEAR, times)


def clips(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((CLIPS, FRAMES, WIDTH)).astype(np.float32)


@pytest.mark.parametrize("name", SAMPLERS)
def test_known_frames_and_columns_come_out_to_the_bit_and_the_rest_is_as_before(name: str) -> None:
    known, mask = clips(0).astype(float), np.zeros((CLIPS, FRAMES, WIDTH), bool)
    mask[:, [0, 1, 5]] = True  # frames
    mask[1, :, 2:] = True  # columns of one clip alone
    known[~mask] = np.nan
    x = draw(name, keep_known(independent, known, mask))
    assert x.dtype == np.float32
    assert (x[mask] == known[mask]).all()
    assert (x[~mask] == draw(name, independent)[~mask]).all()


def test_a_mask_of_frames_and_columns_serves_all_clips() -> None:
    known, mask = clips(1), np.arange(FRAMES)[:, None] < np.array([3, 0, 8, 1])
    x = keep_known(independent, known, mask)(clips(2), 0.5)
    assert (x == np.where(np.broadcast_to(mask, x.shape), known, independent(clips(2), 0.5))).all()


def test_known_values_must_be_numbers() -> None:
    with pytest.raises(ValueError, match="must all be finite"):
        keep_known(independent, np.full((CLIPS, FRAMES, WIDTH), np.inf), np.ones((FRAMES, 1), bool))


@pytest.mark.parametrize("equal", [True, False])
def test_the_correction_is_the_weighted_pseudo_inverses(equal: bool) -> None:
    """x + √W (A√W)⁺ (y − Ax): the correction d that is least in Σ d²/w."""
    frames = np.arange(FRAMES) < np.array([8, 5, 3])[:, None]
    weights = np.ones((CLIPS, FRAMES)) if equal else np.random.default_rng(3).uniform(0, 2, (CLIPS, FRAMES))
    total, x = np.array([4.0, -7.5, 0.0]), clips(4).astype(float)
    x.setflags(write=False)  # what the denoiser hands out may be its own
    found = with_total(lambda x, t: x, 2, frames, total, weights)(x, 0.5)
    for clip, (real, root) in enumerate(zip(frames.astype(float), np.sqrt(weights), strict=True)):
        inverse = root * np.linalg.pinv((real * root)[None])[:, 0]
        expected = x[clip, :, 2] + inverse * (total[clip] - real @ x[clip, :, 2])
        assert np.allclose(found[clip, :, 2], expected, atol=1e-12)
    assert (found[..., [0, 1, 3]] == x[..., [0, 1, 3]]).all()
    assert (found[~frames] == x[~frames]).all()


@pytest.mark.parametrize("name", SAMPLERS)
def test_a_sample_has_its_total_and_a_clip_without_one_is_left_alone(name: str) -> None:
    frames = np.arange(FRAMES) < np.array([8, 6, 8])[:, None]
    total = np.array([10.0, -3.0, np.nan])
    weights = np.random.default_rng(5).uniform(0.1, 1, (CLIPS, FRAMES))
    weights[2] = 0
    x = draw(name, with_total(independent, 1, frames, total, weights))
    assert np.allclose((x[..., 1] * frames).sum(1)[:2], total[:2], atol=1e-5)
    assert (x[2] == draw(name, independent)[2]).all()


@pytest.mark.parametrize("name", SAMPLERS)
def test_independent_frames_are_drawn_from_their_distribution_given_the_sum(name: str) -> None:
    """N(0, s²) each, given that they add up to y: mean y/T, covariance s²(I − 1/T) (Gaussian conditioning)."""
    count = 4000
    even, real = np.ones((count, FRAMES)), np.ones((count, FRAMES), bool)
    x = draw(name, with_total(independent, 0, real, np.full(count, 4.0), even), count, 1)[..., 0]
    expected = SPREAD**2 * (np.eye(FRAMES) - 1 / FRAMES)
    assert np.allclose(x.mean(0), 4.0 / FRAMES, atol=4.5 * SPREAD / math.sqrt(count))
    assert np.allclose(np.cov(x.T), expected, atol=4.5 * SPREAD**2 * math.sqrt(2 / count) + 0.01 * SPREAD**2)


def test_a_total_around_known_frames_holds_both() -> None:
    known, mask = clips(6), np.zeros((FRAMES, WIDTH), bool)
    mask[:2] = True
    weights = np.tile(~mask[:, 0] * 1.0, (CLIPS, 1))
    held = keep_known(independent, known, mask)
    x = draw("dpm-solver-2m", with_total(held, 0, weights >= 0, np.full(CLIPS, 5.0), weights))
    assert (x[:, :2] == known[:, :2]).all()
    assert np.allclose(x[..., 0].sum(1), 5.0, atol=1e-5)


REAL, EVEN, ZERO = np.ones((CLIPS, FRAMES), bool), np.ones((CLIPS, FRAMES)), np.zeros(CLIPS)


@pytest.mark.parametrize(
    ("frames", "total", "weights", "said"),
    [
        (REAL, np.zeros(2), EVEN, "shapes"),
        (REAL, ZERO, EVEN[:, :5], "shapes"),
        (REAL, ZERO, -EVEN, "at least 0"),
        (REAL, ZERO, EVEN * np.nan, "finite"),
        (REAL, ZERO + np.inf, EVEN, "nan for a clip that has none"),
        (REAL, ZERO, EVEN * np.array([[1], [0], [1]]), "clip 1 has a total"),
        (REAL & np.array([[True], [True], [False]]), ZERO, EVEN, "clip 2 has a total"),
    ],
)
def test_bad_constraints_say_what_is_bad(frames: np.ndarray, total: np.ndarray, weights: np.ndarray, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        with_total(independent, 0, frames, total, weights)
