"""Checkpoints of training runs: one safetensors file that holds all it takes to go on.

| tensor | holds |
|---|---|
| `step` | how many steps are done |
| `model.NAME`, and by any other name that the caller gives, as `average.NAME` | tensors of a network |
| `optimizer.I.NAME`, and by any other name | what an optimizer keeps for its I-th parameter |

No state of a random generator is in it: what a step draws has to depend on its number alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from motiongen.files import replacing

CHECKPOINT = "checkpoint.safetensors"  # in a run's folder
Networks = Mapping[str, Mapping[str, Tensor]]
Optimizers = Mapping[str, torch.optim.Optimizer]  # none by the name of a network


class CheckpointError(ValueError):
    """A checkpoint that is damaged or of another network; the message names it."""


def save_checkpoint(path: Path, step: int, networks: Networks, optimizers: Optimizers) -> None:
    """Write a checkpoint after `step` steps, under another name first: one that is there is whole."""
    tensors = {"step": torch.tensor(step)} | _named(networks)
    for name, optimizer in optimizers.items():
        for i, state in optimizer.state_dict()["state"].items():
            tensors |= {f"{name}.{i}.{k}": v for k, v in state.items()}
    with replacing(path) as temporary:
        save_file({k: v.contiguous().cpu() for k, v in tensors.items()}, temporary)


def read_checkpoint(path: Path) -> dict[str, Tensor]:
    """All tensors of a checkpoint; raises CheckpointError where it is missing or damaged."""
    if not path.is_file():
        raise CheckpointError(f"{path}: no such checkpoint")
    try:
        tensors = load_file(path)
        if tensors["step"].numel() == 1:
            return tensors
    except (SafetensorError, KeyError):
        pass
    raise CheckpointError(f"{path}: cut short or no checkpoint of a training run; remove it or name another folder")


def resume(path: Path, networks: Networks, optimizers: Optimizers) -> int:
    """Put a checkpoint's tensors into `networks` and `optimizers`, and tell its step; 0 where there is no checkpoint.

    Raises CheckpointError where it is damaged or its tensors are not those of `networks`; nothing is changed then.
    """
    if not path.exists():
        return 0
    found = read_checkpoint(path)
    expected = _named(networks)
    states: dict[str, dict[int, dict[str, Tensor]]] = {name: {} for name in optimizers}
    for name in [n for n in found if n.partition(".")[0] in optimizers]:
        whose, i, key = name.split(".", 2)
        states[whose].setdefault(int(i), {})[key] = found.pop(name)
    step = int(found.pop("step"))
    for name in sorted(found.keys() ^ expected.keys()):
        raise _of_another(path, f"{name} is in {'it' if name in found else 'this one'} only")
    for name, tensor in expected.items():
        if found[name].shape != tensor.shape:
            raise _of_another(path, f"{name} is {tuple(found[name].shape)}, not {tuple(tensor.shape)}")
    with torch.no_grad():
        for name, tensor in expected.items():
            tensor.copy_(found[name])
    for name, optimizer in optimizers.items():
        optimizer.load_state_dict({"state": states[name], "param_groups": optimizer.state_dict()["param_groups"]})
    return step


def _named(networks: Networks) -> dict[str, Tensor]:
    return {f"{name}.{key}": tensor for name, tensors in networks.items() for key, tensor in tensors.items()}


def _of_another(path: Path, why: str) -> CheckpointError:
    return CheckpointError(f"{path}: of another network ({why}); name another folder")
