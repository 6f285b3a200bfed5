"""Train the text-to-motion model on a data set; resumes from its last checkpoint.

python -m motiongen.diffusion.train runs/data runs/mdm --steps 12000
"""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated

import torch
import tyro
from rich.progress import Progress
from safetensors.numpy import load_file as load_arrays
from safetensors.numpy import save_file as save_arrays
from safetensors.torch import load_file, save_file
from torch import Tensor

from motiongen.data.dataset import Dataset, open_dataset
from motiongen.data.texts import Texts, data_texts
from motiongen.diffusion.batches import Batches, Scale, actions_of, scale_of
from motiongen.diffusion.losses import LossWeights, loss
from motiongen.diffusion.mdm import Mdm, MdmConfig
from motiongen.diffusion.schedule import COSINE
from motiongen.files import replacing


@dataclass(frozen=True)
class TrainConfig:
    """One run. Learning rate: warmed up, held, then linear to nothing over the last `decay` of the steps."""

    steps: int = 12000
    batch: int = 48
    rate: float = 3e-4
    warm_up: int = 200
    decay: float = 0.25
    weight_decay: float = 0.01
    clip: float = 1.0
    ema: float = 0.999
    drop_text: float = 0.1
    by_action: float = 0.1
    bf16: bool = False
    compile: bool = False
    seed: int = 0
    save_every: int = 200
    log_every: int = 50
    model: MdmConfig = field(default_factory=MdmConfig)
    weights: LossWeights = field(default_factory=LossWeights)


def train(config: TrainConfig, data: Dataset, out: Path) -> None:
    """Train to `config.steps`, from the checkpoint in `out` where there is one, and keep checkpoints there.

    Raises RuntimeError naming the step where the loss is no longer a number; the last checkpoint is then good.
    """
    out.mkdir(parents=True, exist_ok=True)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    torch.manual_seed(config.seed)
    actions = _actions(data, out)
    model = Mdm(replace(config.model, actions=len(actions))).to(device)
    print(f"{sum(p.numel() for p in model.parameters()) / 1e6:.2f} M parameters on {device}", flush=True)
    average = {k: v.detach().clone() for k, v in model.state_dict().items()}
    denoise, measure = (torch.compile(f, dynamic=True) for f in (model, loss)) if config.compile else (model, loss)
    optimizer = torch.optim.AdamW(model.parameters(), lr=config.rate, weight_decay=config.weight_decay, fused=True)
    scale = _scale(data, out)
    batches = Batches(data, scale, size=config.batch, patch=config.model.patch, seed=config.seed)
    texts = _encode(batches.captions(), data)
    mean, std, offsets = (torch.from_numpy(y).to(device) for y in (scale.mean, scale.std, scale.offsets))
    first = _resume(out, model, average, optimizer)
    (out / "config.json").write_text(json.dumps(asdict(config), indent=1))
    began = time.monotonic()
    sums: dict[str, float] = {}
    for step in range(first, config.steps):
        for group in optimizer.param_groups:
            group["lr"] = config.rate * _schedule(step, config)
        torch.manual_seed(config.seed * 1_000_003 + step)
        batch = batches.draw(step)
        x, frames, words, word_mask, sentence = (
            torch.from_numpy(y).to(device) for y in (batch.x, batch.frames, *texts.batch(batch.captions))
        )
        t, keep = torch.rand(len(x)), torch.rand(len(x), device=device) >= config.drop_text
        named = [actions.index(name) if name else -1 for name in batch.actions]
        action = torch.tensor(named, device=device)
        action[torch.rand(len(x), device=device) >= config.by_action] = -1
        alpha, sigma = (torch.from_numpy(y).to(x)[:, None, None] for y in COSINE.levels(t.numpy()))
        noisy = alpha * x + sigma * torch.randn_like(x)
        with torch.autocast(device.type, torch.bfloat16, enabled=config.bf16):
            guess = denoise(noisy, t.to(device), frames, words, word_mask, sentence, keep, action)
        terms = measure(guess.float(), x, frames, mean, std, offsets, config.weights)
        if not torch.isfinite(terms["total"]):
            raise RuntimeError(f"the loss is {terms['total'].item()} at step {step}; the last checkpoint is good")
        optimizer.zero_grad()
        terms["total"].backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), config.clip)
        optimizer.step()
        pull = 1 - min(config.ema, (step + 1) / (step + 10))
        torch._foreach_lerp_(list(average.values()), [v.detach() for v in model.state_dict().values()], pull)
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


def _scale(data: Dataset, out: Path) -> Scale:
    """The run's own scale: it stays as it was when the run began, should the data set grow."""
    path = out / "scale.safetensors"
    if not path.exists():
        with replacing(path) as temporary:
            save_arrays(asdict(scale_of(data)), temporary)
    return Scale(**load_arrays(path))


def _actions(data: Dataset, out: Path) -> tuple[str, ...]:
    """The run's own list of actions, as `_scale`."""
    path = out / "actions.json"
    if not path.exists():
        path.write_text(json.dumps(actions_of(data), indent=1))
    return tuple(json.loads(path.read_text()))


def _encode(captions: list[str], data: Dataset) -> Texts:
    with Progress(transient=True) as bar:
        task = bar.add_task("encoding captions")
        return data_texts(data, captions, progress=lambda done, of: bar.update(task, completed=done, total=of))


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
    dataset: Annotated[Path, tyro.conf.Positional], out: Annotated[Path, tyro.conf.Positional], config: TrainConfig
) -> None:
    """Train on `dataset` (made by rigcast data build), keeping checkpoints in the folder `out`."""
    train(config, open_dataset(dataset), out)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
