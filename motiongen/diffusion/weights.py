"""The weights file of a text-to-motion model: one safetensors file, half precision, all it takes to generate.

Beside the network's tensors it holds the features' mean and deviation, the skeleton's offsets, and a bank of sentence
vectors of what the model was trained on, by which it knows what it does not know. Its metadata carry the model's sizes,
the licence and how it was trained.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from motiongen.files import replacing
from motiongen.nn import Floats, Tensors

FOLDER = Path(__file__).parent.parent / "weights"
_FORMAT = "rigcast-mdm-2"
_EXTRAS = ("mean", "std", "offsets", "bank")


class WeightsError(ValueError):
    """A weights file that is missing, truncated or of another model; the message names it."""


@dataclass(frozen=True)
class Bank:
    """What the model was trained on: unit `vectors` (N, 384) of captions; caption i shows `contents[which[i]]`.

    `known` is the cosine from which a text counts as known.
    """

    vectors: Floats
    which: tuple[int, ...]
    contents: tuple[str, ...]
    known: float


@dataclass(frozen=True)
class Weights:
    """A trained model: its tensors by name; `patch` and `heads` are what their shapes do not say.

    `window`: frames of the longest stretch that it was trained on; `mean`, `std` (140,) of the features; `offsets`
    (22, 3) in metres; `lengths`: the network of `motiongen.diffusion.lengths`; `digest` names the file.
    """

    tensors: Tensors
    patch: int
    heads: int
    window: int
    mean: Floats
    std: Floats
    offsets: Floats
    lengths: Tensors
    bank: Bank
    licence: str
    training: dict[str, str]
    digest: str


def save_weights(weights: Weights, path: Path) -> None:
    """Write a weights file in half precision (under a temporary name first)."""
    tensors: dict[str, np.ndarray] = {f"model.{k}": v.astype(np.float16) for k, v in weights.tensors.items()}
    tensors |= {k: v.astype(np.float16) for k, v in weights.lengths.items()}
    tensors |= {"mean": weights.mean, "std": weights.std, "offsets": weights.offsets}
    tensors["bank"] = weights.bank.vectors.astype(np.float16)
    metadata = {
        "format": _FORMAT,
        "model": json.dumps({"patch": weights.patch, "heads": weights.heads, "window": weights.window}),
        "bank": json.dumps({k: v for k, v in asdict(weights.bank).items() if k != "vectors"}),
        "licence": weights.licence,
        "training": json.dumps(weights.training),
    }
    with replacing(path) as temporary:
        save_file(tensors, temporary, metadata=metadata)
        temporary.chmod(0o644)  # safetensors makes files that only their owner can read


def load_weights(path: Path) -> Weights:
    """Read a weights file; raises WeightsError where it is missing, cut short or not of this model."""
    if not path.exists():
        raise WeightsError(f"{path}: no such weights file")
    try:
        with safe_open(path, "np") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") != _FORMAT:
                raise WeightsError(f"{path}: not weights of this model ({_FORMAT})")
            tensors = {k: file.get_tensor(k).astype(np.float32) for k in file.keys()}  # noqa: SIM118 (not a dict)
        mean, std, offsets, vectors = (tensors.pop(k) for k in _EXTRAS)
        about, bank = json.loads(metadata["model"]), json.loads(metadata["bank"])
        return Weights(
            {k.removeprefix("model."): v for k, v in tensors.items() if k.startswith("model.")},
            int(about["patch"]),
            int(about["heads"]),
            int(about["window"]),
            mean,
            std,
            offsets,
            {k: v for k, v in tensors.items() if k.startswith("lengths.")},
            Bank(vectors, **bank),
            "; ".join(dict.fromkeys(metadata["licence"].split("; "))),  # clips made of others have those of all parts
            json.loads(metadata["training"]),
            sha256(path.read_bytes()).hexdigest()[:16],
        )
    except (SafetensorError, KeyError, TypeError, json.JSONDecodeError) as error:
        raise WeightsError(f"{path}: cut short or of another model ({str(error).splitlines()[0]})") from None


def nearest(bank: Bank, sentence: Floats) -> list[tuple[float, int]]:
    """Best cosine and index of every content for a unit sentence vector (384,), best first."""
    cosine, which = bank.vectors @ sentence, np.array(bank.which)
    return sorted(((float(cosine[which == i].max()), i) for i in range(len(bank.contents))), reverse=True)
