"""What keeps a standing body from looking like a statue: breath, and small slow drifts of every joint."""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array

BREATHS = 0.25  # Hz, an adult at rest
CHEST, SHOULDERS = 0.012, 0.015  # rad each breath
SWAY = 0.003  # m of the pelvis
DRIFTS = (0.13, 0.31, 0.57)  # Hz, about


def breath(count: int, fps: float, rng: np.random.Generator) -> Array:
    """(T,) from 0, out, to 1, in; the phase is drawn."""
    phase = rng.uniform(0, 2 * np.pi)
    return 0.5 - 0.5 * np.cos(2 * np.pi * BREATHS * np.arange(count) / fps + phase)


def drift(count: int, fps: float, size: float, rng: np.random.Generator) -> Array:
    """(T, 3) of about ±`size`, in its unit: three slow waves an axis, slower ones larger, frequency and phase drawn."""
    t = np.arange(count)[:, None] / fps
    out = np.zeros((count, 3))
    for i, usual in enumerate(DRIFTS):
        rate, phase = usual * rng.uniform(0.8, 1.2, 3), rng.uniform(0, 2 * np.pi, 3)
        out += size / (i + 2) * np.sin(2 * np.pi * rate * t + phase)
    return out
