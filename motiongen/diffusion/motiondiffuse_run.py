"""The network of `motiondiffuse.py`, run in numpy; tests hold it to the torch module to float32's own accuracy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.said import Said
from motiongen.diffusion.schedule import LEVELS, LINEAR
from motiongen.nn import Floats, Tensors, attention, gelu, layer_norm, linear, silu, waves


def denoise(w: Tensors, sizes: Mapping[str, int], x: Floats, t: float, frames: NDArray[np.bool_], said: Said) -> Floats:
    """Estimate of ε (B, T, features); the arguments are those of `MotionDiffuse.forward`, with one `t` for the batch.

    `sizes`: the config's `patch` and `heads`.
    """
    patch, heads = sizes["patch"], sizes["heads"]
    batch, length, features = x.shape
    text, text_mask = _text(w, said, heads)
    stream = linear(x.reshape(batch, -1, patch * features), w, "read")
    level = silu(linear(waves(np.full(1, t * 1000.0), stream.shape[-1]), w, "level.0"))
    e = linear(text[:, 0], w, "text") + linear(level, w, "level.2")
    real = np.any(frames.reshape(batch, -1, patch), axis=2)
    places = np.arange(real.shape[1])
    left = np.maximum(real.sum(1, keepdims=True) - places, 0)
    to_end = w["to_end.weight"]
    stream = stream + waves(places, stream.shape[-1]) + waves(left, to_end.shape[1]) @ to_end.T
    block = 0
    while (at := f"blocks.{block}.") + "norms.0.weight" in w:
        y = layer_norm(stream, w, at + "norms.0")
        y = _attend(w, at + "self_attention", y, y, real, heads)
        stream = stream + _style(w, at + "styles.0", y, e)
        y = _attend(w, at + "cross_attention", layer_norm(stream, w, at + "norms.1"), text, text_mask, heads)
        stream = stream + _style(w, at + "styles.1", y, e)
        y = _feed_forward(w, at + "feed_forward", layer_norm(stream, w, at + "norms.2"))
        stream = stream + _style(w, at + "styles.2", y, e)
        block += 1
    out = linear(layer_norm(stream, w, "norm"), w, "write").reshape(batch, length, features)
    if patch == 1:
        return out
    alpha, sigma = LINEAR.signal_and_noise(max(t, 1 / LEVELS))
    return (x - np.float32(alpha) * out) * np.float32(1 / sigma)


def efficient_attention(q: Floats, k: Floats, v: Floats, mask: NDArray[np.bool_], heads: int) -> Floats:
    """Eq. 8 in `heads` heads: (B, N, width) of `q` (B, N, width), `k` and `v` (B, M, width), `mask` (B, M)."""
    batch, count, width = q.shape
    k = np.where(mask[..., None], k, k.dtype.type(-np.inf))
    q, k, v = (y.reshape(batch, y.shape[1], heads, width // heads).swapaxes(1, 2) for y in (q, k, v))
    overview = _softmax(k, 2).swapaxes(-1, -2) @ v
    return (_softmax(q, 3) @ overview).swapaxes(1, 2).reshape(batch, count, width)


def _softmax(x: Floats, axis: int) -> Floats:
    x = np.exp(x - x.max(axis, keepdims=True))
    return x / x.sum(axis, keepdims=True)


def _text(w: Tensors, said: Said, heads: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Text features (B, 1 + N, text_width), the sentence's first, and which of them count."""
    text = np.concatenate([linear(said.sentence, w, "sentence")[:, None], linear(said.words, w, "word")], axis=1)
    if said.action is not None:
        is_act = (said.action >= 0)[:, None, None]
        text = np.where(is_act, w["action.weight"][np.maximum(said.action, 0)][:, None], text)
    text = np.where(said.keep[:, None, None], text, w["no_text"])
    mask = np.concatenate([np.ones_like(said.word_mask[:, :1]), said.word_mask], axis=1)
    block = 0
    while (at := f"text_blocks.{block}.") + "norms.0.weight" in w:
        y = layer_norm(text, w, at + "norms.0")
        q, k, v = (linear(y, w, f"{at}attention.{name}") for name in ("query", "key", "value"))
        text = text + linear(attention(q, k, v, mask, heads), w, at + "attention.out")
        text = text + _feed_forward(w, at + "feed_forward", layer_norm(text, w, at + "norms.1"))
        block += 1
    return layer_norm(text, w, "text_norm"), mask


def _attend(w: Tensors, at: str, x: Floats, source: Floats, mask: NDArray[np.bool_], heads: int) -> Floats:
    q, k, v = linear(x, w, f"{at}.query"), linear(source, w, f"{at}.key"), linear(source, w, f"{at}.value")
    return efficient_attention(q, k, v, mask, heads)


def _style(w: Tensors, at: str, y: Floats, e: Floats) -> Floats:
    """Eq. 9."""
    style = silu(linear(e, w, f"{at}.phi"))[:, None]
    return layer_norm(y, w, f"{at}.norm") * linear(style, w, f"{at}.scale") + linear(style, w, f"{at}.shift")


def _feed_forward(w: Tensors, at: str, x: Floats) -> Floats:
    return linear(gelu(linear(gelu(linear(x, w, f"{at}.0")), w, f"{at}.2")), w, f"{at}.4")
