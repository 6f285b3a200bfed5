"""What a network in training draws for a few fixed captions, so that one can see how far it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from motiongen.data.dataset import Dataset
from motiongen.data.texts import Texts
from motiongen.diffusion.batches import LONGEST, Scale
from motiongen.diffusion.configs import TrainConfig
from motiongen.diffusion.draw import GUIDANCE
from motiongen.diffusion.samplers import Denoiser, dpm_solver_2m, from_noise, guided
from motiongen.diffusion.schedule import SCHEDULES, even_ratios
from motiongen.features import FPS, features_to_motion
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source

COUNT = 4
PASSES = 20


@dataclass(frozen=True)
class Prompts:
    """Captions of training clips, what the encoder makes of them (see `Texts.batch`), and how long the clips are."""

    captions: tuple[str, ...]
    said: tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]
    counts: NDArray[np.int_]
    foot_height: tuple[float, float]


def pick_prompts(data: Dataset, texts: Texts, seed: int) -> Prompts:
    """Captions of `COUNT` training clips, of as many contents as there are; the same for the same seed and data."""
    rows = [i for i, e in enumerate(data.entries) if e.split == "train" and e.captions[0] in texts.place]
    order = np.random.default_rng(seed).permutation(rows).tolist()
    contents = dict.fromkeys(data.entries[i].content for i in order)
    firsts = [next(i for i in order if data.entries[i].content == content) for content in contents]
    chosen = [data.entries[i] for i in list(dict.fromkeys([*firsts, *order]))[:COUNT]]
    captions = tuple(e.captions[0] for e in chosen)
    counts = np.array([min(e.frames, LONGEST) for e in chosen])
    return Prompts(captions, texts.batch(captions), counts, chosen[0].foot_height)


@torch.no_grad()
def draw_samples(
    network: Callable[..., Tensor], prompts: Prompts, config: TrainConfig, scale: Scale, device: torch.device
) -> list[Motion]:
    """A motion for each caption, as the `network` draws it: nothing is smoothed or put onto the floor."""
    schedule, patch = SCHEDULES[config.schedule], config.model.patch
    length = patch * math.ceil(prompts.counts.max() / patch)
    frames = np.arange(length) < prompts.counts[:, None]
    noise = np.random.default_rng(config.seed).standard_normal((*frames.shape, len(scale.mean)), np.float32)
    predict = _predictor(network, prompts, frames, device)
    if config.drop_text > 0:  # else it knows nothing of "no text" that it could be guided away from
        predict = guided(predict, GUIDANCE)
    denoise = predict if config.prediction == "x0" else from_noise(predict, schedule)
    x = dpm_solver_2m(denoise, lambda: noise, schedule, even_ratios(schedule, PASSES)) * scale.std + scale.mean
    skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, scale.offsets.astype(float), prompts.foot_height)
    return [
        features_to_motion(
            clip[:count].astype(float),
            skeleton,
            labels=(Label(0.0, (count - 1) / FPS, caption),),
            source=Source("training"),
        )
        for clip, count, caption in zip(x, prompts.counts, prompts.captions, strict=True)
    ]


def _predictor(
    network: Callable[..., Tensor], prompts: Prompts, frames: NDArray[np.bool_], device: torch.device
) -> Denoiser:
    """The network on arrays of one batch (B, …), or of two of which the second hears no text (2 B, …)."""

    def predict(x: NDArray[np.float32], t: float) -> NDArray[np.float32]:
        keep = np.arange(len(x)) < len(frames)
        same = (np.concatenate([y] * (len(x) // len(frames))) for y in (frames, *prompts.said))
        inputs = (_to(y, device) for y in (x, np.full(len(x), t), *same, keep))
        return network(*inputs).float().cpu().numpy()

    return predict


def _to(y: NDArray[np.generic], device: torch.device) -> Tensor:
    tensor = torch.from_numpy(y).to(device)
    return tensor.float() if tensor.is_floating_point() else tensor
