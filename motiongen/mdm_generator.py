"""The generator in the tree: text encoder, diffusion and features put together."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from motiongen.bvh import BANDAI_NAMCO
from motiongen.diffusion import SAMPLERS, Denoiser, guided
from motiongen.features import FPS, HEIGHT, features_to_motion
from motiongen.generator import Familiarity, check_prompt
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source
from motiongen.text import TextEncoder
from motiongen.weights import FOLDER, load_weights, nearest

WINDOW = 180  # frames: the longest stretch the model was trained on
OVERLAP = 36  # frames of the last window that the next one is made to go on from


class MdmGenerator:
    """MDM with the weights in the tree, or those at `path`. Raises WeightsError, ModuleNotFoundError."""

    name = "mdm"

    def __init__(self, path: Path | None = None, *, sampler: str = "dpm-solver-2m", steps: int = 10) -> None:
        self._weights = load_weights(path or FOLDER / "mdm.safetensors")
        self._encoder = TextEncoder()
        self._sample, self._steps = SAMPLERS[sampler], steps
        self.licence, self.digest = self._weights.licence, self._weights.digest

    def familiarity(self, text: str) -> Familiarity:
        """How close `text` is to the training captions; raises PromptError for a text that nobody could follow."""
        _, _, sentence = self._encoder([check_prompt(text)])
        bank = self._weights.bank
        best = nearest(bank, sentence[0])
        names = tuple(bank.contents[i].replace("-", " ") for _, i in best[:3])
        return Familiarity(best[0][0] >= bank.known, best[0][0], names)

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """Motion for `text`; see `Generator`. Raises PromptError, ValueError for a guidance that is not finite."""
        return self.generate_batch([text], seconds=seconds, seed=seed, guidance=guidance)[0]

    @torch.inference_mode()
    def generate_batch(
        self, texts: list[str], *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> list[Motion]:
        """One motion a text, drawn together; text i of a batch is drawn from seed + i."""
        scale = 2.5 if guidance is None else guidance
        if not math.isfinite(scale):
            raise ValueError(f"guidance must be a number, not {guidance}")
        texts = [check_prompt(t, seconds) for t in texts]
        words, word_mask, sentence = self._encoder(texts)
        counts = [round((seconds or self._usual_seconds(s)) * FPS) for s in sentence]
        x = self._draw(words, word_mask, sentence, counts, [seed + i for i in range(len(texts))], scale)
        return [self._motion(x[i, :n], texts[i], seed + i) for i, n in enumerate(counts)]

    def _usual_seconds(self, sentence: Tensor) -> float:
        bank = self._weights.bank
        return bank.seconds[nearest(bank, sentence)[0][1]]

    def _draw(
        self, words: Tensor, mask: Tensor, sentence: Tensor, counts: list[int], seeds: list[int], scale: float
    ) -> Tensor:
        """Normalised features (B, T, 140): the first window, then windows that go on from the one before."""
        patch, width = self._weights.model.config.patch, len(self._weights.mean)
        total = patch * math.ceil(max(counts) / patch)
        length = min(total, WINDOW)
        count = 1 + math.ceil(max(0, total - length) / (length - OVERLAP))
        random = [torch.Generator().manual_seed(s) for s in seeds]
        done = torch.zeros(len(seeds), 0, width)
        for window in range(count):
            noise = torch.stack([torch.randn(length, width, generator=g) for g in random])
            known = done[:, -OVERLAP:] if window else done
            left = torch.tensor(counts) - (done.shape[1] - known.shape[1])
            frames = torch.arange(length) < left[:, None].clamp(min=patch)
            denoise = self._denoiser(words, mask, sentence, frames, known, scale)
            done = torch.cat([done[:, : done.shape[1] - known.shape[1]], self._sample(denoise, noise, self._steps)], 1)
        return done[:, :total]

    def _denoiser(
        self, words: Tensor, mask: Tensor, sentence: Tensor, frames: Tensor, known: Tensor, scale: float
    ) -> Denoiser:
        """Guided estimate of x_0 with the known first frames written over it at every pass (MDM, Sec. 3)."""
        said = tuple(torch.cat([y, y]) for y in (frames, words, mask, sentence))

        def conditional(x: Tensor, t: Tensor, keep: Tensor) -> Tensor:
            return self._weights.model(x, t, *said, keep)

        inner = guided(conditional, scale)

        def denoise(x: Tensor, t: Tensor) -> Tensor:
            x0 = inner(x, t)
            return torch.cat([known, x0[:, known.shape[1] :]], dim=1)

        return denoise

    def _motion(self, x: Tensor, text: str, seed: int) -> Motion:
        w = self._weights
        features = (x * w.std + w.mean).numpy().astype(float)
        skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, w.offsets.numpy().astype(float), BANDAI_NAMCO.foot_height)
        features = _smooth(features)
        source = Source(f"{self.name} {w.digest}", w.digest, seed, w.licence)
        label = Label(0.0, (len(features) - 1) / FPS, text)
        motion = features_to_motion(features, skeleton, labels=(label,), source=source)
        features[:, HEIGHT] -= _sunk(motion)
        return features_to_motion(features, skeleton, labels=(label,), source=source)


def _smooth(features: np.ndarray) -> np.ndarray:
    """Binomial smoothing over five frames, which takes away what jitters faster than people can (over ~8 Hz)."""
    kernel = np.array([1, 4, 6, 4, 1]) / 16
    padded = np.concatenate([features[:1]] * 2 + [features] + [features[-1:]] * 2)
    return sum(k * padded[i : i + len(features)] for i, k in enumerate(kernel))


def _sunk(motion: Motion) -> float:
    """Metres by which the lower foot lies too high in most frames (the 20 % quantile: a runner flies in between)."""
    ankle, toe = motion.skeleton.foot_height
    names = motion.skeleton.names
    at = motion.positions()[:, [names.index(n) for n in ("left_ankle", "right_ankle", "left_foot", "right_foot")], 2]
    return float(np.quantile((at - np.array([ankle, ankle, toe, toe])).min(axis=1), 0.2))
