"""Draw features with a trained network: its passes over stretches of time and parts of the body, guided and mixed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion import mdm_run, mixing, motiondiffuse_run
from motiongen.diffusion.bodies import Body, bodies_of, followed
from motiongen.diffusion.meeting import Meeting, meetings, mixed_turns
from motiongen.diffusion.said import Said, with_nothing
from motiongen.diffusion.samplers import SAMPLERS, Denoiser, Samples, from_noise, guided, seeded
from motiongen.diffusion.schedule import SCHEDULES, even_ratios
from motiongen.diffusion.weights import Weights, WeightsError
from motiongen.features import TURNS
from motiongen.nn import Floats

OVERLAP = 30  # frames that two windows of one long text share
FADE = 12  # frames in which one pass goes over into the next: the longer, the more it draws of what is not its own
GUIDANCE = 1.5  # more of it overdoes what a text says: turns on the way go too far
LAM_PARTS, LAM_TIMES = 0.01, 0.01  # λ₁ of Eq. 10 and λ₂ of Eq. 11 (Zhang et al. 2022)

Constraint = Callable[[Denoiser], Denoiser]
NETWORKS: dict[str, Callable[..., Floats]] = {"mdm": mdm_run.denoise, "motiondiffuse": motiondiffuse_run.denoise}
_PREDICTIONS = ("x0", "noise")


@dataclass(frozen=True)
class Drawing:
    """How to draw: the name of the sampler, its passes, the scale of guidance, λ₁ of Eq. 10, and whether parts of the
    body are drawn on bodies of their own (see `bodies.py`)."""

    sampler: str
    steps: int
    guidance: float
    lam_parts: float = LAM_PARTS
    own_bodies: bool = True


@dataclass(frozen=True)
class Pass:
    """A pass of the network over the frames of `span` of every clip of a batch, told `said`; its estimate counts for
    the features of `span`."""

    said: Said
    span: mixing.Span


def require_known(model: Weights, name: str) -> None:
    """Raise WeightsError, naming the file `name`, where nobody here knows the network or what it estimates."""
    for what, value, known in (
        ("network", model.network, NETWORKS),
        ("schedule", model.schedule, SCHEDULES),
        ("prediction", model.prediction, _PREDICTIONS),
    ):
        if value not in known:
            raise WeightsError(f"{name}: {what} {value!r}; this rigcast knows {', '.join(known)}")


def require_whole(model: Weights, name: str) -> None:
    """Raise WeightsError, naming the file `name`, for a network that goes on from a history."""
    if model.sizes.get("history"):
        raise WeightsError(f"{name}: goes on from a history, for a live generator; it draws no whole clips")


def passes_over(model: Weights, said: Said, start: int, stop: int, columns: NDArray[np.bool_]) -> list[Pass]:
    """One pass over the frames from `start` to `stop`, a multiple of the patch apart, or windows that overlap."""
    stride = patched(model, model.window - OVERLAP)
    starts = range(start, max(start + 1, stop - OVERLAP), stride)
    told = bool(said.keep.any())
    return [Pass(said, mixing.Span(a, min(a + model.window, stop), columns, told)) for a in starts]


def whole(model: Weights, said: Said, count: int) -> list[Pass]:
    """Passes over all features of clips of up to `count` frames."""
    return passes_over(model, said, 0, patched(model, count), np.ones(len(model.mean), bool))


def patched(model: Weights, count: int) -> int:
    """The least multiple of the patch that is not below `count`."""
    patch = int(model.sizes["patch"])
    return patch * math.ceil(count / patch)


def draw(
    model: Weights,
    passes: Sequence[Pass],
    counts: Sequence[int],
    seeds: Sequence[int],
    how: Drawing,
    constrain: Constraint | None = None,
) -> Floats:
    """Normalised features (B, T, 140) of B clips of `counts` (B,) frames, clip i from `seeds[i]`.

    The passes must cover all features of all T frames. `constrain` may change the estimate of the clean features every
    time (MDM, Sec. 3, Editing). Raises ValueError for passes that leave a gap.
    """
    total = max(each.span.stop for each in passes)
    bodies = bodies_of([each.span for each in passes], FADE) if how.own_bodies else []
    noise = seeded([*seeds] * (1 + len(bodies)), max(total, model.window), total, len(model.mean))
    schedule = SCHEDULES[model.schedule]
    times = even_ratios(schedule, how.steps)
    denoise = _together(model, passes, np.array(counts), how, bodies)
    drawn = SAMPLERS[how.sampler](constrain(denoise) if constrain else denoise, noise, schedule, times)
    return cast("Floats", drawn[: len(seeds)])


def _together(
    model: Weights, passes: Sequence[Pass], counts: NDArray[np.int_], how: Drawing, bodies: Sequence[Body]
) -> Denoiser:
    """Estimate of x_0 of all passes: of several, their estimates of the noise mixed, and of joints that two of them
    turn at the same time, the turns. It is of ((1 + bodies)·B, T, 140): the mixture, then each of `bodies`."""
    schedule = SCHEDULES[model.schedule]
    clean = [_predictor(model, each, counts, how.guidance) for each in passes]
    if model.prediction == "noise":
        clean = [from_noise(each, schedule) for each in clean]
    if len(passes) == 1:
        return clean[0]
    spans = [each.span for each in passes]
    share = mixing.shares(spans, FADE)
    shared = meetings(spans, share)

    def mixed(samples: Samples, t: float) -> Samples:
        alpha, sigma = schedule.signal_and_noise(t)
        x, *others = np.split(samples, 1 + len(bodies))
        own = {k: other for body, other in zip(bodies, others, strict=True) for k in body.voices}
        seen = [own.get(k, x)[:, s.start : s.stop] for k, s in enumerate(spans)]
        estimates = [each(y, t) for each, y in zip(clean, seen, strict=True)]
        noises = [(x[:, s.start : s.stop] - alpha * x0) / sigma for x0, s in zip(estimates, spans, strict=True)]
        out = (x - sigma * mixing.mix(noises, spans, share, how.lam_parts, LAM_TIMES)) / alpha
        for meeting in shared:
            _turn(out, model, meeting, [(estimates[k], spans[k].start) for k in meeting.voices])
        return np.concatenate([out, *(followed(body, out, estimates, spans) for body in bodies)])

    return mixed


def _turn(x0: Floats, model: Weights, meeting: Meeting, said: Sequence[tuple[Floats, int]]) -> None:
    """Puts turns mixed as turns into `x0` (B, T, 140), where those `meeting` say each an estimate from a frame on."""
    mean, std = model.mean[TURNS], model.std[TURNS]
    several = np.repeat((meeting.share > 0).sum(0) > 1, 6, axis=1)
    for b in range(len(x0)):
        there = [x[b, meeting.start - start : meeting.stop - start, TURNS] * std + mean for x, start in said]
        turned = (mixed_turns(there, meeting.share) - mean) / std
        here = x0[b, meeting.start : meeting.stop, TURNS]
        here[several] = turned[several]


def _predictor(model: Weights, each: Pass, counts: NDArray[np.int_], scale: float) -> Denoiser:
    """What the network itself estimates in one pass: guided, or of a model that always hears something, as it is."""
    guides = each.span.told and model.unconditioned
    said = with_nothing(each.said) if guides else each.said
    start, stop = each.span.start, each.span.stop
    sizes = {name: int(model.sizes[name]) for name in ("patch", "heads")}
    frames = np.arange(stop - start) < np.maximum(counts[:, None] - start, sizes["patch"])
    frames = np.concatenate([frames, frames]) if guides else frames

    def predict(x: Floats, t: float) -> Floats:
        return NETWORKS[model.network](model.tensors, sizes, x, t, frames, said)

    return guided(predict, scale) if guides else predict
