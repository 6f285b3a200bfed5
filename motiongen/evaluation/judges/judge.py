"""A trained evaluator, ready to embed texts and motions; kept as one safetensors file.

The file holds the network, and the mean and deviation of what it was trained to see: motions come in metres and
seconds, never normalised by anybody else's numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, TypeVar

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from motiongen.evaluation.judges.guo import UNIT, Guo, GuoConfig
from motiongen.evaluation.judges.seen import MOST_FRAMES, SEEN_FPS, see_motion
from motiongen.evaluation.judges.tmr import Tmr, TmrConfig
from motiongen.files import replacing
from motiongen.motion import Motion
from motiongen.nn import Floats
from motiongen.rotation import Array
from motiongen.text.encoder import TextEncoder

Kind = Literal["guo", "tmr"]
BATCH = 64
_FORMAT = "rigcast-judge-1"
T = TypeVar("T")


class JudgeError(ValueError):
    """An evaluator's file that is missing, damaged or of another kind; the message names it."""


@dataclass(frozen=True)
class About:
    """What an evaluator is: its network and sizes, the sources it was trained on and their licences, and how long."""

    kind: Kind
    config: dict[str, int]
    sources: tuple[str, ...]
    licences: tuple[str, ...]
    steps: int
    seed: int


class Judge:
    """An `Evaluator` (see `protocol.py`) around a trained network; `mean` and `std` (71) of what it sees."""

    def __init__(self, about: About, network: Guo | Tmr, mean: Floats, std: Floats) -> None:
        self.name, self.about = about.kind, about
        self.network, self.mean, self.std = network.eval(), mean, std
        self._encoder = TextEncoder()

    @torch.inference_mode()
    def embed_texts(self, texts: Sequence[str]) -> Array:
        """Embeddings (N, D). Raises ValueError for a blank text."""
        for i, text in enumerate(texts):
            if not text.strip():
                raise ValueError(f"text {i} is blank")
        return by_length(
            texts, lambda part: self.network.embed_texts(*words(self._encoder, part, self.about.kind)), len
        )

    @torch.inference_mode()
    def embed_motions(self, motions: Sequence[Motion]) -> Array:
        """Embeddings (N, D) of the first 8 s of each. Raises ValueError for another skeleton or under four frames."""
        seen = [see_motion(motion) for motion in motions]
        for i, rows in enumerate(seen):
            if len(rows) < UNIT:
                raise ValueError(
                    f"motion {i} has {len(rows)} frames at {SEEN_FPS:g} a second; an evaluator needs {UNIT}"
                )
        return by_length(seen, lambda part: self.network.embed_motions(*padded(part, self.mean, self.std)), len)


def build(kind: Kind, config: dict[str, int]) -> Guo | Tmr:
    """An untrained network; raises TypeError for sizes it does not have."""
    return Guo(GuoConfig(**config)) if kind == "guo" else Tmr(TmrConfig(**config))


def default_config(kind: Kind) -> dict[str, int]:
    """The sizes that are trained."""
    return asdict(GuoConfig() if kind == "guo" else TmrConfig())


def words(encoder: TextEncoder, texts: Sequence[str], kind: Kind) -> tuple[Tensor, Tensor]:
    """Word vectors (B, N, 384) and mask (B, N): out of context for "guo", whose network makes its own, in it for
    "tmr"."""
    vectors, mask = encoder.words(list(texts)) if kind == "guo" else encoder(list(texts))[:2]
    return torch.from_numpy(np.ascontiguousarray(vectors)), torch.from_numpy(mask)


def padded(
    clips: Sequence[NDArray[np.float32]], mean: Floats, std: Floats, most: int = MOST_FRAMES
) -> tuple[Tensor, Tensor]:
    """Normalised frames (B, T, W), 0 beyond each clip, and how many frames (B) each has, whole snippets of four.

    T is four frames more than the longest needs, but not over `most`: what a clip's convolutions see past its end is
    then the same in every batch.
    """
    frames = [min(len(clip), most) // UNIT * UNIT for clip in clips]
    x = np.zeros((len(clips), min(max(frames) + UNIT, most), clips[0].shape[1]), np.float32)
    for row, clip, count in zip(x, clips, frames, strict=True):
        row[:count] = (clip[:count] - mean) / std
    return torch.from_numpy(x), torch.tensor(frames)


def by_length(things: Sequence[T], embed: Callable[[list[T]], Tensor], length: Callable[[T], int]) -> Array:
    """`embed` of things of like length together, rows in the order of `things`; ValueError where there are none."""
    if not things:
        raise ValueError("nothing to embed")
    order = sorted(range(len(things)), key=lambda i: length(things[i]))
    parts = [embed([things[i] for i in order[start : start + BATCH]]) for start in range(0, len(order), BATCH)]
    rows = torch.cat(parts).double().numpy()
    out = np.empty_like(rows)
    out[order] = rows
    return out


def save_judge(judge: Judge, path: Path) -> None:
    """Write an evaluator as one file (under a temporary name first)."""
    tensors = {f"network.{k}": v.contiguous() for k, v in judge.network.state_dict().items()}
    tensors |= {"mean": torch.from_numpy(judge.mean), "std": torch.from_numpy(judge.std)}
    with replacing(path) as temporary:
        save_file(tensors, temporary, metadata={"format": _FORMAT, "about": msgspec.json.encode(judge.about).decode()})
        temporary.chmod(0o644)  # safetensors makes files that only their owner can read


def load_judge(path: Path) -> Judge:
    """Read an evaluator; raises JudgeError where the file is missing, damaged or something else."""
    if not path.is_file():
        raise JudgeError(f"{path}: no such file; python -m motiongen.evaluation.judges.train makes one")
    try:
        with safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            if metadata.get("format") != _FORMAT:
                raise JudgeError(f"{path}: not an evaluator of this project ({_FORMAT})")
            tensors = {k: file.get_tensor(k) for k in file.keys()}  # noqa: SIM118 (not a dict)
        about = msgspec.json.decode(metadata["about"], type=About)
        network = build(about.kind, about.config)
        mean, std = tensors.pop("mean").numpy(), tensors.pop("std").numpy()
        network.load_state_dict({k.removeprefix("network."): v for k, v in tensors.items()})
    except (SafetensorError, KeyError, TypeError, RuntimeError, msgspec.DecodeError) as error:
        raise JudgeError(f"{path}: damaged or of another version ({str(error).splitlines()[0]})") from None
    return Judge(about, network, mean, std)
