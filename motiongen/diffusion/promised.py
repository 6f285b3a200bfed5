"""What a text says in degrees of a turn is put into the motion at every pass, and not only hoped for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from motiongen.diffusion.constraints import with_total
from motiongen.diffusion.draw import Constraint
from motiongen.diffusion.weights import Weights
from motiongen.features import FPS, YAW
from motiongen.text.asking import asked_of


def turn_asked(text: str) -> float:
    """Radians, left positive, by which `text` wants the body to turn, where it asks for that alone; else nan."""
    asked = asked_of(text)
    claim = asked.claims[0] if asked and len(asked.claims) == 1 else None
    if claim is None or claim.action != "turn" or claim.degrees is None or claim.side not in ("left", "right"):
        return np.nan
    return float(np.radians(claim.degrees)) * (1 if claim.side == "left" else -1)


def turning(model: Weights, texts: Sequence[str], counts: Sequence[int]) -> Constraint | None:
    """Makes clip i of `counts[i]` frames turn as `texts[i]` says; None where no text says how far.

    The correction is laid over the middle of the clip, so that it begins and ends at rest.
    """
    turns = np.array([turn_asked(text) for text in texts])
    if np.isnan(turns).all():
        return None
    patch = int(model.sizes["patch"])
    length = patch * max(-(-count // patch) for count in counts)
    at, number = np.arange(length), np.array(counts)[:, None]
    frames = at < number
    weights = np.where(frames, np.sin(np.pi * np.minimum((at + 0.5) / number, 1.0)) ** 2, 0.0)
    total = (turns * FPS - number[:, 0] * float(model.mean[YAW])) / float(model.std[YAW])
    return lambda denoise: with_total(denoise, YAW, frames, total, weights)
