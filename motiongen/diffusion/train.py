"""Train a text-to-motion network on a data set; goes on from its last checkpoint as if it had never stopped.

What a step draws depends on its number and the seed alone. Under `torchrun` every process takes its share of each
batch, and gradients add up to those of the whole. Only torch, numpy and safetensors are imported, so that it runs
wherever they are; `rigcast train` puts the bar, the log and the films around it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean
from typing import Any

import torch
from torch import Tensor, nn
from torch.func import functional_call
from torch.optim.swa_utils import get_ema_multi_avg_fn

from motiongen.data.dataset import Dataset
from motiongen.data.free import free_only
from motiongen.data.texts import Texts, data_texts
from motiongen.diffusion.batches import Batches
from motiongen.diffusion.checkpoint import CHECKPOINT, resume, save_checkpoint
from motiongen.diffusion.configs import DiffusionPhaseConfig, TrainConfig, require_sound
from motiongen.diffusion.lessons import Source, lesson, objective_of, open_source
from motiongen.diffusion.objective import multiplies_in_bf16
from motiongen.diffusion.processes import Team, join
from motiongen.diffusion.run_folder import Run, open_run, read_run
from motiongen.diffusion.samples import draw_samples, pick_prompts
from motiongen.motion import Motion
from motiongen.phase.first_stage import open_all_codes


@dataclass(frozen=True)
class Log:
    """Where a run is. `terms`: means since the last log of the loss terms and of the `norm` of the gradients before
    clipping; `rate` of learning; `pace` in seconds a step."""

    step: int
    steps: int
    terms: dict[str, float]
    rate: float
    pace: float

    @property
    def left(self) -> float:
        """Seconds to the end at this pace."""
        return (self.steps - self.step) * self.pace


@dataclass(frozen=True)
class Watch:
    """Who is told what on the way; under `torchrun`, by the first process alone.

    `say`: a line about the run; `encoded`, `joined`, `coded`: how many captions, joined motions, or stretches, of how
    many; `logged`: every `log_every` steps; `drawn`: every `show_every` steps, what the averaged network draws for
    fixed captions (see `pick_prompts`).
    """

    say: Callable[[str], None] = lambda line: None
    encoded: Callable[[int, int], None] = lambda done, of: None
    joined: Callable[[int, int], None] = lambda done, of: None
    coded: Callable[[int, int], None] = lambda done, of: None
    logged: Callable[[Log], None] = lambda log: None
    drawn: Callable[[int, list[Motion]], None] | None = None


def train(config: TrainConfig, data: Dataset, out: Path, watch: Watch | None = None) -> None:
    """Train to `config.steps`, from the checkpoint in `out` where there is one, and keep checkpoints there.

    Raises ValueError for an unsound config, or more processes than clips in a batch, or where no clip is short enough;
    DatasetError where no clip may be used; RunError where the run in `out` is of another network or damaged, and
    CheckpointError for its checkpoint; RuntimeError naming the batch where the loss is no longer a number (the last
    checkpoint is then good).
    """
    require_sound(config)
    if not any(entry.split == "train" for entry in data.entries):
        raise ValueError(f"{data.folder}: no training clip; all are of other splits")
    with join() as team:
        if team.size > config.batch:
            raise ValueError(f"a batch of {config.batch} clips cannot be shared by {team.size} processes")
        _train(config, free_only(data) if config.free else data, out, team, watch if team.first and watch else Watch())


def _train(config: TrainConfig, data: Dataset, out: Path, team: Team, watch: Watch) -> None:
    run, source, texts = _open(config, data, out, team, watch)
    torch.manual_seed(config.seed)
    model, load = lesson(config, run, source, texts, out, team)
    average = {k: v.detach().clone() for k, v in model.state_dict().items()}
    optimizers = _optimizers(model, config)
    networks = {"model": model.state_dict(), "average": average}
    saved = first = resume(out / CHECKPOINT, networks, optimizers)
    watch.say(_about(model, config, team, len(data), first))
    objective = objective_of(config, model, run.scale, team)
    prompts = pick_prompts(data, texts, config.seed)
    since: list[dict[str, float]] = []  # terms of the steps since the last log
    began = time.monotonic()
    for step, share in _ahead(load, first, config.steps):
        rate = config.rate * _warmth(step, config)
        terms = objective.differentiate(step, share)
        terms["norm"] = float(torch.nn.utils.clip_grad_norm_(model.parameters(), config.clip))
        if not all(map(math.isfinite, terms.values())):
            raise RuntimeError(_not_a_number(step, terms, share.captions, saved))
        for optimizer in optimizers.values():
            optimizer.param_groups[0]["lr"] = rate
            optimizer.step()
        pull = min(config.ema, (step + 1) / (step + 10))
        get_ema_multi_avg_fn(pull)(list(average.values()), list(networks["model"].values()), step)
        since.append(terms)
        done = step + 1
        if done % config.log_every == 0:
            means = {name: fmean(each[name] for each in since) for name in terms}
            watch.logged(Log(done, config.steps, means, rate, (time.monotonic() - began) / len(since)))
            since, began = [], time.monotonic()
        if done % config.save_every == 0 or done == config.steps:
            saved = done
            if team.first:
                save_checkpoint(out / CHECKPOINT, saved, networks, optimizers)
        if watch.drawn and config.show_every and done % config.show_every == 0:
            paused = time.monotonic()
            averaged = partial(_averaged, model, average)
            watch.drawn(done, draw_samples(averaged, prompts, config, run.scale, team.device))
            began += time.monotonic() - paused
    watch.say(f"{out / CHECKPOINT}: {saved} steps done")


def _open(config: TrainConfig, data: Dataset, out: Path, team: Team, watch: Watch) -> tuple[Run, Source, Texts]:
    """The run's folder and what it learns from; the first process alone writes, and the others wait for it."""
    if team.first:
        open_run(out, config, data)
        source = open_source(config, data, read_run(out).scale, out, watch.joined)
        data_texts(data, source.captions(), progress=watch.encoded)
        if isinstance(config.model, DiffusionPhaseConfig) and isinstance(source, Batches):
            open_all_codes(config.model, out, source, config.seed, watch.coded)
    team.wait()
    run = read_run(out)
    source = open_source(config, data, run.scale, out)
    return run, source, data_texts(data, source.captions())


def _averaged(model: nn.Module, average: dict[str, Tensor], *inputs: Tensor) -> Tensor:
    """What the network makes of `inputs` with the averaged weights, nothing dropped."""
    model.eval()
    made: Tensor = functional_call(model, average, inputs)
    model.train()
    return made


def _optimizers(model: nn.Module, config: TrainConfig) -> dict[str, torch.optim.Optimizer]:
    """AdamW; or Muon for the matrices (Jordan et al. 2024), which moves rare directions as far as common ones, as most
    gestures are rare. Its steps are as large as AdamW's (Liu et al. 2025, Sec. 2.2), which all else is left to."""
    named = {name: p for name, p in model.named_parameters() if p.requires_grad}
    matrices = {n for n, p in named.items() if p.ndim == 2 and config.muon and not n.startswith("action.")}
    others = [p for n, p in named.items() if n not in matrices]
    decay = config.weight_decay
    out: dict[str, torch.optim.Optimizer] = {"optimizer": torch.optim.AdamW(others, weight_decay=decay, fused=True)}
    if matrices:
        each = [named[n] for n in named if n in matrices]
        out["muon"] = torch.optim.Muon(each, weight_decay=decay, adjust_lr_fn="match_rms_adamw")
    return out


def _ahead(load: Callable[[int], Any], first: int, steps: int) -> Iterator[tuple[int, Any]]:
    """Every step's share of its batch, each loaded while the one before is learnt from."""
    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(load, first)
        for step in range(first, steps):
            share = coming.result()
            coming = pool.submit(load, step + 1)
            yield step, share


def _warmth(step: int, config: TrainConfig) -> float:
    """What share of the full learning rate step number `step` has: up to 1, then to nothing at the end."""
    tail = max(1, round(config.decay * config.steps))
    return min(1.0, (step + 1) / max(1, config.warm_up), (config.steps - step) / tail)


def _about(model: nn.Module, config: TrainConfig, team: Team, clips: int, first: int) -> str:
    millions = sum(p.numel() for p in model.parameters()) / 1e6
    device = torch.cuda.get_device_name(team.device) if team.device.type == "cuda" else "CPU"
    place = f"{team.size} × {device}" if team.size > 1 else device
    width = "bfloat16" if multiplies_in_bf16(config, team) else "float32"
    return f"{millions:.2f} M parameters on {place} in {width}; {clips} clips; from step {first} to {config.steps}"


def _not_a_number(step: int, terms: dict[str, float], captions: Sequence[str], saved: int) -> str:
    good = f"the checkpoint of step {saved} is good" if saved else "there is no checkpoint yet"
    found = f"the loss is {terms['total']}, the gradients' norm {terms['norm']}"
    return f"{found} at batch {step} ({'; '.join(captions[:3])}; …); {good}"
