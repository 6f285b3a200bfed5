"""Samplers against distributions whose exact denoiser is known in closed form."""

import math

import numpy as np
import pytest

from motiongen.diffusion.samplers import SAMPLERS, guide, levels, signal_and_noise, times

MEAN, SPREAD = 1.5, 0.6


def gaussian(x: np.ndarray, t: float) -> np.ndarray:
    """E[x_0 | x_t] for x_0 ~ N(MEAN, SPREAD²)."""
    alpha, sigma = signal_and_noise(t)
    gain = alpha * SPREAD**2 / (alpha**2 * SPREAD**2 + sigma**2)
    return MEAN + gain * (x - alpha * MEAN)


def two_modes(x: np.ndarray, t: float) -> np.ndarray:
    """E[x_0 | x_t] for x_0 = −2 or +2, three times as often +2: 2·tanh of half the log odds."""
    alpha, sigma = signal_and_noise(t)
    return 2 * np.tanh((np.log(3.0) + 4 * alpha * x / sigma**2) / 2)


def noise(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((count, 1))


@pytest.mark.parametrize("name", SAMPLERS)
def test_a_gaussian_is_recovered(name: str) -> None:
    x = SAMPLERS[name](gaussian, noise(20_000, 0), 100)
    assert x.mean() == pytest.approx(MEAN, abs=0.02)
    assert x.std() == pytest.approx(SPREAD, abs=0.02)


@pytest.mark.parametrize("name", SAMPLERS)
def test_two_modes_keep_their_shares(name: str) -> None:
    x = SAMPLERS[name](two_modes, noise(20_000, 1), 100)
    assert np.mean(x > 0) == pytest.approx(0.75, abs=0.02)
    assert np.median(np.abs(x)) == pytest.approx(2.0, abs=0.05)


def test_second_order_beats_first_at_few_steps() -> None:
    """Against the flow solved in a thousand steps, from the same noise."""
    start = noise(500, 2)
    exact = SAMPLERS["ddim"](gaussian, start, 1000)
    error = {n: np.abs(s(gaussian, start, 10) - exact).mean() for n, s in SAMPLERS.items()}
    assert error["dpm-solver-2m"] < 0.7 * error["ddim"]


def test_schedule_keeps_the_variance_and_ends_in_noise() -> None:
    alpha, sigma = levels(np.linspace(0, 1, 50))
    assert np.allclose(alpha**2 + sigma**2, 1)
    assert (np.diff(alpha) < 0).all()
    assert alpha[0] == pytest.approx(1)
    assert alpha[-1] < 0.01
    assert signal_and_noise(0.5)[0] == pytest.approx(
        math.cos(0.508 / 1.008 * math.pi / 2) / math.cos(0.008 / 1.008 * math.pi / 2)
    )


def test_guidance() -> None:
    assert [guide(3.0, 1.0, s) for s in (0.0, 1.0, 2.5)] == [1.0, 3.0, 6.0]


def test_no_steps_is_refused() -> None:
    with pytest.raises(ValueError, match="not 0"):
        times(0)
