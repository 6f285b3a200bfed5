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

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from motiongen.mdm import Mdm, MdmConfig

FOLDER = Path(__file__).parent / "weights"
_FORMAT = "rigcast-mdm-1"
_EXTRAS = ("mean", "std", "offsets", "bank")


class WeightsError(ValueError):
    """A weights file that is missing, truncated or of another model; the message names it."""


@dataclass(frozen=True)
class Bank:
    """What the model was trained on: `vectors` (N, 384) of captions, whose content is `contents[which[i]]`.

    `seconds` holds the usual length of each content's clips; `known` is the cosine from which a text counts as known.
    """

    vectors: Tensor
    which: tuple[int, ...]
    contents: tuple[str, ...]
    seconds: tuple[float, ...]
    known: float


@dataclass(frozen=True)
class Weights:
    """A trained model. `mean`, `std` (140,) of the features, `offsets` (22, 3) in metres; `digest` names the file."""

    model: Mdm
    mean: Tensor
    std: Tensor
    offsets: Tensor
    bank: Bank
    licence: str
    training: dict[str, str]
    digest: str


def save_weights(weights: Weights, path: Path) -> None:
    """Write a weights file in half precision (under a temporary name first)."""
    tensors = {f"model.{k}": v.half().contiguous() for k, v in weights.model.state_dict().items()}
    tensors |= {"mean": weights.mean, "std": weights.std, "offsets": weights.offsets.float()}
    tensors["bank"] = weights.bank.vectors.half()
    about = {k: v for k, v in asdict(weights.bank).items() if k != "vectors"}
    metadata = {
        "format": _FORMAT,
        "model": json.dumps(asdict(weights.model.config)),
        "bank": json.dumps(about),
        "licence": weights.licence,
        "training": json.dumps(weights.training),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".tmp")
    save_file(tensors, temporary, metadata=metadata)
    temporary.replace(path)


def load_weights(path: Path) -> Weights:
    """Read a weights file; raises WeightsError where it is missing, cut short or not of this model."""
    if not path.exists():
        raise WeightsError(f"{path}: no such weights file")
    try:
        with safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") != _FORMAT:
                raise WeightsError(f"{path}: not weights of this model ({_FORMAT})")
            tensors = {k: file.get_tensor(k).float() for k in file.keys()}  # noqa: SIM118 (not a dict)
        model = Mdm(MdmConfig(**json.loads(metadata["model"])))
        model.load_state_dict({k.removeprefix("model."): v for k, v in tensors.items() if k not in _EXTRAS})
        bank = Bank(vectors=tensors["bank"], **json.loads(metadata["bank"]))
        training = json.loads(metadata["training"])
    except (SafetensorError, KeyError, TypeError, RuntimeError, json.JSONDecodeError) as error:
        reason = str(error).splitlines()[0]
        raise WeightsError(f"{path}: cut short or of another model ({reason})") from None
    model.eval().requires_grad_(False)
    digest = sha256(path.read_bytes()).hexdigest()[:16]
    mean, std, offsets = (tensors[k] for k in ("mean", "std", "offsets"))
    return Weights(model, mean, std, offsets, bank, metadata["licence"], training, digest)


@torch.inference_mode()
def nearest(bank: Bank, sentence: Tensor) -> list[tuple[float, int]]:
    """Best cosine and index of every content for a unit sentence vector (384,), best first."""
    cosine = bank.vectors @ sentence
    which = torch.tensor(bank.which)
    best = [(float(cosine[which == i].max()), i) for i in range(len(bank.contents))]
    return sorted(best, reverse=True)
