"""How long a motion should last, told from the text alone: "clap five times" takes longer than "clap".

A network of two layers reads the sentence vector and gives the logarithm of the seconds; least squares on logarithms
makes it the geometric mean of the clips with such captions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.nn import Floats, Tensors, linear, silu

HIDDEN = 96
STEPS, BATCH = 3000, 256


def usual_seconds(w: Tensors, sentences: Floats) -> NDArray[np.float64]:
    """Usual length in s of clips called what the sentence vectors (N, 384) say; `w` as `fit_lengths` gives it."""
    log = linear(silu(linear(sentences, w, "lengths.0")), w, "lengths.2")
    return np.exp(log[:, 0].astype(float))


def fit_lengths(sentences: Floats, seconds: NDArray[np.float64], seed: int = 0) -> Tensors:
    """Weights of the network for sentence vectors (N, 384) and the length of the clip that each speaks of."""
    import torch

    torch.manual_seed(seed)
    net = torch.nn.Sequential(torch.nn.Linear(sentences.shape[1], HIDDEN), torch.nn.SiLU(), torch.nn.Linear(HIDDEN, 1))
    x, y = torch.from_numpy(sentences), torch.from_numpy(np.log(seconds)).float()[:, None]
    optimizer = torch.optim.AdamW(net.parameters(), lr=3e-3, weight_decay=0.01)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 3e-3, total_steps=STEPS)
    for _ in range(STEPS):
        rows = torch.randint(len(x), (BATCH,))
        optimizer.zero_grad()
        torch.nn.functional.mse_loss(net(x[rows]), y[rows]).backward()
        optimizer.step()
        schedule.step()
    return {f"lengths.{name}": value.detach().numpy() for name, value in net.state_dict().items()}
