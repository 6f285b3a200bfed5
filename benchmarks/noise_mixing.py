"""Noise interpolation (MotionDiffuse, Eq. 10 and 11): are the sums and the corrections what the equations say?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from lines import Line
from numpy.typing import NDArray
from parts import Options, Part

from motiongen.diffusion.mixing import Span, mix_parts, mix_times, shares

Array = NDArray[np.floating]
Pair = tuple[int, int, slice]

SHAPE = (2, 180, 140)  # two clips of six seconds
PARTS = np.arange(140) // 50 == np.arange(3)[:, None]
INTERVALS = ((0, 70), (50, 120), (100, 180))
LAMBDAS = (0.01, 0.1, 1.0, 10.0)  # the first is the paper's


def mixing(options: Options) -> Part:
    """Differences from the masked sum and from autograd's gradient of the norms, and how much a correction moves."""
    eps = list(np.random.default_rng(0).standard_normal((len(PARTS), *SHAPE)))
    cut = sum(e * m for e, m in zip(eps, PARTS, strict=True))
    pairs = [(i, j, slice(None)) for i in range(3) for j in range(3) if i != j]
    by_each = slopes(eps, pairs)
    rows = [("λ₁", "deviation of the change, that of the noise being 1")]
    worst = 0.0
    for lam in LAMBDAS:
        mixed = mix_parts(eps, PARTS, lam)
        stated = cut + lam * sum(g * m for g, m in zip(by_each, PARTS, strict=True))
        worst = max(worst, float(np.abs(mixed - stated).max()))
        rows.append((f"{lam:g}", f"{(mixed - cut).std():.2g}"))
    alone = mix_parts(eps[:1], np.ones((1, SHAPE[-1]), bool), 1.0) - eps[0]
    return Part(
        tuple(rows),
        (
            Line("mixing", "Eq. 10: from the gradient by autograd", worst, 1e-10, False),
            Line("mixing", "Eq. 10, λ = 0: from the masked sum", _most(mix_parts(eps, PARTS, 0.0) - cut), 0.0, False),
            Line("mixing", "Eq. 10, one part that is the body: from the model", _most(alone), 0.0, False),
            Line("mixing", "Eq. 11: from the gradient by autograd", _times_off(eps), 1e-5, False),
        ),
    )


def slopes(noises: Sequence[Array], pairs: Sequence[Pair]) -> list[Array]:
    """Autograd's gradient of Σ‖ε_i − ε_j‖ by each ε (B, T, F); a pair is i, j and the frames of which it is the norm,
    which is a clip's."""
    leaves = [torch.from_numpy(e).requires_grad_() for e in noises]
    norms = [(leaves[i][:, at] - leaves[j][:, at]).flatten(1).norm(dim=1).sum() for i, j, at in pairs]
    return [slope.numpy() for slope in torch.autograd.grad(torch.stack(norms).sum(), leaves)]


def _times_off(eps: Sequence[Array]) -> float:
    total = SHAPE[1]
    spans = [Span(start, stop, np.ones(SHAPE[-1], bool)) for start, stop in INTERVALS]
    pads = [((s.start, total - s.stop), (0, 0)) for s in spans]
    cut = [e[:, s.start : s.stop] for e, s in zip(eps, spans, strict=True)]
    weights = [np.pad(y, pad) for y, pad in zip(shares(spans, total), pads, strict=True)]
    padded = [np.pad(e, ((0, 0), *pad)) for e, pad in zip(cut, pads, strict=True)]
    overlaps = [(i, i + 1, slice(INTERVALS[i + 1][0], INTERVALS[i][1])) for i in range(len(INTERVALS) - 1)]
    by_each = slopes(padded, overlaps + [(j, i, at) for i, j, at in overlaps])
    stated = sum(w * (e + 0.5 * g) for w, e, g in zip(weights, padded, by_each, strict=True))
    return _most(mix_times(cut, INTERVALS, 0.5) - stated)


def _most(x: Array) -> float:
    return float(np.abs(x).max())
