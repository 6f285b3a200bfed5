"""Schedules against their definitions; samplers against distributions whose exact denoiser is known in closed form."""

import math

import numpy as np
import pytest
import torch
from exact_denoisers import Mixture, exact_noise, exact_x0
from sampler_errors import MODES

from motiongen.diffusion.samplers import (
    SAMPLERS,
    Denoiser,
    ddim,
    ddpm,
    dpm_solver_2m,
    from_noise,
    guide,
    guided,
    seeded,
    to_noise,
)
from motiongen.diffusion.schedule import COSINE, LINEAR, SCHEDULES, Schedule, even_ratios, even_times

COUNT = 4000
NORMAL = Mixture(np.ones(1), MODES.means[:1], MODES.spreads[:1])


def sample(name: str, denoise: Denoiser, schedule: Schedule) -> np.ndarray:
    random = np.random.default_rng(0)
    times = even_ratios(schedule, 50) if name == "dpm-solver-2m" else even_times(400 if name == "ddim" else 200)
    return SAMPLERS[name](denoise, lambda: random.standard_normal((COUNT, 3)), schedule, times)


def assert_moments(x: np.ndarray, mixture: Mixture) -> None:
    """Mean and covariance within 4 standard errors, and 1 % of the deviations for steps that are not endless."""
    mean, spread = mixture.moments()
    off, deviation = x - mean, np.sqrt(np.diag(spread))
    products = off[:, :, None] * off[:, None, :]
    bound = 4 / math.sqrt(len(x))
    assert (np.abs(off.mean(0)) < bound * x.std(0) + 0.01 * deviation).all()
    assert (np.abs(products.mean(0) - spread) < bound * products.std(0) + 0.01 * np.outer(deviation, deviation)).all()


@pytest.mark.parametrize("mixture", [NORMAL, MODES], ids=["gaussian", "two modes"])
@pytest.mark.parametrize("predicted", ["x0", "noise"])
@pytest.mark.parametrize("schedule", SCHEDULES.values(), ids=SCHEDULES)
@pytest.mark.parametrize("name", SAMPLERS)
def test_mean_and_covariance_are_recovered(name: str, schedule: Schedule, predicted: str, mixture: Mixture) -> None:
    noise = exact_noise(mixture, schedule)
    denoise = exact_x0(mixture, schedule) if predicted == "x0" else from_noise(noise, schedule)
    x = sample(name, denoise, schedule)
    assert_moments(x, mixture)
    if mixture is MODES:
        first = MODES.modes(x)[0] > 0.5
        assert first.mean() == pytest.approx(0.7, abs=4 * math.sqrt(0.7 * 0.3 / COUNT) + 0.005)
        assert np.allclose(x[first].mean(0), MODES.means[0], atol=0.05)
        assert np.allclose(x[~first].mean(0), MODES.means[1], atol=0.07)


def test_exact_denoisers_are_the_mean_of_what_was_noised() -> None:
    """By weighing samples of x_0 with how likely each makes x_t (importance sampling)."""
    random = np.random.default_rng(4)
    which = random.random(200_000) < 0.7
    draws = [random.multivariate_normal(m, c, which.size) for m, c in zip(MODES.means, MODES.spreads, strict=True)]
    clean = np.where(which[:, None], *draws)
    alpha, sigma = COSINE.signal_and_noise(0.6)
    x = np.array([[0.2, 0.3, -0.4]])
    weights = np.exp(-((x - alpha * clean) ** 2).sum(1) / (2 * sigma**2))
    mean = weights @ clean / weights.sum()
    assert np.allclose(exact_x0(MODES, COSINE)(x, 0.6)[0], mean, atol=0.02)
    assert np.allclose(exact_noise(MODES, COSINE)(x, 0.6)[0], (x[0] - alpha * mean) / sigma, atol=0.02)


def test_second_order_beats_first_at_few_steps() -> None:
    """Against the flow solved in a thousand steps, from the same noise."""
    start = np.random.default_rng(2).standard_normal((500, 3))
    denoise = exact_x0(NORMAL, COSINE)
    exact = ddim(denoise, lambda: start, COSINE, even_times(1000))
    first, second = (
        np.abs(s(denoise, lambda: start, COSINE, even_times(10)) - exact).mean() for s in (ddim, dpm_solver_2m)
    )
    assert second < 0.7 * first


def test_an_ancestral_step_is_bayes_rule() -> None:
    """One step against the Gaussian (x_s, x_t) given x_0, conditioned on x_t by linear algebra."""
    t, s, x0, x1 = 1.0, 0.4, 0.7, -1.3
    (alpha_t, sigma_t), (alpha_s, sigma_s) = LINEAR.signal_and_noise(t), LINEAR.signal_and_noise(s)
    joint = np.array([[sigma_s**2, alpha_t / alpha_s * sigma_s**2], [0, sigma_t**2]])
    mean = alpha_s * x0 + joint[0, 1] / joint[1, 1] * (x1 - alpha_t * x0)
    for fresh in (0.0, 1.0):
        draws, seen = iter([np.array([x1]), np.array([fresh])]), []

        def denoise(x: np.ndarray, t: float, seen: list[np.ndarray] = seen) -> np.ndarray:
            seen.append(x)
            return np.array([x0])

        ddpm(denoise, lambda draws=draws: next(draws), LINEAR, [t, s, 0.0])
        variance = 1 - (alpha_t / alpha_s) ** 2
        assert seen[1] == pytest.approx(mean + fresh * math.sqrt(variance), abs=1e-12)


@pytest.mark.parametrize("schedule", SCHEDULES.values(), ids=SCHEDULES)
@pytest.mark.parametrize("name", SAMPLERS)
def test_what_comes_out_is_the_last_estimate_to_the_bit(name: str, schedule: Schedule) -> None:
    estimates = np.random.default_rng(3).standard_normal((7, 2, 5)).astype(np.float32)
    coming = iter(estimates)
    draw = seeded([0, 1], 5, 5, 1)
    x = SAMPLERS[name](lambda x, t: next(coming)[..., None], draw, schedule, even_ratios(schedule, 7))
    assert x.dtype == np.float32
    assert (x[..., 0] == estimates[-1]).all()


@pytest.mark.parametrize("name", SAMPLERS)
def test_a_clip_is_the_same_alone_and_beside_longer_ones(name: str) -> None:
    def draw(seeds: list[int], frames: int) -> np.ndarray:
        pull = SAMPLERS[name]
        return pull(lambda x, t: np.tanh(x) * t, seeded(seeds, 12, frames, 2), LINEAR, even_times(6))

    assert (draw([4, 5, 6], 12)[1, :8] == draw([5], 8)[0]).all()
    assert not np.allclose(draw([4], 8), draw([5], 8))


@pytest.mark.parametrize("name", SAMPLERS)
def test_tensors_of_torch_go_through_as_well(name: str) -> None:
    noise = np.random.default_rng(5).standard_normal((6, 4, 3))
    here, there = iter(noise), iter(torch.from_numpy(noise))
    x = SAMPLERS[name](lambda x, t: x / (1 + x * x), lambda: next(here), COSINE, even_times(6))
    y = SAMPLERS[name](lambda x, t: x / (1 + x * x), lambda: next(there), COSINE, even_times(6))
    assert np.allclose(x, y.numpy(), atol=1e-12)


def test_cosine_schedule_is_the_papers() -> None:
    """Nichol & Dhariwal 2021, Eq. 17, in their own terms: ᾱ_t = f(t)/f(0)."""
    for t in (0.001, 0.25, 0.5, 0.75, 0.99):
        f, start = (math.cos((s + 0.008) / 1.008 * math.pi / 2) ** 2 for s in (t, 0.0))
        assert COSINE.signal_and_noise(t)[0] ** 2 == pytest.approx(f / start, rel=1e-12)


def test_linear_schedule_is_the_discrete_product_at_every_level() -> None:
    product = 1.0
    for i in range(1, 1001):
        product *= 1 - (1e-4 + (0.02 - 1e-4) * (i - 1) / 999)
        alpha, sigma = LINEAR.signal_and_noise(i / 1000)
        assert alpha**2 == pytest.approx(product, rel=1e-12)
        assert sigma**2 == pytest.approx(1 - product, rel=1e-10)
    between = [LINEAR.signal_and_noise(t)[0] for t in (0.500, 0.5005, 0.501)]
    assert between[1] ** 2 == pytest.approx(between[0] * between[2], rel=1e-12)


@pytest.mark.parametrize("schedule", SCHEDULES.values(), ids=SCHEDULES)
def test_schedule_keeps_the_variance_and_ends_in_noise(schedule: Schedule) -> None:
    alpha, sigma = schedule.levels(np.linspace(0, 1, 50))
    assert np.allclose(alpha**2 + sigma**2, 1)
    assert (np.diff(alpha) < 0).all()
    assert (alpha[0], sigma[0]) == (1, 0)
    assert alpha[-1] < 0.01


@pytest.mark.parametrize("schedule", SCHEDULES.values(), ids=SCHEDULES)
def test_even_ratios_are(schedule: Schedule) -> None:
    times = even_ratios(schedule, 20)
    assert (len(times), times[0], times[-1]) == (21, 1.0, 0.0)
    assert times[-2] == pytest.approx(0.001, abs=2e-6)
    apart = np.diff([schedule.log_ratio(t) for t in times[:-1]])
    assert np.allclose(apart, apart.mean(), rtol=2e-3)
    assert even_ratios(schedule, 1) == even_times(1) == [1.0, 0.0]
    assert (np.diff(even_ratios(schedule, 1000)) < 0).all()


@pytest.mark.parametrize("steps", [0, -1, 1001])
def test_impossible_steps_are_refused(steps: int) -> None:
    with pytest.raises(ValueError, match=f"1 to 1000, not {steps}"):
        even_times(steps)
    with pytest.raises(ValueError, match=f"1 to 1000, not {steps}"):
        even_ratios(LINEAR, steps)


def test_noise_of_more_frames_than_the_window_is_refused() -> None:
    with pytest.raises(ValueError, match="1 to the window's 8, not 9"):
        seeded([0], 8, 9, 2)


def test_guidance() -> None:
    assert [guide(3.0, 1.0, s) for s in (0.0, 1.0, 2.5)] == [1.0, 3.0, 6.0]


def test_guidance_takes_both_passes_in_one_batch() -> None:
    batches = []

    def predict(x: np.ndarray, t: float) -> np.ndarray:
        batches.append(len(x))
        return x * np.array([3.0] * 2 + [1.0] * 2)[:, None] * t

    x = np.array([[1.0], [2.0]])
    assert guided(predict, 2.5)(x, 0.5).tolist() == [[3.0], [6.0]]
    assert batches == [4]


def test_noise_and_x0_turn_into_each_other() -> None:
    x = np.random.default_rng(6).standard_normal((4, 3))
    for t in (0.001, 0.3, 1.0):
        there = to_noise(exact_x0(NORMAL, LINEAR), LINEAR)
        assert np.allclose(there(x, t), exact_noise(NORMAL, LINEAR)(x, t), atol=1e-12)
        assert np.allclose(from_noise(there, LINEAR)(x, t), exact_x0(NORMAL, LINEAR)(x, t), atol=1e-10)
