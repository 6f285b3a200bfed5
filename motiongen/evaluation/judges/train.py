"""Train an evaluator on the training clips of a data set; goes on from its last checkpoint.

python -m motiongen.evaluation.judges.train my-data runs/judge --kind guo
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import tyro

from motiongen.data.dataset import Dataset, open_dataset
from motiongen.diffusion.checkpoint import CHECKPOINT, resume, save_checkpoint
from motiongen.evaluation.judges.batches import Batches
from motiongen.evaluation.judges.guo import Guo, margin_loss
from motiongen.evaluation.judges.judge import About, Judge, Kind, build, default_config, save_judge
from motiongen.evaluation.judges.tmr import info_nce

JUDGE = "judge.safetensors"  # the file that `load_judge` reads


@dataclass(frozen=True)
class TrainConfig:
    """One run. The learning rate is warmed up, then falls to nothing along a cosine."""

    kind: Kind = "guo"
    steps: int = 600
    batch: int = 64
    rate: float = 1e-3
    warm_up: int = 100
    weight_decay: float = 0.02
    clip: float = 1.0
    seed: int = 0
    save_every: int = 100


def train(data: Dataset, out: Path, config: TrainConfig) -> Judge:
    """Train to `config.steps`, from the checkpoint in `out` where there is one; writes `judge.safetensors` there.

    Raises ValueError where the data set has fewer training clips than a batch, CheckpointError (a ValueError) where the
    checkpoint is damaged or of another kind; RuntimeError naming the step where the loss is no longer a number.
    """
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(config.seed)
    sizes = default_config(config.kind)
    network = build(config.kind, sizes)
    optimizer = torch.optim.AdamW(network.parameters(), lr=config.rate, weight_decay=config.weight_decay)
    first = resume(out / CHECKPOINT, {"model": network.state_dict()}, {"optimizer": optimizer})
    batches = Batches(data, config.kind, config.batch, config.seed)
    network.train()
    began, total = time.monotonic(), 0.0
    for step in range(first, config.steps):
        torch.manual_seed(config.seed * 1_000_003 + step)
        for group in optimizer.param_groups:
            group["lr"] = config.rate * _schedule(step, config)
        clips, texts, same = batches.draw(step)
        text, motion = network.embed_texts(*texts), network.embed_motions(*clips)
        loss = (margin_loss if isinstance(network, Guo) else info_nce)(text, motion, same)
        if not torch.isfinite(loss):
            raise RuntimeError(f"the loss is {loss.item()} at step {step}; the last checkpoint is good")
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), config.clip)
        optimizer.step()
        total += loss.item()
        if (step + 1) % config.save_every == 0 or step + 1 == config.steps:
            pace = (time.monotonic() - began) / (step + 1 - first)
            mean, total = total / (step % config.save_every + 1), 0.0
            print(f"step {step + 1}/{config.steps}  loss {mean:.4f}  {pace:.3f} s a step", flush=True)
            save_checkpoint(out / CHECKPOINT, step + 1, {"model": network.state_dict()}, {"optimizer": optimizer})
    entries = [e for e in data.entries if e.split == "train"]
    about = About(
        config.kind,
        sizes,
        tuple(sorted({e.source for e in entries})),
        tuple(sorted({e.licence for e in entries})),
        config.steps,
        config.seed,
    )
    judge = Judge(about, network, batches.mean, batches.std)
    save_judge(judge, out / JUDGE)
    return judge


def _schedule(step: int, config: TrainConfig) -> float:
    return min(1.0, (step + 1) / config.warm_up) * 0.5 * (1 + np.cos(np.pi * step / config.steps))


def main(
    dataset: Annotated[Path, tyro.conf.Positional], out: Annotated[Path, tyro.conf.Positional], config: TrainConfig
) -> None:
    """Train an evaluator on the data set in the folder DATASET, keeping checkpoints and the result in OUT."""
    train(open_dataset(dataset), out, config)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
