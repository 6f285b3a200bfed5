"""What both networks of diffusion are given in tests, in torch and in numpy."""

import numpy as np
import torch
from numpy.typing import NDArray

from motiongen.diffusion.said import Said
from motiongen.nn import Floats


def inputs(features: int, length: int = 24) -> dict[str, torch.Tensor]:
    g = torch.Generator().manual_seed(1)
    return {
        "x": torch.randn(2, length, features, generator=g),
        "t": torch.tensor([0.3, 0.8]),
        "frames": torch.ones(2, length, dtype=torch.bool),
        "words": torch.randn(2, 5, 16, generator=g),
        "word_mask": torch.ones(2, 5, dtype=torch.bool),
        "sentence": torch.randn(2, 16, generator=g),
        "keep": torch.tensor([True, True]),
    }


def in_numpy(given: dict[str, torch.Tensor]) -> tuple[Floats, NDArray[np.bool_], Said]:
    """The same as `denoise` takes it: features, which frames are real, and what is said."""
    arrays = {name: tensor.numpy() for name, tensor in given.items()}
    return (
        arrays["x"],
        arrays["frames"],
        Said(arrays["words"], arrays["word_mask"], arrays["sentence"], arrays["keep"], arrays.get("action")),
    )
