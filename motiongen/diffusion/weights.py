"""The weights file of a text-to-motion model: one safetensors file, all it takes to generate.

Numbers are in half precision. Where a file is to be small, matrices are in whole numbers of 8 bits instead, each row
with a scale of its own under the matrix's name and `.scale`.

Beside the network's tensors it holds the features' mean and deviation, the skeleton's offsets, and a bank of sentence
vectors of what the model was trained on, by which it knows what it does not know. Its metadata:

| key | says |
|---|---|
| `format` | `rigcast-diffusion-1` |
| `network` | which network: `mdm`, `motiondiffuse` or `diffusionphase` |
| `sizes` | JSON, its config's fields by name |
| `schedule`, `prediction` | `cosine` or `linear`; `x0` or `noise` |
| `unconditioned` | `true` where it was also trained without text: only then does guidance mean something |
| `actions` | JSON, names of the actions that it knows by number |
| `window` | frames of the longest stretch that it was trained on |
| `bank` | JSON of `Bank` but for its vectors |
| `licence`, `training` | licences of all training clips, each once; JSON, how it was trained |
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from motiongen.files import replacing
from motiongen.nn import Floats, Tensors

FOLDER = Path(__file__).parent.parent / "weights"
_FORMAT = "rigcast-diffusion-1"
_OLDER = "rigcast-mdm-1"
_EXTRAS = ("mean", "std", "offsets", "bank")
_SCALE = ".scale"


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
    """A trained model: its tensors by name, and what has to be known to run them.

    `network`, `sizes`, `schedule`, `prediction`, `unconditioned`, `actions`: as the metadata above. `window`: frames of
    the longest stretch that it was trained on; `mean`, `std` (140,) of the features; `offsets` (22, 3) in metres;
    `lengths`: the network of `motiongen.diffusion.lengths`; `digest` names the file.
    """

    tensors: Tensors
    network: str
    sizes: dict[str, int | float | str]
    schedule: str
    prediction: str
    unconditioned: bool
    actions: tuple[str, ...]
    window: int
    mean: Floats
    std: Floats
    offsets: Floats
    lengths: Tensors
    bank: Bank
    licence: str
    training: dict[str, str]
    digest: str


def save_weights(weights: Weights, path: Path, *, eight_bits: bool = False) -> None:
    """Write a weights file (under a temporary name first), with `eight_bits` for matrices or half precision for all."""
    learnt = {f"model.{k}": v for k, v in weights.tensors.items()} | weights.lengths | {"bank": weights.bank.vectors}
    tensors: dict[str, np.ndarray] = {"mean": weights.mean, "std": weights.std, "offsets": weights.offsets}
    for name, value in learnt.items():
        if eight_bits and value.ndim == 2:
            tensors[name], tensors[name + _SCALE] = _in_eight_bits(value)
        else:
            tensors[name] = value.astype(np.float16)
    metadata = {
        "format": _FORMAT,
        "network": weights.network,
        "sizes": json.dumps(weights.sizes),
        "schedule": weights.schedule,
        "prediction": weights.prediction,
        "unconditioned": json.dumps(weights.unconditioned),
        "actions": json.dumps(weights.actions),
        "window": json.dumps(weights.window),
        "bank": json.dumps({k: v for k, v in asdict(weights.bank).items() if k != "vectors"}),
        "licence": weights.licence,
        "training": json.dumps(weights.training),
    }
    with replacing(path) as temporary:
        save_file(tensors, temporary, metadata=metadata)
        temporary.chmod(0o644)  # safetensors makes files that only their owner can read


def _in_eight_bits(matrix: Floats) -> tuple[NDArray[np.int8], Floats]:
    """Whole numbers of -127..127 and the scale of each row (rows, 1), whose product is nearest to `matrix`."""
    scale = np.maximum(np.abs(matrix).max(1, keepdims=True), 1e-12).astype(np.float32) / 127
    return np.rint(matrix / scale).astype(np.int8), scale


def network_of(path: Path) -> str:
    """Which network a weights file is of; raises WeightsError as `load_weights` does."""
    return _told(path).get("network", "")


def goes_on(path: Path) -> bool:
    """Whether a weights file is of a network that goes on from a history; raises WeightsError as `network_of` does."""
    return bool(json.loads(_told(path).get("sizes", "{}")).get("history"))


def _told(path: Path) -> dict[str, str]:
    if not path.exists():
        raise WeightsError(f"{path}: no such weights file")
    try:
        with safe_open(path, "np") as file:
            return _metadata(path, file)
    except SafetensorError as error:
        raise WeightsError(f"{path}: cut short or of another model ({str(error).splitlines()[0]})") from None


def _metadata(path: Path, file: Any) -> dict[str, str]:
    """What an open weights file says of itself."""
    metadata: dict[str, str] = file.metadata() or {}
    if metadata.get("format") == _OLDER:
        raise WeightsError(f"{path}: weights of an older format ({_OLDER}); export them anew")
    if metadata.get("format") != _FORMAT:
        raise WeightsError(f"{path}: not weights of such a model ({_FORMAT})")
    return metadata


def load_weights(path: Path) -> Weights:
    """Read a weights file; raises WeightsError where it is missing, cut short, too old or not of such a model."""
    if not path.exists():
        raise WeightsError(f"{path}: no such weights file")
    try:
        with safe_open(path, "np") as file:
            metadata = _metadata(path, file)
            tensors = {k: file.get_tensor(k).astype(np.float32) for k in file.keys()}  # noqa: SIM118 (not a dict)
        for name in [k for k in tensors if k.endswith(_SCALE)]:
            tensors[name.removesuffix(_SCALE)] *= tensors.pop(name)
        mean, std, offsets, vectors = (tensors.pop(k) for k in _EXTRAS)
        return Weights(
            {k.removeprefix("model."): v for k, v in tensors.items() if k.startswith("model.")},
            metadata["network"],
            json.loads(metadata["sizes"]),
            metadata["schedule"],
            metadata["prediction"],
            json.loads(metadata["unconditioned"]),
            tuple(json.loads(metadata["actions"])),
            json.loads(metadata["window"]),
            mean,
            std,
            offsets,
            {k: v for k, v in tensors.items() if k.startswith("lengths.")},
            Bank(vectors, **json.loads(metadata["bank"])),
            metadata["licence"],
            json.loads(metadata["training"]),
            sha256(path.read_bytes()).hexdigest()[:16],
        )
    except (SafetensorError, KeyError, TypeError, json.JSONDecodeError) as error:
        raise WeightsError(f"{path}: cut short or of another model ({str(error).splitlines()[0]})") from None


def weights_path(name: str) -> Path:
    """The weights file `name`, or that of a generator in the tree."""
    return Path(name) if Path(name).suffix == ".safetensors" else FOLDER / f"{name}.safetensors"


def nearest(bank: Bank, sentence: Floats) -> list[tuple[float, int]]:
    """Best cosine and index of every content for a unit sentence vector (384,), best first."""
    cosine, which = bank.vectors @ sentence, np.array(bank.which)
    return sorted(((float(cosine[which == i].max()), i) for i in range(len(bank.contents))), reverse=True)
