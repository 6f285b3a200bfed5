"""Samplers as pure functions of a denoiser, which maps (x_t, t) to its estimate of x_0.

Each begins with noise at `times[0]`, which is 1, and returns the sample at `times[-1]`, which is 0: the last estimate
of x_0 itself, to the bit. They do arithmetic only, one element at a time, so arrays of numpy and of torch both will
do, and no frame or clip of a batch touches another but through the denoiser.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.schedule import Schedule

Samples = Any  # an array (B, …) of numpy or torch
Denoiser = Callable[[Samples, float], Samples]
Draw = Callable[[], Samples]  # fresh standard normal noise (B, …) at every call


def ddpm(denoise: Denoiser, draw: Draw, schedule: Schedule, times: Sequence[float]) -> Samples:
    """Ancestral sampling (Ho et al. 2020, Algorithm 2, mean by Eq. 7) with σ_t² = β_t.

    β_t = 1 − ᾱ_t/ᾱ_s is that of the chain which has the levels of `times` alone, s the one after t (Nichol & Dhariwal
    2021, Eq. 19). Their other choice, β̃_t, draws too little variance where the levels are few.
    """
    x = draw()
    for now, after in pairwise(times):
        alpha, _ = schedule.signal_and_noise(now)
        alpha_next, sigma_next = schedule.signal_and_noise(after)
        keep = alpha / alpha_next  # √(1 − β)
        beta, variance = 1 - keep**2, 1 - alpha**2
        x = alpha_next * beta / variance * denoise(x, now) + keep * sigma_next**2 / variance * x
        if after > 0:
            x = x + math.sqrt(beta) * draw()
    return x


def ddim(denoise: Denoiser, draw: Draw, schedule: Schedule, times: Sequence[float]) -> Samples:
    """Deterministic DDIM (Song et al. 2021, Eq. 12 with η = 0); calls `draw` once."""
    x = draw()
    for now, after in pairwise(times):
        alpha, sigma = schedule.signal_and_noise(now)
        alpha_next, sigma_next = schedule.signal_and_noise(after)
        x0 = denoise(x, now)
        x = alpha_next * x0 + sigma_next / sigma * (x - alpha * x0)
    return x


def dpm_solver_2m(denoise: Denoiser, draw: Draw, schedule: Schedule, times: Sequence[float]) -> Samples:
    """DPM-Solver++(2M) (Lu et al. 2022, Algorithm 2); calls `draw` once.

    Second order in λ = log(α/σ); the first step and the last are first order, which is DDIM.
    """
    x = draw()
    last: tuple[float, Samples] | None = None  # λ and x_0 one step before
    for now, after in pairwise(times):
        alpha, sigma = schedule.signal_and_noise(now)
        alpha_next, sigma_next = schedule.signal_and_noise(after)
        x0 = denoise(x, now)
        best, lam = x0, schedule.log_ratio(now)
        if last is not None and after > 0:
            step = schedule.log_ratio(after) - lam
            best = x0 + step / (2 * (lam - last[0])) * (x0 - last[1])
        last = lam, x0
        x = alpha_next * best + sigma_next / sigma * (x - alpha * best)
    return x


Sampler = Callable[[Denoiser, Draw, Schedule, Sequence[float]], Samples]
SAMPLERS: dict[str, Sampler] = {"ddpm": ddpm, "ddim": ddim, "dpm-solver-2m": dpm_solver_2m}


def seeded(seeds: Sequence[int], window: int, frames: int, width: int) -> Draw:
    """Noise (B, frames, width), float32: clip i's from `seeds[i]` alone.

    Every draw takes the numbers of a whole `window` and lets go of those past `frames` (at most window), so that a clip
    gets the same noise whatever the length of the batch that it is drawn in. Raises ValueError for other lengths.
    """
    if not 0 < frames <= window:
        raise ValueError(f"frames must be 1 to the window's {window}, not {frames}")
    random = [np.random.default_rng(seed) for seed in seeds]
    return lambda: np.stack([each.standard_normal((window, width), np.float32)[:frames] for each in random])


def from_noise(predict: Denoiser, schedule: Schedule) -> Denoiser:
    """The denoiser of a network that maps (x_t, t) to its estimate of ε: x_0 = (x_t − σ·ε)/α."""

    def denoise(x: Samples, t: float) -> Samples:
        alpha, sigma = schedule.signal_and_noise(t)
        return (x - sigma * predict(x, t)) / alpha

    return denoise


def to_noise(denoise: Denoiser, schedule: Schedule) -> Denoiser:
    """The other way: ε = (x_t − α·x_0)/σ of a denoiser, for t > 0."""

    def predict(x: Samples, t: float) -> Samples:
        alpha, sigma = schedule.signal_and_noise(t)
        return (x - alpha * denoise(x, t)) / sigma

    return predict


def guide(with_text: Samples, without: Samples, scale: float) -> Samples:
    """Classifier-free guidance u + s·(c − u) (Ho & Salimans 2022); the same for estimates of x_0 and of ε."""
    return without + scale * (with_text - without)


def guided(predict: Denoiser, scale: float) -> Denoiser:
    """Guidance with both passes in one batch of numpy arrays.

    `predict` gets the samples twice over, (2B, …), and is to hear the text for the first B alone.
    """

    def both(x: NDArray[np.floating], t: float) -> NDArray[np.floating]:
        y = predict(np.concatenate([x, x]), t)
        return guide(y[: len(x)], y[len(x) :], scale)

    return both
