"""What a trained transformer needs to run, in numpy: no torch is loaded to generate.

Weights are plain dicts of float32 arrays under the names that training gave them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Tensors = dict[str, Floats]


def linear(x: Floats, w: Tensors, name: str) -> Floats:
    """x·Wᵀ + b over the last axis."""
    matrix = w[f"{name}.weight"]
    flat = x.reshape(-1, x.shape[-1]) @ matrix.T  # one product: numpy would make one of every row of a batch
    flat += w[f"{name}.bias"]
    return flat.reshape(*x.shape[:-1], len(matrix))


def layer_norm(x: Floats, w: Tensors, name: str, eps: float = 1e-5) -> Floats:
    """Zero mean and unit variance over the last axis, then scaled and shifted (Ba et al. 2016)."""
    x = x - x.mean(-1, keepdims=True)
    return x / np.sqrt((x * x).mean(-1, keepdims=True) + eps) * w[f"{name}.weight"] + w[f"{name}.bias"]


def gelu(x: Floats) -> Floats:
    """x·Φ(x), with the error function by Abramowitz & Stegun 7.1.26, whose error of 1.5e-7 is float32's own."""
    z = np.abs(x) * np.float32(1 / math.sqrt(2))
    t = 1 / (1 + np.float32(0.3275911) * z)
    poly = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    erf = np.copysign(1 - poly * np.exp(-z * z), x)
    return (0.5 * x * (1 + erf)).astype(np.float32)


def silu(x: Floats) -> Floats:
    """x·sigmoid(x)."""
    return x / (1 + np.exp(-x))


def attention(q: Floats, k: Floats, v: Floats, mask: NDArray[np.bool_], heads: int) -> Floats:
    """Scaled dot-product attention (Vaswani et al. 2017, Eq. 1) in `heads` heads.

    `q` (B, N, width), `k` and `v` (B, M, width), `mask` (B, M): which of the source is listened to.
    """
    batch, count, width = q.shape
    q, k, v = (y.reshape(batch, y.shape[1], heads, width // heads).swapaxes(1, 2) for y in (q, k, v))
    score = q @ k.swapaxes(-1, -2) / np.float32(math.sqrt(width // heads))
    score = np.where(mask[:, None, None], score, np.float32(-np.inf))
    weight = np.exp(score - score.max(-1, keepdims=True))
    weight /= weight.sum(-1, keepdims=True)
    return (weight @ v).swapaxes(1, 2).reshape(batch, count, width)


def waves(at: Floats, width: int) -> Floats:
    """Sinusoidal embedding (…, width) of numbers (…) (Vaswani et al. 2017, Sec. 3.5)."""
    rate = np.exp(np.arange(width // 2, dtype=np.float32) * np.float32(-math.log(10000.0) / (width // 2)))
    angle = at[..., None].astype(np.float32) * rate
    return np.concatenate([np.sin(angle), np.cos(angle)], axis=-1)
