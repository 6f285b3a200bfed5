"""What a trained transformer needs to run, in numpy: no torch is loaded to generate.

Weights are plain dicts of float32 arrays under the names that training gave them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Tensors = dict[str, Floats]

SMALL = 100**3  # multiplications of a product
WIDEST = 64  # columns of a panel


def linear(x: Floats, w: Tensors, name: str) -> Floats:
    """x·Wᵀ + b over the last axis, for W (out, in) as it is or `in_panels`."""
    matrix, rows = w[f"{name}.weight"], x.reshape(-1, x.shape[-1])
    if matrix.ndim == 2:
        flat = rows @ matrix.T  # one product: numpy would make one of every row of a batch
    else:
        made = np.empty((len(rows), len(matrix), matrix.shape[-1]), np.float32)
        np.matmul(rows, matrix, out=made.swapaxes(0, 1))
        flat = made.reshape(len(rows), -1)
    flat += w[f"{name}.bias"]
    return flat.reshape(*x.shape[:-1], flat.shape[-1])


def in_panels(w: Tensors, rows: int) -> Tensors:
    """`w` with the matrices (out, in) of its linear layers as (out / n, in, n), for inputs of `rows` rows.

    Few rows take as long as it takes BLAS to bring the matrix into an order of its own, at every product. Products of
    less than `SMALL` multiplications OpenBLAS makes without, on processors with AVX-512: there it takes half as long,
    and no longer elsewhere.
    """
    out = dict(w)
    for name in [name.removesuffix(".bias") for name in w if name.endswith(".bias")]:
        matrix = w[f"{name}.weight"]
        if matrix.ndim == 2:
            wide = min(WIDEST, SMALL // (rows * matrix.shape[1]))
            wide = next(n for n in range(wide, 0, -1) if len(matrix) % n == 0)
            out[f"{name}.weight"] = np.ascontiguousarray(matrix.reshape(-1, wide, matrix.shape[1]).swapaxes(1, 2))
    return out


def layer_norm(x: Floats, w: Tensors, name: str, eps: float = 1e-5) -> Floats:
    """Zero mean and unit variance over the last axis, then scaled and shifted (Ba et al. 2016)."""
    share = np.float32(1 / x.shape[-1])
    x = (x - np.add.reduce(x, -1, keepdims=True) * share).astype(np.float32, copy=False)
    x *= 1 / np.sqrt(np.einsum("...i,...i->...", x, x)[..., None] * share + np.float32(eps))
    x *= w[f"{name}.weight"]
    x += w[f"{name}.bias"]
    return x


def gelu(x: Floats) -> Floats:
    """x·Φ(x) = max(x, 0) − |x|·erfc(|x|/√2)/2, with the error function by Abramowitz & Stegun 7.1.26, whose error of
    1.5e-7 is float32's own."""
    size = np.abs(x)
    t = size * np.float32(0.3275911 / math.sqrt(2))
    t += 1
    np.reciprocal(t, out=t)
    tail = t * np.float32(1.061405429)  # in place from here on: new arrays take longer than the arithmetic
    for term in (-1.453152027, 1.421413741, -0.284496736, 0.254829592):
        tail += np.float32(term)
        tail *= t
    tail *= size
    tail *= np.float32(0.5)
    bell = x * x
    bell *= np.float32(-0.5)
    tail *= np.exp(bell, out=bell)
    size += x
    size *= np.float32(0.5)
    size -= tail
    return size


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
