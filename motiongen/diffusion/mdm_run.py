"""The denoiser of `mdm.py`, run in numpy. Training checks it against the torch module to float32's own accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.said import Said
from motiongen.nn import Floats, Tensors, attention, gelu, layer_norm, linear, silu, waves


@dataclass(frozen=True)
class Words:
    """What the blocks hear of words (B, M, width): `keys` and `values` of each block, and the `mask` (B, M) of those
    that there are. A network that hears none has no keys."""

    keys: tuple[Floats, ...]
    values: tuple[Floats, ...]
    mask: NDArray[np.bool_]


@dataclass(frozen=True)
class Told:
    """What is the same in all passes over a clip: what is added to the first token (B, width) and to the others
    (B, N, width), which of all (B, N + 1) there are, and the words."""

    sentence: Floats
    added: Floats
    mask: NDArray[np.bool_]
    words: Words


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
    return estimate(w, sizes, x, t, told(w, sizes, frames, said, steering))


def told(
    w: Tensors, sizes: Mapping[str, int], frames: NDArray[np.bool_], said: Said, steering: Floats | None = None
) -> Told:
    """What `estimate` has to know; arguments as those of `denoise`."""
    sentence, words = linear(said.sentence, w, "sentence"), linear(said.words, w, "word")
    if said.action is not None:
        act, is_act = w["action.weight"][np.maximum(said.action, 0)], (said.action >= 0)[:, None]
        sentence, words = np.where(is_act, act, sentence), np.where(is_act[:, None], act[:, None], words)
    sentence = np.where(said.keep[:, None], sentence, w["no_sentence"])
    words = np.where(said.keep[:, None, None], words, w["no_words"])
    real = np.any(frames.reshape(len(frames), -1, sizes["patch"]), axis=2)
    left, to_end = np.maximum(real.sum(1, keepdims=True) - np.arange(real.shape[1]), 0), w["to_end.weight"]
    places = waves(np.arange(real.shape[1] + 1), sentence.shape[1])
    added = places[1:] + waves(left, to_end.shape[1]) @ to_end.T
    if steering is not None:
        added += steering.reshape(*real.shape, -1) @ w["steer.weight"].T
    mask = np.concatenate([np.ones_like(real[:, :1]), real], axis=1)
    return Told(sentence + places[0], added, mask, heard(w, words, said.word_mask))


def heard(w: Tensors, words: Floats, mask: NDArray[np.bool_]) -> Words:
    """What the blocks in `w` hear of `words` (B, M, width) where `mask` (B, M)."""
    names: list[str] = []
    while (name := f"blocks.{len(names)}.cross_attention") + ".key.weight" in w:
        names.append(name)
    keys, values = (tuple(linear(words, w, f"{name}.{which}") for name in names) for which in ("key", "value"))
    return Words(keys, values, mask)


def estimate(w: Tensors, sizes: Mapping[str, int], x: Floats, t: float, told: Told) -> Floats:
    """`denoise` of a clip of which is `told` what stays the same."""
    batch, length, features = x.shape
    tokens = linear(x.reshape(batch, length // sizes["patch"], -1), w, "read") + told.added
    level = waves(np.full(1, t * 1000.0), tokens.shape[-1])
    first = linear(silu(linear(level, w, "level.0")), w, "level.2") + told.sentence
    stream = transform(w, sizes["heads"], np.concatenate([first[:, None], tokens], axis=1), told.mask, told.words)
    return linear(stream[:, 1:], w, "write").reshape(batch, length, features)


def transform(w: Tensors, heads: int, stream: Floats, mask: NDArray[np.bool_], words: Words) -> Floats:
    """What the blocks in `w` make of a stream (B, N, width) where `mask` (B, N), normalised."""
    block = 0
    while (at := f"blocks.{block}.") + "norms.0.weight" in w:
        y = layer_norm(stream, w, at + "norms.0")
        k, v = (linear(y, w, f"{at}self_attention.{name}") for name in ("key", "value"))
        stream = stream + _attend(w, at + "self_attention", y, k, v, mask, heads)
        if words.keys:
            y = layer_norm(stream, w, at + "norms.1")
            k, v = words.keys[block], words.values[block]
            stream = stream + _attend(w, at + "cross_attention", y, k, v, words.mask, heads)
        y = gelu(linear(layer_norm(stream, w, at + "norms.2"), w, at + "feed_forward.0"))
        stream = stream + linear(y, w, at + "feed_forward.3")
        block += 1
    return layer_norm(stream, w, "norm")


def _attend(w: Tensors, at: str, x: Floats, k: Floats, v: Floats, mask: NDArray[np.bool_], heads: int) -> Floats:
    return linear(attention(linear(x, w, f"{at}.query"), k, v, mask, heads), w, f"{at}.out")
