"""At which noise levels a network is to learn, and how much an error counts there; for the cosine schedule and x_0.

Even in t with the same weight for all, as published, nearly all of the loss is at the noisiest levels and most of that
nothing can take away; what is small or rare in a motion is then learnt after hundreds of thousands of steps.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from motiongen.diffusion.schedule import OFFSET

NOISIEST = -5.0  # λ = log(α/σ) down to which there are more levels


def balanced_times(share: Tensor) -> Tensor:
    """Times t (B,) in [0, 1] for numbers `share` (B,) drawn evenly from [0, 1).

    Half are even in t, the other half even in λ from 0 down to NOISIEST: what moves furthest, as the whole body does,
    shows through the noise there already, so there it is settled when a thing is done, and how often.
    """
    signal = torch.sigmoid(2 * NOISIEST * (2 * share - 1).clamp(min=0)).sqrt()  # α² = 1/(1 + exp(−2λ))
    start = math.cos(OFFSET / (1 + OFFSET) * math.pi / 2)
    t = (signal * start).acos() * (2 / math.pi) * (1 + OFFSET) - OFFSET
    return torch.where(share < 0.5, 2 * share, t)


def balanced_weights(t: Tensor) -> Tensor:
    """How much an error counts at times `t` (B,): less where it is large anyway; 1 on average over all t."""
    return 1 / ((0.3 + t**3) * _MEAN)


_MEAN = sum(1 / (0.3 + ((i + 0.5) / 1000) ** 3) for i in range(1000)) / 1000
