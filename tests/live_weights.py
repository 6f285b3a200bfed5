"""The weights file of a small live network that has learnt nothing, for tests of what is built around it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from motiongen.diffusion.configs import MdmConfig
from motiongen.diffusion.lengths import HIDDEN
from motiongen.diffusion.mdm import Mdm
from motiongen.diffusion.weights import Bank, Weights, save_weights
from motiongen.features import HEIGHT, TURNS, WIDTH
from motiongen.gestures.body import BODY
from motiongen.text.encoder import TextEncoder

SIZES = MdmConfig(width=32, layers=1, heads=2, feed_forward=32, history=30, steering=12)
CHUNK = 48
SAID = {"idle": "stand idle", "wave": "wave with the right hand", "walk": "walk forward", "nod": "nod"}


def live_weights(path: Path) -> Path:
    """Write the file and tell where it is: poses near a T-pose, prompts of 1 s."""
    torch.manual_seed(0)
    mean, std = np.zeros(WIDTH, np.float32), np.full(WIDTH, 0.1, np.float32)
    mean[TURNS], mean[HEIGHT] = np.tile([1, 0, 0, 0, 1, 0], 22), 0.93
    lengths = {
        f"lengths.{i}.{kind}": np.zeros(shape, np.float32)
        for i, kind, shape in (
            (0, "weight", (HIDDEN, 384)),
            (0, "bias", HIDDEN),
            (2, "weight", (1, HIDDEN)),
            (2, "bias", 1),
        )
    }
    vectors = TextEncoder()(list(SAID.values()))[2]
    made = Weights(
        tensors={k: v.detach().numpy() for k, v in Mdm(SIZES).state_dict().items()},
        network="mdm",
        sizes=vars(SIZES),
        schedule="cosine",
        prediction="x0",
        unconditioned=True,
        actions=(),
        window=SIZES.history + CHUNK,
        mean=mean,
        std=std,
        offsets=BODY.offsets.astype(np.float32),
        lengths=lengths,
        bank=Bank(vectors, tuple(range(len(SAID))), tuple(SAID), 0.5),
        licence="none",
        training={},
        digest="",
    )
    save_weights(made, path)
    return path
