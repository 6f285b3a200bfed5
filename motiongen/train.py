"""Train the text-to-motion model on a corpus; resumes from its last checkpoint.

python -m motiongen.train runs/corpus.npz runs/mdm --steps 8000
"""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import torch.nn.functional as F
import tyro
from rich.progress import track
from safetensors.torch import load_file, save_file
from torch import Tensor

from motiongen import corpus as corpora
from motiongen.captions import kept_for_testing, phrasings, swap_sides
from motiongen.diffusion import levels
from motiongen.features import CONTACTS, TURNS
from motiongen.files import replacing
from motiongen.losses import LossWeights, loss
from motiongen.mdm import Mdm, MdmConfig
from motiongen.text import TextEncoder


@dataclass(frozen=True)
class TrainConfig:
    """One run. Learning rate: warmed up, held, then linear to nothing over the last `decay` of the steps."""

    steps: int = 8000
    batch: int = 48
    rate: float = 3e-4
    warm_up: int = 200
    decay: float = 0.25
    weight_decay: float = 0.01
    clip: float = 1.0
    ema: float = 0.999
    drop_text: float = 0.1
    lengths: tuple[int, ...] = (90, 120, 150, 180)
    seed: int = 0
    save_every: int = 200
    log_every: int = 50
    model: MdmConfig = field(default_factory=MdmConfig)
    weights: LossWeights = field(default_factory=LossWeights)


class Batches:
    """Draws batches: a length, clips by rarity, a crop, a side and a caption. The draw depends on the step alone."""

    def __init__(self, corpus: corpora.Corpus, config: TrainConfig, cache: Path) -> None:
        self._corpus, self._config = corpus, config
        self._rows = np.flatnonzero(~corpus.held_out)
        pairs = [(corpus.contents[i], corpus.styles[i]) for i in self._rows]
        counts = {p: pairs.count(p) for p in set(pairs)}
        weight = np.array([counts[p] ** -0.6 for p in pairs])
        self._chance = weight / weight.sum()
        self.mean, self.std = statistics(corpus)
        names = sorted({n for p in counts for n in (p, (swap_sides(p[0]), p[1]))})
        said = {n: [c for c in phrasings(*n) if not kept_for_testing(c)] for n in names}
        captions = sorted({c for each in said.values() for c in each})
        place = {c: i for i, c in enumerate(captions)}
        self._said = {n: np.array([place[c] for c in each]) for n, each in said.items()}
        self._words, self._word_mask, self._sentences = _encode(captions, cache)

    def draw(self, step: int) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
        """Normalised features (B, T, 140), frames (B, T), words, word mask, sentences of one step."""
        config, corpus = self._config, self._corpus
        rng = np.random.default_rng([config.seed, step])
        length = int(rng.choice(config.lengths))
        x = np.zeros((config.batch, length, corpus.frames.shape[1]), np.float32)
        frames = np.zeros((config.batch, length), bool)
        captions = np.zeros(config.batch, np.int64)
        for b in range(config.batch):
            i = int(rng.choice(self._rows, p=self._chance))
            mirrored = bool(rng.random() < 0.5)
            clip = _crop(corpus.clip(i, mirrored), length, rng)
            x[b, : len(clip)] = (clip - self.mean) / self.std
            frames[b, : len(clip)] = True
            captions[b] = rng.choice(self._said[corpus.content(i, mirrored), corpus.styles[i]])
        longest = int(self._word_mask[captions].sum(1).max())
        words = self._words[captions, :longest].float()
        return (
            torch.from_numpy(x),
            torch.from_numpy(frames),
            words,
            self._word_mask[captions, :longest],
            self._sentences[captions],
        )


def statistics(corpus: corpora.Corpus) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (140,) over training clips and their mirror images.

    Orientations share one floor: what hardly moves must not be blown up to the size of what does.
    """
    rows = np.flatnonzero(~corpus.held_out)
    clips = [corpus.clip(int(i), m) for i in rows for m in (False, True)]
    frames = np.concatenate(clips)
    mean, std = frames.mean(0, dtype=np.float64), frames.std(0, dtype=np.float64)
    std[TURNS] = np.maximum(std[TURNS], 0.1)
    std[CONTACTS] = 0.5
    return mean.astype(np.float32), std.astype(np.float32)


def _crop(clip: np.ndarray, length: int, rng: np.random.Generator) -> np.ndarray:
    """A stretch of at most `length` frames: half of them from the clip's start, the rest where most happens."""
    room = len(clip) - length
    if room <= 0:
        return clip
    if rng.random() < 0.5:
        start = int(rng.integers(0, min(room, 10) + 1))
    else:
        stir = np.abs(np.diff(clip[:, TURNS], axis=0)).sum(1)
        starts = rng.integers(0, room + 1, 4)
        start = int(max(starts, key=lambda s: stir[s : s + length].sum()))
    return clip[start : start + length]


def _encode(captions: list[str], cache: Path) -> tuple[Tensor, Tensor, Tensor]:
    """Words (N, longest, 384) in half precision, mask (N, longest) and sentences (N, 384), kept in `cache`."""
    key = hashlib.sha256("\n".join(captions).encode()).hexdigest()[:16]
    path = cache / f"captions-{key}.safetensors"
    if not path.exists():
        encoder = TextEncoder()
        parts = [encoder(captions[i : i + 256]) for i in track(range(0, len(captions), 256), "encoding captions")]
        longest = max(p[0].shape[1] for p in parts)
        words = torch.cat([F.pad(torch.from_numpy(p[0]), (0, 0, 0, longest - p[0].shape[1])).half() for p in parts])
        mask = torch.cat([F.pad(torch.from_numpy(p[1]), (0, longest - p[1].shape[1])) for p in parts])
        sentences = torch.cat([torch.from_numpy(p[2]) for p in parts])
        with replacing(path) as temporary:
            save_file({"words": words, "mask": mask, "sentences": sentences}, temporary)
    tensors = load_file(path)
    return tensors["words"], tensors["mask"], tensors["sentences"]


def train(config: TrainConfig, corpus: corpora.Corpus, out: Path) -> None:
    """Train to `config.steps`, from the checkpoint in `out` where there is one, and keep checkpoints there.

    Raises RuntimeError naming the step where the loss is no longer a number; the last checkpoint is then good.
    """
    out.mkdir(parents=True, exist_ok=True)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    torch.manual_seed(config.seed)
    model = Mdm(config.model).to(device)
    print(f"{sum(p.numel() for p in model.parameters()) / 1e6:.2f} M parameters on {device}", flush=True)
    average = {k: v.detach().clone() for k, v in model.state_dict().items()}
    optimizer = torch.optim.AdamW(model.parameters(), lr=config.rate, weight_decay=config.weight_decay)
    batches = Batches(corpus, config, out)
    mean, std = torch.from_numpy(batches.mean).to(device), torch.from_numpy(batches.std).to(device)
    offsets = torch.tensor(corpus.offsets, dtype=torch.float32, device=device)
    first = _resume(out, model, average, optimizer)
    (out / "config.json").write_text(json.dumps(asdict(config), indent=1))
    began = time.monotonic()
    sums: dict[str, float] = {}
    for step in range(first, config.steps):
        for group in optimizer.param_groups:
            group["lr"] = config.rate * _schedule(step, config)
        torch.manual_seed(config.seed * 1_000_003 + step)
        x, frames, words, word_mask, sentence = (y.to(device) for y in batches.draw(step))
        t, keep = torch.rand(len(x)), torch.rand(len(x), device=device) >= config.drop_text
        alpha, sigma = (torch.from_numpy(y).to(x)[:, None, None] for y in levels(t.numpy()))
        noisy = alpha * x + sigma * torch.randn_like(x)
        guess = model(noisy, t.to(device), frames, words, word_mask, sentence, keep)
        terms = loss(guess, x, frames, mean, std, offsets, config.weights)
        if not torch.isfinite(terms["total"]):
            raise RuntimeError(f"the loss is {terms['total'].item()} at step {step}; the last checkpoint is good")
        optimizer.zero_grad()
        terms["total"].backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), config.clip)
        optimizer.step()
        pull = 1 - min(config.ema, (step + 1) / (step + 10))
        for name, value in model.state_dict().items():
            average[name].lerp_(value, pull)
        for name, value in terms.items():
            sums[name] = sums.get(name, 0.0) + value.item()
        if (step + 1) % config.log_every == 0:
            pace = (time.monotonic() - began) / (step + 1 - first)
            line = "  ".join(f"{k} {v / config.log_every:.4f}" for k, v in sums.items())
            left = (config.steps - step - 1) * pace / 60
            print(f"step {step + 1}  {line}  {pace:.2f} s/step, {left:.0f} min left", flush=True)
            sums = {}
        if (step + 1) % config.save_every == 0 or step + 1 == config.steps:
            _save(out, step + 1, model, average, optimizer)


def _schedule(step: int, config: TrainConfig) -> float:
    tail = max(1, round(config.decay * config.steps))
    return min(1.0, (step + 1) / config.warm_up, (config.steps - step) / tail)


def _save(out: Path, step: int, model: Mdm, average: dict[str, Tensor], optimizer: torch.optim.Optimizer) -> None:
    tensors = {"step": torch.tensor(step)}
    tensors |= {f"model.{k}": v for k, v in model.state_dict().items()}
    tensors |= {f"average.{k}": v for k, v in average.items()}
    for i, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{i}.{k}": v for k, v in state.items()}
    with replacing(out / "checkpoint.safetensors") as temporary:
        save_file({k: v.contiguous().cpu() for k, v in tensors.items()}, temporary)


def _resume(out: Path, model: Mdm, average: dict[str, Tensor], optimizer: torch.optim.Optimizer) -> int:
    path = out / "checkpoint.safetensors"
    if not path.exists():
        return 0
    tensors = load_file(path)
    model.load_state_dict({k[6:]: v for k, v in tensors.items() if k.startswith("model.")})
    for name in average:
        average[name].copy_(tensors[f"average.{name}"])
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        if name.startswith("optimizer."):
            _, i, key = name.split(".", 2)
            state.setdefault(int(i), {})[key] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
    return int(tensors["step"])


def main(
    corpus: Annotated[Path, tyro.conf.Positional], out: Annotated[Path, tyro.conf.Positional], config: TrainConfig
) -> None:
    """Train on `corpus` (made by motiongen.corpus), keeping checkpoints in the folder `out`."""
    train(config, corpora.load(corpus), out)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
