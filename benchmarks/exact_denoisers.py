"""Mixtures of Gaussians, whose exact denoisers are known in closed form: what a sampler is measured on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.samplers import Denoiser
from motiongen.diffusion.schedule import Schedule

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mixture:
    """Of K Gaussians in D dimensions: `shares` (K,) that add up to 1, `means` (K, D), `spreads` (K, D, D)."""

    shares: Array
    means: Array
    spreads: Array

    def moments(self) -> tuple[Array, Array]:
        """Mean (D,) and covariance (D, D)."""
        mean = self.shares @ self.means
        off = self.means - mean
        return mean, np.einsum("k,kij->ij", self.shares, self.spreads + off[:, :, None] * off[:, None, :])

    def modes(self, x: Array, alpha: float = 1.0, sigma: float = 0.0) -> Array:
        """How likely α·x_0 + σ·ε = x (B, D) comes from each mode: (K, B)."""
        logs = []
        for share, mean, spread in zip(self.shares, self.means, self.spreads, strict=True):
            noisy = alpha**2 * spread + sigma**2 * np.eye(len(mean))
            off = x - alpha * mean
            distance = np.sum(off @ np.linalg.inv(noisy) * off, axis=1)
            logs.append(np.log(share) - (distance + np.linalg.slogdet(noisy)[1]) / 2)
        odds = np.exp(np.array(logs) - np.max(logs, axis=0))
        return odds / odds.sum(0)


def exact_x0(mixture: Mixture, schedule: Schedule) -> Denoiser:
    """E[x_0 | x_t]: every mode's m + αC(α²C + σ²)⁻¹(x_t − αm), weighed by how likely x_t comes from it."""

    def denoise(x: Array, t: float) -> Array:
        alpha, sigma = schedule.signal_and_noise(t)
        guess = np.zeros_like(x)
        for odds, mean, spread in zip(mixture.modes(x, alpha, sigma), mixture.means, mixture.spreads, strict=True):
            gain = alpha * spread @ np.linalg.inv(alpha**2 * spread + sigma**2 * np.eye(len(mean)))
            guess += odds[:, None] * (mean + (x - alpha * mean) @ gain.T)
        return guess

    return denoise


def exact_noise(mixture: Mixture, schedule: Schedule) -> Denoiser:
    """E[ε | x_t] by the score (Vincent 2011): −σ times the gradient of the logarithm of the density of x_t."""

    def predict(x: Array, t: float) -> Array:
        alpha, sigma = schedule.signal_and_noise(t)
        score = np.zeros_like(x)
        for odds, mean, spread in zip(mixture.modes(x, alpha, sigma), mixture.means, mixture.spreads, strict=True):
            noisy = alpha**2 * spread + sigma**2 * np.eye(len(mean))
            score -= odds[:, None] * ((x - alpha * mean) @ np.linalg.inv(noisy))
        return -sigma * score

    return predict
