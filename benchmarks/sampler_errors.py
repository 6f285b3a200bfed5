"""How far samplers are from a distribution whose exact denoiser they are given: nothing is trained.

A Gaussian's exact denoiser is affine, and so is then the whole sampler: fed with unit vectors for noise it hands out
the columns of its own matrix, so mean and covariance of what it draws are known without any sampling error. The
mixture of two Gaussians has to be drawn from.
"""

from __future__ import annotations

from itertools import count, product

import numpy as np
from exact_denoisers import Array, Mixture, exact_noise, exact_x0
from lines import Line
from parts import Options, Part

from motiongen.diffusion.samplers import SAMPLERS, Denoiser, Sampler, from_noise
from motiongen.diffusion.schedule import SCHEDULES, Schedule, even_ratios, even_times

DEVIATIONS = (30.0, 10.0, 3.0, 1.0, 0.3, 0.1)
"""Of whole 64-frame clips in normalised features the main directions have deviations from 33, which is the pose of the
whole clip, down to 0.04: one number each for what is decided early and what is decided late."""

PASSES = (5, 10, 20, 50, 200)
GRIDS = {"t": lambda schedule, steps: even_times(steps), "λ": even_ratios}
MODES = Mixture(
    np.array([0.7, 0.3]),
    np.array([[1.5, -0.5, 0.2], [-2.0, 1.0, 0.0]]),
    np.array(
        [
            [[0.36, 0.2, 0.0], [0.2, 0.25, 0.02], [0.0, 0.02, 0.01]],
            [[0.5, -0.1, 0.1], [-0.1, 0.2, 0.0], [0.1, 0.0, 0.3]],
        ]
    ),
)


def samplers(options: Options) -> Part:
    """Errors of every sampler on every schedule and grid, by passes; and what of it is held to a target."""
    spread = np.diag(np.square(DEVIATIONS))
    normal = Mixture(np.ones(1), np.ones((1, len(spread))), spread[None])
    rows = [("schedule", "sampler", "even in", *(f"{n} passes" for n in PASSES))]
    lines = []
    for schedule, (name, sampler) in product(SCHEDULES.values(), SAMPLERS.items()):
        denoise, noise = exact_x0(normal, schedule), from_noise(exact_noise(normal, schedule), schedule)
        errors = {}
        for grid, times in GRIDS.items():
            found = [transfer(sampler, denoise, schedule, times(schedule, n), len(spread)) for n in PASSES]
            errors[grid] = [error(mean, covariance) for mean, covariance in found]
            rows.append((schedule.name, name, grid, *(f"{100 * e:.2g} %" for e in errors[grid])))
        at = f"{name}, {schedule.name}"
        lines.append(
            Line("samplers", f"{at}: error at {PASSES[-1]} passes", min(e[-1] for e in errors.values()), 0.03, False)
        )
        other = transfer(sampler, noise, schedule, even_times(50), len(spread))
        same = transfer(sampler, denoise, schedule, even_times(50), len(spread))
        apart = max(float(np.abs(a - b).max()) for a, b in zip(same, other, strict=True))
        lines.append(Line("samplers", f"{at}: predicting x_0 and noise, apart", apart, 1e-6, False))
        if name == "dpm-solver-2m":
            gain = errors["λ"][1] / errors["t"][1]
            lines.append(Line("samplers", f"{at}: 10 passes, λ over t", gain, 1.0, False))
    return Part(tuple(rows), (*lines, *mixture(5_000 if options.quick else 10_000)))


def transfer(
    sampler: Sampler, denoise: Denoiser, schedule: Schedule, times: list[float], width: int
) -> tuple[Array, Array]:
    """Mean (width,) and covariance (width, width) that a sampler draws with an affine denoiser, exactly."""
    fresh = count()

    def draw() -> Array:
        """Row 0 gets no noise; of the others each draw has its own, and they get a unit vector each."""
        first = 1 + width * next(fresh)
        noise = np.zeros((1 + width * (len(times) - 1), width))
        noise[first : first + width] = np.eye(width)
        return noise

    x = sampler(denoise, draw, schedule, times)
    gains = x[1:] - x[0]
    return x[0], gains.T @ gains


def error(mean: Array, covariance: Array) -> float:
    """Of means that should be 1 and deviations that should be `DEVIATIONS`: RMS, relative to these deviations."""
    off = np.array([mean - 1, np.sqrt(np.diag(covariance)) - DEVIATIONS]) / DEVIATIONS
    return float(np.sqrt(np.mean(np.sum(off**2, axis=0))))


def mixture(clips: int) -> list[Line]:
    """Moments of samples of `MODES`, how many standard errors they are off at most."""
    lines = []
    for schedule, (name, sampler), predicted in product(SCHEDULES.values(), SAMPLERS.items(), ("x_0", "noise")):
        exact = exact_x0(MODES, schedule)
        denoise = exact if predicted == "x_0" else from_noise(exact_noise(MODES, schedule), schedule)
        times = even_ratios(schedule, 50 if name == "dpm-solver-2m" else 500)
        random = np.random.default_rng(0)
        x = sampler(denoise, lambda random=random: random.standard_normal((clips, 3)), schedule, times)
        off = float(np.max(standard_errors(x)))
        lines.append(Line("mixture", f"{name}, {schedule.name}, {predicted}: in standard errors", off, 4.5, False))
    return lines


def standard_errors(x: Array) -> Array:
    """By how many standard errors the mean and the covariance of samples (N, 3) of `MODES` are off: (12,)."""
    mean, spread = MODES.moments()
    products = (x - mean)[:, :, None] * (x - mean)[:, None, :]
    both = np.concatenate([x, products.reshape(len(x), -1)], axis=1)
    return np.abs(both.mean(0) - np.concatenate([mean, spread.ravel()])) / (both.std(0) / np.sqrt(len(x)))
