"""Diffusion over normalised features: noise schedule, forward noising, guidance and samplers as pure functions.

Time runs from 0 (data) to 1 (noise). A denoiser maps (x_t, t) to its estimate of x_0, MDM's choice (Tevet et al. 2022,
Sec. 3); a sampler needs nothing else. The samplers do arithmetic only, so arrays of numpy and of torch both will do.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Samples = Any  # an array (B, …) of numpy or torch
Denoiser = Callable[[Samples, float], Samples]

_OFFSET = 0.008  # Nichol & Dhariwal 2021, Eq. 17: keeps the first noise levels from vanishing
_MIN_SIGNAL = 1e-3  # their cap on β in effect: the last level stays invertible


def signal_and_noise(t: float) -> tuple[float, float]:
    """α(t) and σ(t) of the cosine schedule (Nichol & Dhariwal 2021, Eq. 17), α² + σ² = 1, for t in [0, 1]."""
    start = math.cos(_OFFSET / (1 + _OFFSET) * math.pi / 2)
    alpha = max(_MIN_SIGNAL, math.cos((t + _OFFSET) / (1 + _OFFSET) * math.pi / 2) / start)
    return alpha, math.sqrt(1 - alpha**2)


def levels(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """α and σ (B,) of noise levels `t` (B,): x_t = α·x_0 + σ·ε is the closed form of the forward chain."""
    alpha, sigma = np.array([signal_and_noise(float(each)) for each in t]).T
    return alpha, sigma


def guide(with_text: Samples, without: Samples, scale: float) -> Samples:
    """Classifier-free guidance u + s·(c − u) (Ho & Salimans 2022)."""
    return without + scale * (with_text - without)


def times(steps: int) -> list[float]:
    """Noise levels from 1 down to 0, `steps` + 1 of them; raises ValueError where steps is not at least 1."""
    if steps < 1:
        raise ValueError(f"steps must be at least 1, not {steps}")
    return [1 - i / steps for i in range(steps + 1)]


def ddim(denoise: Denoiser, noise: Samples, steps: int) -> Samples:
    """Deterministic DDIM (Song et al. 2021, Eq. 12 with η = 0) from `noise` (B, …) in `steps` passes."""
    x = noise
    for now, after in pairwise(times(steps)):
        alpha, sigma = signal_and_noise(now)
        alpha_next, sigma_next = signal_and_noise(after)
        x0 = denoise(x, now)
        x = alpha_next * x0 + sigma_next / sigma * (x - alpha * x0)
    return x


def dpm_solver_2m(denoise: Denoiser, noise: Samples, steps: int) -> Samples:
    """DPM-Solver++(2M) (Lu et al. 2022, Algorithm 2) from `noise` (B, …) in `steps` passes.

    Second order in λ = log(α/σ); the first step and the last are first order, which is DDIM.
    """
    x = noise
    last: tuple[float, Samples] | None = None  # λ and x_0 one step before
    for now, after in pairwise(times(steps)):
        alpha, sigma = signal_and_noise(now)
        alpha_next, sigma_next = signal_and_noise(after)
        x0 = denoise(x, now)
        best, lam = x0, math.log(alpha / sigma)
        if last is not None and after > 0:
            step = math.log(alpha_next / sigma_next) - lam
            best = x0 + step / (2 * (lam - last[0])) * (x0 - last[1])
        last = lam, x0
        x = alpha_next * best + sigma_next / sigma * (x - alpha * best)
    return x


SAMPLERS: dict[str, Callable[[Denoiser, Samples, int], Samples]] = {"ddim": ddim, "dpm-solver-2m": dpm_solver_2m}
