"""Draw phase codes by diffusion, and decode what they stand for (DiffusionPhase, Sec. 3.3 and 3.4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from motiongen.diffusion.draw import Drawing
from motiongen.diffusion.said import Said, with_nothing
from motiongen.diffusion.samplers import SAMPLERS, Denoiser, guided, seeded
from motiongen.diffusion.schedule import SCHEDULES, even_ratios
from motiongen.diffusion.weights import Weights, WeightsError
from motiongen.nn import Floats, Tensors
from motiongen.phase.phase_run import Start, decode, denoise
from motiongen.phase.phases import Layout
from motiongen.phase.phrases import Phrase, joined_frames, joined_signals, looped_signals, phrase_of

NETWORK = "diffusionphase"


def layout_of(model: Weights) -> Layout:
    """The layout of a model's codes; raises WeightsError where it is of another network."""
    if model.network != NETWORK:
        raise WeightsError(f"network {model.network!r}; phases are drawn by {NETWORK}")
    return Layout(int(model.sizes["highest"]), int(model.sizes["phases"]), bool(model.sizes["cosine"]))


def draw_phrases(
    model: Weights, layout: Layout, said: Said, start: Start, seeds: Sequence[int], how: Drawing
) -> list[Phrase]:
    """A phrase for each of B conditions, of `start.frames` frames and from `seeds[i]`."""
    noise = seeded(seeds, 1, 1, layout.width)
    schedule = SCHEDULES[model.schedule]
    predict = _predictor(model, layout, with_nothing(said), _twice(start))
    denoiser = guided(predict, how.guidance)
    x = SAMPLERS[how.sampler](denoiser, lambda: noise()[:, 0], schedule, even_ratios(schedule, how.steps))
    codes = x * model.tensors["spread"] + model.tensors["center"]
    return [phrase_of(code, int(n), layout) for code, n in zip(codes, start.frames, strict=True)]


def anywhere(frames: Sequence[int], features: int) -> Start:
    """No start pose, for motions of `frames`."""
    return Start(np.zeros((len(frames), features), np.float32), np.zeros(len(frames), bool), np.array(frames))


def _twice(start: Start) -> Start:
    return Start(*(np.concatenate([each, each]) for each in (start.pose, start.keep, start.frames)))


def _predictor(model: Weights, layout: Layout, said: Said, start: Start) -> Denoiser:
    heads = int(model.sizes["heads"])
    return lambda x, t: denoise(model.tensors, layout, heads, x, t, said, start)


def autoencoder_of(model: Weights) -> Tensors:
    """Tensors of the auto-encoder alone."""
    return {k.removeprefix("autoencoder."): v for k, v in model.tensors.items() if k.startswith("autoencoder.")}


def features_of(model: Weights, layout: Layout, phrases: Sequence[Phrase], dense: int = 1) -> Floats:
    """Normalised features (dense, T, 140) of phrases one after the other, `dense` times as many frames as at 30 a second
    (Suppl. 2): set i is a whole motion at 30 a second, i / dense frames after set 0.

    Raises ValueError unless `dense` is 1 or more.
    """
    if dense < 1:
        raise ValueError(f"dense must be 1 or more, not {dense}")
    w, edge = autoencoder_of(model), margin(model)
    at = np.arange(-edge, joined_frames(phrases) + edge)
    sets = np.stack([joined_signals(phrases, layout, at + i / dense) for i in range(dense)])
    return decode(w, sets)


def pose_of(model: Weights, layout: Layout, phrase: Phrase) -> Floats:
    """Normalised features (140,) of the pose in which the primary segment of a phrase begins and ends."""
    edge = margin(model)
    return decode(autoencoder_of(model), looped_signals(phrase, layout, np.arange(-edge, edge + 1))[None])[0, 0]


def margin(model: Weights) -> int:
    """Frames on either side of a stretch that the decoder sees too."""
    kernel = model.tensors["autoencoder.decoder.layers.0.weight"].shape[-1]
    return 4 * (kernel // 2)
