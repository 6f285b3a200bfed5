"""What each kind of network learns from and by: where its batches come from, how it begins, what its loss is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import nn

from motiongen.data.dataset import Dataset
from motiongen.data.texts import Texts
from motiongen.diffusion.batches import Batches, Scale
from motiongen.diffusion.configs import (
    DiffusionPhaseConfig,
    MdmConfig,
    MotionDiffuseConfig,
    PhaseAutoencoderConfig,
    Sizes,
    TrainConfig,
)
from motiongen.diffusion.mdm import Mdm
from motiongen.diffusion.motiondiffuse import MotionDiffuse
from motiongen.diffusion.objective import ClipObjective, Objective, load_share
from motiongen.diffusion.processes import Team
from motiongen.diffusion.run_folder import Run, RunError
from motiongen.diffusion.weights import load_weights, weights_path
from motiongen.live.joined import open_joined
from motiongen.live.objective import LiveObjective, load_live_share
from motiongen.live.windows import Windows
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Skeleton
from motiongen.phase.autoencoder import PhaseAutoencoder
from motiongen.phase.denoiser import PhaseDenoiser
from motiongen.phase.first_stage import open_all_codes, read_first_stage
from motiongen.phase.objective import AutoencoderObjective, PhaseObjective, load_codes, load_segments

Source = Batches | Windows
Progress = Callable[[int, int], None]


def _untold(done: int, of: int) -> None:
    pass


def open_source(config: TrainConfig, data: Dataset, scale: Scale, out: Path, joined: Progress = _untold) -> Source:
    """Where batches come from. Joined motions are made in `out` where they are not there; how many of how many is told
    to `joined`. Raises ValueError where no clip is short, or long, enough."""
    model, live = config.model, config.live
    if live is None or not isinstance(model, MdmConfig):
        return Batches(data, scale, size=config.batch, patch=model.patch, seed=config.seed)
    foot_height = next(e.foot_height for e in data.entries if e.split == "train")
    skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, scale.offsets.astype(float), foot_height)
    motions = open_joined(data, skeleton, out, count=live.motions, seed=config.seed, progress=joined)
    return Windows(data, motions, scale, size=config.batch, history=model.history, live=live, seed=config.seed)


def lesson(
    config: TrainConfig, run: Run, source: Source, texts: Texts, out: Path, team: Team
) -> tuple[nn.Module, Callable[[int], Any]]:
    """The network as it begins, on the device, and what loads this process's share of the batch of a step for it.

    Raises RunError where what it begins with is of other sizes.
    """
    sizes = config.model
    if isinstance(source, Windows):
        model = _begun(build(sizes), config.begin)
        return model.to(team.device), partial(load_live_share, source, texts, config, team)
    if isinstance(sizes, PhaseAutoencoderConfig):
        return build(sizes).to(team.device), partial(load_segments, source, sizes, config, team)
    if isinstance(sizes, DiffusionPhaseConfig):
        codes = open_all_codes(sizes, out, source, config.seed, _untold)
        model = build(sizes)
        model.load_state_dict(
            {"center": torch.from_numpy(codes.center), "spread": torch.from_numpy(codes.spread)}, False
        )
        kernel = read_first_stage(Path(sizes.autoencoder)).sizes.kernel
        return model.to(team.device), partial(load_codes, codes, sizes, kernel, texts, config, team)
    model = _begun(build(replace(sizes, actions=len(run.actions))), config.begin)
    return model.to(team.device), partial(load_share, source, texts, run.actions, team)


def build(sizes: Sizes) -> nn.Module:
    """The network of such sizes, untrained, but for an auto-encoder that was before; of that raises RunError."""
    if isinstance(sizes, MdmConfig):
        return Mdm(sizes)
    if isinstance(sizes, MotionDiffuseConfig):
        return MotionDiffuse(sizes)
    if isinstance(sizes, PhaseAutoencoderConfig):
        return PhaseAutoencoder(sizes)
    first = read_first_stage(Path(sizes.autoencoder))
    model = PhaseDenoiser(sizes, first.sizes)
    model.autoencoder.load_state_dict({name: torch.from_numpy(y) for name, y in first.tensors.items()})
    return model


def _begun(model: nn.Module, name: str) -> nn.Module:
    """`model` with the tensors of a weights file, where one is named; what only one of them has is left as it is.

    Raises RunError where a tensor is of another shape.
    """
    found = load_weights(weights_path(name)).tensors if name else {}
    own = model.state_dict()
    for key in own.keys() & found.keys():
        if own[key].shape != found[key].shape:
            raise RunError(f"begin {name}: {key} is {found[key].shape}, not {tuple(own[key].shape)}")
        own[key].copy_(torch.from_numpy(found[key]))
    return model


def objective_of(config: TrainConfig, model: nn.Module, scale: Scale, team: Team) -> Objective[Any]:
    """The loss of a network and its gradients."""
    if isinstance(model, PhaseAutoencoder):
        return AutoencoderObjective(config, model, scale, team)
    if isinstance(model, PhaseDenoiser):
        return PhaseObjective(config, model, scale, team)
    return (LiveObjective if config.live else ClipObjective)(config, model, scale, team)
