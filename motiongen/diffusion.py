"""Diffusion over normalised features: noise schedule, forward noising, guidance and samplers as pure functions.

Time runs from 0 (data) to 1 (noise). A denoiser maps (x_t, t) to its estimate of x_0, MDM's choice (Tevet et al. 2022,
Sec. 3); a sampler needs nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import torch
from torch import Tensor

Denoiser = Callable[[Tensor, Tensor], Tensor]

_OFFSET = 0.008  # Nichol & Dhariwal 2021, Eq. 17: keeps the first noise levels from vanishing


def signal_and_noise(t: Tensor) -> tuple[Tensor, Tensor]:
    """α(t) and σ(t) of the cosine schedule (Nichol & Dhariwal 2021, Eq. 17), α² + σ² = 1, for t in [0, 1].

    α is kept above 1e-3, as their cap on β does, so that the last level stays invertible.
    """
    angle = (t + _OFFSET) / (1 + _OFFSET) * math.pi / 2
    start = math.cos(_OFFSET / (1 + _OFFSET) * math.pi / 2)
    alpha = (torch.cos(angle) / start).clamp(1e-3, 1.0)
    return alpha, (1 - alpha**2).clamp_min(0.0).sqrt()


def add_noise(x0: Tensor, t: Tensor, noise: Tensor) -> Tensor:
    """x_t = α(t)·x_0 + σ(t)·ε, with `t` (B,) against `x0` (B, …): the closed form of the forward chain."""
    alpha, sigma = signal_and_noise(t.view(-1, *[1] * (x0.dim() - 1)))
    return alpha * x0 + sigma * noise


def guided(conditional: Callable[[Tensor, Tensor, Tensor], Tensor], scale: float) -> Denoiser:
    """Classifier-free guidance u + s·(c − u) (Ho & Salimans 2022) with both passes in one batch.

    `conditional(x, t, keep)` denoises a batch, with the condition where `keep` (B,) is true and without it elsewhere.
    """

    def denoise(x: Tensor, t: Tensor) -> Tensor:
        keep = torch.arange(2 * len(x), device=x.device) < len(x)
        both = conditional(torch.cat([x, x]), torch.cat([t, t]), keep)
        with_text, without = both.chunk(2)
        return without + scale * (with_text - without)

    return denoise


def times(steps: int) -> Tensor:
    """Noise levels (steps + 1,) from 1 down to 0; raises ValueError where steps is not at least 1."""
    if steps < 1:
        raise ValueError(f"steps must be at least 1, not {steps}")
    return torch.linspace(1.0, 0.0, steps + 1)


def ddim(denoise: Denoiser, noise: Tensor, steps: int) -> Tensor:
    """Deterministic DDIM (Song et al. 2021, Eq. 12 with η = 0) from `noise` (B, …) in `steps` passes."""
    x = noise
    grid = times(steps)
    for now, after in pairwise(grid):
        alpha, sigma = signal_and_noise(now)
        alpha_next, sigma_next = signal_and_noise(after)
        x0 = denoise(x, now.expand(len(x)))
        x = alpha_next * x0 + sigma_next / sigma * (x - alpha * x0)
    return x


def dpm_solver_2m(denoise: Denoiser, noise: Tensor, steps: int) -> Tensor:
    """DPM-Solver++(2M) (Lu et al. 2022, Algorithm 2) from `noise` (B, …) in `steps` passes.

    Second order in the log signal-to-noise ratio λ; the first step and the last are first order, which is DDIM.
    """
    x = noise
    grid = times(steps)
    previous: tuple[Tensor, Tensor] | None = None  # (λ, x0) one step before
    for i, (now, after) in enumerate(pairwise(grid)):
        alpha, sigma = signal_and_noise(now)
        alpha_next, sigma_next = signal_and_noise(after)
        x0 = denoise(x, now.expand(len(x)))
        best = x0
        lam = (alpha / sigma).log()
        if previous is not None and i < steps - 1:
            step = (alpha_next / sigma_next).log() - lam
            ratio = (lam - previous[0]) / step
            best = x0 + (x0 - previous[1]) / (2 * ratio)
        previous = (lam, x0)
        x = alpha_next * best + sigma_next / sigma * (x - alpha * best)
    return x


SAMPLERS: dict[str, Callable[[Denoiser, Tensor, int], Tensor]] = {"ddim": ddim, "dpm-solver-2m": dpm_solver_2m}
