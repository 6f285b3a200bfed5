"""The folder of a training run: all that a run needs to go on, and to be made into a weights file.

| file | holds |
|---|---|
| `config.json` | the config (see `configs.py`) |
| `scale.safetensors`, `actions.json` | what numbers and action numbers mean; as they were when the run began |
| `checkpoint.safetensors` | see `checkpoint.py` |
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.numpy import load_file, save_file

from motiongen.data.dataset import Dataset
from motiongen.diffusion.batches import Scale, actions_of, scale_of
from motiongen.diffusion.configs import DiffusionPhaseConfig, TrainConfig
from motiongen.diffusion.weights import load_weights, weights_path
from motiongen.files import replacing


class RunError(ValueError):
    """A folder that is no training run, or of another one; the message names it."""


@dataclass(frozen=True)
class Run:
    """What a run's folder says; `config` as in the file, with the name of the `network`."""

    config: dict[str, Any]
    scale: Scale
    actions: tuple[str, ...]


def open_run(out: Path, config: TrainConfig, data: Dataset) -> Run:
    """The run in `out`, begun where there is none; its config is from now on `config`.

    Raises RunError where the run there has another network, naming what differs, or is damaged; WeightsError where the
    weights to begin with are.
    """
    out.mkdir(parents=True, exist_ok=True)
    new = {"network": config.model.network} | asdict(config)
    if (out / "config.json").exists():
        _refuse_another(out, _read_json(out / "config.json"), new)
    if not (out / "scale.safetensors").exists():
        with replacing(out / "scale.safetensors") as temporary:
            save_file(asdict(_scale(config, data)), temporary)
    if not (out / "actions.json").exists():
        _write_json(out / "actions.json", actions_of(data) if config.by_action else ())
    _write_json(out / "config.json", new)
    return read_run(out)


def _scale(config: TrainConfig, data: Dataset) -> Scale:
    """What numbers mean in that which a run begins with, they mean in the run, too."""
    if isinstance(config.model, DiffusionPhaseConfig):
        return read_run(Path(config.model.autoencoder)).scale
    if config.begin:
        found = load_weights(weights_path(config.begin))
        return Scale(found.mean, found.std, found.offsets)
    return scale_of(data)


def read_run(out: Path) -> Run:
    """The run in `out`; raises RunError where there is none, or it is damaged."""
    if not (out / "config.json").is_file():
        raise RunError(f"{out}: no training run (no config.json in it); rigcast train makes one")
    try:
        scale = Scale(**load_file(out / "scale.safetensors"))
    except (SafetensorError, OSError, TypeError):
        raise RunError(f"{out / 'scale.safetensors'}: missing or damaged; begin the run anew") from None
    return Run(_read_json(out / "config.json"), scale, tuple(_read_json(out / "actions.json")))


def _refuse_another(out: Path, old: dict[str, Any], new: dict[str, Any]) -> None:
    """Fields that the run's config does not have are taken to agree: its tensors are held against the network's too."""
    for name in ("network", "schedule", "prediction", "free", *(f"model.{field}" for field in new["model"])):
        before, now = _field(old, name), _field(new, name)
        if before is not None and before != now:
            raise RunError(f"{out}: holds a run with {name} {before}, not {now}; name another folder")


def _field(config: dict[str, Any], name: str) -> Any:
    group, _, field = name.rpartition(".")
    return (config.get(group, {}) if group else config).get(field)


def _read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise RunError(f"{path}: missing or damaged; begin the run anew") from None


def _write_json(path: Path, content: object) -> None:
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1), encoding="utf-8")
