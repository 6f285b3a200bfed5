"""The denoiser of `mdm.py`, run in numpy. Training checks it against the torch module to float32's own accuracy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.said import Said
from motiongen.nn import Floats, Tensors, attention, gelu, layer_norm, linear, silu, waves


def denoise(
    w: Tensors,
    sizes: Mapping[str, int],
    x: Floats,
    t: float,
    frames: NDArray[np.bool_],
    said: Said,
    steering: Floats | None = None,
) -> Floats:
    """Estimate of x_0 (B, T, features); arguments as `Mdm.forward` has them, with one `t` for the batch.

    `sizes`: the config's `patch` and `heads`.
    """
    patch, heads = sizes["patch"], sizes["heads"]
    batch, length, features = x.shape
    tokens = linear(x.reshape(batch, length // patch, patch * features), w, "read")
    width = tokens.shape[-1]
    if steering is not None:
        tokens = tokens + steering.reshape(batch, length // patch, -1) @ w["steer.weight"].T
    sentence, words = linear(said.sentence, w, "sentence"), linear(said.words, w, "word")
    if said.action is not None:
        act, is_act = w["action.weight"][np.maximum(said.action, 0)], (said.action >= 0)[:, None]
        sentence, words = np.where(is_act, act, sentence), np.where(is_act[:, None], act[:, None], words)
    sentence = np.where(said.keep[:, None], sentence, w["no_sentence"])
    words = np.where(said.keep[:, None, None], words, w["no_words"])
    level = waves(np.full(1, t * 1000.0), width)
    first = linear(silu(linear(level, w, "level.0")), w, "level.2") + sentence
    real = np.any(frames.reshape(batch, -1, patch), axis=2)
    left, to_end = np.maximum(real.sum(1, keepdims=True) - np.arange(tokens.shape[1]), 0), w["to_end.weight"]
    tokens = tokens + waves(left, to_end.shape[1]) @ to_end.T
    stream = np.concatenate([first[:, None], tokens], axis=1) + waves(np.arange(tokens.shape[1] + 1), width)
    mask = np.concatenate([np.ones_like(real[:, :1]), real], axis=1)
    stream = transform(w, heads, stream, mask, words, said.word_mask)
    return linear(stream[:, 1:], w, "write").reshape(batch, length, features)


def transform(
    w: Tensors, heads: int, stream: Floats, mask: NDArray[np.bool_], words: Floats, word_mask: NDArray[np.bool_]
) -> Floats:
    """What the blocks in `w` make of a stream (B, N, width) where `mask` (B, N), normalised; `words` (B, M, width)."""
    block = 0
    while (at := f"blocks.{block}.") + "norms.0.weight" in w:
        y = layer_norm(stream, w, at + "norms.0")
        stream = stream + _attend(w, at + "self_attention", y, y, mask, heads)
        if at + "cross_attention.query.weight" in w:
            y = layer_norm(stream, w, at + "norms.1")
            stream = stream + _attend(w, at + "cross_attention", y, words, word_mask, heads)
        y = gelu(linear(layer_norm(stream, w, at + "norms.2"), w, at + "feed_forward.0"))
        stream = stream + linear(y, w, at + "feed_forward.3")
        block += 1
    return layer_norm(stream, w, "norm")


def _attend(w: Tensors, at: str, x: Floats, source: Floats, mask: NDArray[np.bool_], heads: int) -> Floats:
    q = linear(x, w, f"{at}.query")
    k, v = linear(source, w, f"{at}.key"), linear(source, w, f"{at}.value")
    return linear(attention(q, k, v, mask, heads), w, f"{at}.out")
