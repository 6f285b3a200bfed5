"""Draw phrases by diffusion of their codes (DiffusionPhase, Sec. 3.3 and 3.4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from motiongen.diffusion.draw import Drawing
from motiongen.diffusion.said import Said, with_nothing
from motiongen.diffusion.samplers import SAMPLERS, Denoiser, guided, seeded
from motiongen.diffusion.schedule import SCHEDULES, even_ratios
from motiongen.diffusion.weights import Weights, WeightsError
from motiongen.nn import Floats
from motiongen.phase.codec import Codec
from motiongen.phase.phase_run import Start, denoise
from motiongen.phase.phases import Layout
from motiongen.phase.phrases import Phrase, phrase_of

NETWORK = "diffusionphase"


def codec_of(model: Weights) -> Codec:
    """The auto-encoder in a model's weights; raises WeightsError where they are of another network."""
    if model.network != NETWORK:
        raise WeightsError(f"network {model.network!r}; phrases are drawn by {NETWORK}")
    layout = Layout(int(model.sizes["highest"]), int(model.sizes["phases"]), bool(model.sizes["cosine"]))
    own = "autoencoder."
    tensors = {name.removeprefix(own): w for name, w in model.tensors.items() if name.startswith(own)}
    return Codec(tensors, layout, model.mean, model.std, model.offsets)


def draw_phrases(
    model: Weights, layout: Layout, said: Said, start: Start, seeds: Sequence[int], how: Drawing
) -> list[Phrase]:
    """A phrase for each of B conditions, of `start.frames` frames and from `seeds[i]`.

    Guidance goes from what is said to nothing said; the start pose is told in both passes.
    """
    noise = seeded(seeds, 1, 1, layout.width)
    denoiser = guided(_predictor(model, layout, with_nothing(said), _twice(start)), how.guidance)
    schedule = SCHEDULES[model.schedule]
    x = SAMPLERS[how.sampler](denoiser, lambda: noise()[:, 0], schedule, even_ratios(schedule, how.steps))
    codes = x * model.tensors["spread"] + model.tensors["center"]
    return [phrase_of(code, int(n), layout) for code, n in zip(codes, start.frames, strict=True)]


def anywhere(frames: Sequence[int], features: int) -> Start:
    """No start pose, for motions of so many `frames`."""
    return Start(np.zeros((len(frames), features), np.float32), np.zeros(len(frames), bool), np.array(frames))


def _twice(start: Start) -> Start:
    pose, keep, frames = (np.concatenate([each, each]) for each in (start.pose, start.keep, start.frames))
    return Start(pose, keep, frames)


def _predictor(model: Weights, layout: Layout, said: Said, start: Start) -> Denoiser:
    heads = int(model.sizes["heads"])

    def predict(x: Floats, t: float) -> Floats:
        return denoise(model.tensors, layout, heads, x, t, said, start)

    return predict
