"""The networks of `autoencoder.py` and `denoiser.py`, run in numpy. Tests hold them against the torch modules."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.mdm_run import heard, transform
from motiongen.diffusion.said import Said
from motiongen.nn import Floats, Tensors, gelu, linear, silu, waves
from motiongen.phase.phases import Layout, Timing, readings

LENGTH = np.float32(100.0)


@dataclass(frozen=True)
class Start:
    """How each of B motions begins and lasts: `pose` (B, features), normalised, where `keep` (B,) is true; `frames`
    (B,) in all."""

    pose: Floats
    keep: NDArray[np.bool_]
    frames: NDArray[np.int_]


def encode(w: Tensors, layout: Layout, x: Floats, timing: Timing) -> Floats:
    """Codes (B, width) of normalised features `x` (B, T, features), held at their last frame beyond it."""
    edge = w["encoder.narrow.weight"].shape[-1] // 2
    y = _convolution(np.pad(x, ((0, 0), (edge, edge), (0, 0)), mode="edge"), w, "encoder.narrow")
    seen = readings(timing, x.shape[1], layout.highest) @ y
    at = np.array(layout.frequencies)
    mean = np.repeat(seen[:, :1], len(at), axis=1)
    along = np.stack([seen[:, at], seen[:, layout.highest + at], mean], 2) @ w["encoder.waves"]
    ends = [seen[:, rows].reshape(len(x), -1) @ w["encoder.ends.weight"].T for rows in (slice(-4, -2), slice(-2, None))]
    known = np.concatenate([seen.reshape(len(x), -1), timing.shares], 1)
    for i in (0, 2, 4):
        known = gelu(linear(known, w, f"encoder.layers.{i}"))
    code = np.concatenate([along.reshape(len(x), -1), *ends], 1) + linear(known, w, "encoder.layers.6")
    return np.concatenate([code, timing.shares], 1)


def decode(w: Tensors, signal: Floats) -> Floats:
    """Normalised features (B, T, features) of signals (B, T + 2·margin, C)."""
    y = signal
    for i in (0, 2, 4, 6):
        y = _convolution(y if i == 0 else gelu(y), w, f"decoder.layers.{i}")
    edge = (signal.shape[1] - y.shape[1]) // 2
    return linear(signal[:, edge : edge + y.shape[1]], w, "decoder.straight") + y


def denoise(w: Tensors, layout: Layout, heads: int, x: Floats, t: float, said: Said, start: Start) -> Floats:
    """Estimate of x_0 (B, width); arguments as `PhaseDenoiser.forward` has them, with one `t` for the batch."""
    width = len(w["no_pose"])
    sentence = np.where(said.keep[:, None], linear(said.sentence, w, "sentence"), w["no_sentence"])
    words = np.where(said.keep[:, None, None], linear(said.words, w, "word"), w["no_words"])
    pose = np.where(start.keep[:, None], linear(start.pose, w, "pose"), w["no_pose"])
    level = linear(silu(linear(waves(np.full(1, t * 1000.0), width), w, "level.0")), w, "level.2")
    long = waves(np.log(start.frames).astype(np.float32) * LENGTH, width)
    read = [linear(x[:, token], w, f"read.{i}") for i, token in enumerate(layout.tokens)]
    stream = np.stack([level + sentence, pose, long, *read], 1)
    stream = stream + waves(np.arange(stream.shape[1], dtype=np.float32), width)
    mask = np.ones(stream.shape[:2], bool)
    made = transform(w, heads, stream, mask, heard(w, words, said.word_mask))[:, -len(read) :]
    return np.concatenate([linear(made[:, i], w, f"write.{i}") for i in range(len(read))], 1)


def _convolution(x: Floats, w: Tensors, name: str) -> Floats:
    """(B, T − K + 1, out) of `x` (B, T, in): as torch's Conv1d, time before channels, without padding."""
    kernel = w[f"{name}.weight"]
    windows = np.lib.stride_tricks.sliding_window_view(x, kernel.shape[-1], axis=1)
    flat = windows.reshape(*windows.shape[:2], -1)
    return linear(flat, {"at.weight": kernel.reshape(len(kernel), -1), "at.bias": w[f"{name}.bias"]}, "at")
