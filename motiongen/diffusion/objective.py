"""What a step is to learn from: a share of a batch, noised, put through the network and held against the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import torch
from torch import Tensor, nn

from motiongen.data.texts import Texts
from motiongen.diffusion.batches import Batches, Scale
from motiongen.diffusion.configs import TrainConfig
from motiongen.diffusion.levels import balanced_times, balanced_weights
from motiongen.diffusion.losses import loss
from motiongen.diffusion.motiondiffuse import noise_loss, noise_weight
from motiongen.diffusion.processes import Team
from motiongen.diffusion.schedule import LEVELS, SCHEDULES


@dataclass(frozen=True)
class Share:
    """A process's share of a batch; tensors as `Mdm.forward` takes them.

    `captions` (B); `action` (B,): the number of each clip's action, −1 for none; `whole` (N, T): the frames of all
    clips of the batch (see `Batch`).
    """

    x: Tensor
    frames: Tensor
    words: Tensor
    word_mask: Tensor
    sentence: Tensor
    action: Tensor
    whole: Tensor
    captions: tuple[str, ...]


Loaded = TypeVar("Loaded")


def load_share(batches: Batches, texts: Texts, actions: tuple[str, ...], team: Team, step: int) -> Share:
    """This process's share of the batch of a step, on the device."""
    batch = batches.draw(step, team.share)
    numbers = {name: i for i, name in enumerate(actions)}
    tensors = map(torch.from_numpy, (batch.x, batch.frames, *texts.batch(batch.captions)))
    action = torch.tensor([numbers.get(name, -1) for name in batch.actions])
    x, frames, words, word_mask, sentence, action, whole = (
        y.to(team.device) for y in (*tensors, action, torch.from_numpy(batch.whole))
    )
    return Share(x, frames, words, word_mask, sentence, action, whole, batch.captions)


def multiplies_in_bf16(config: TrainConfig, team: Team) -> bool:
    """Whether a run multiplies in bfloat16: as the config says, else where the device is made for it."""
    if config.bf16 is not None:
        return config.bf16
    return torch.cuda.is_bf16_supported() if team.device.type == "cuda" else torch.cpu._is_amx_tile_supported()


class Objective(Generic[Loaded]):
    """The loss of a network and its gradients. Compiles both first where the config says so."""

    def __init__(self, config: TrainConfig, model: nn.Module, scale: Scale, team: Team) -> None:
        self._config, self._model, self._team = config, model, team
        self._schedule, self._bf16 = SCHEDULES[config.schedule], multiplies_in_bf16(config, team)
        self._scale = tuple(torch.from_numpy(y).to(team.device) for y in (scale.mean, scale.std, scale.offsets))
        self._network: Callable[..., Tensor] = model
        self._geometric: Callable[..., dict[str, Tensor]] = loss
        if config.compile:
            self._network, self._geometric = torch.compile(model, dynamic=True), torch.compile(loss, dynamic=True)

    def differentiate(self, step: int, share: Loaded) -> dict[str, float]:
        """Loss terms by name, `total` among them, of the whole batch of a step; the model then has its gradients."""
        self._model.zero_grad()
        terms = self._terms(step, share)
        terms["total"].backward()
        told = [value.detach() for value in terms.values()]
        self._team.add_up([p.grad for p in self._model.parameters() if p.grad is not None])
        self._team.add_up(told)
        return dict(zip(terms, torch.stack(told).tolist(), strict=True))

    def _terms(self, step: int, share: Loaded) -> dict[str, Tensor]:
        """This process's part of the terms."""
        raise NotImplementedError


class ClipObjective(Objective[Share]):
    """The loss of a network that draws whole clips."""

    def _terms(self, step: int, share: Share) -> dict[str, Tensor]:
        """This process's part of the terms. All draw the noise of the whole batch, so that any number draw the same."""
        config, x = self._config, share.x
        torch.manual_seed(config.seed * 1_000_003 + step)
        t, no_text, no_action = torch.rand(3, len(share.whole))[:, self._team.share]
        t = (balanced_times(t) if config.balanced else t).clamp(min=1 / LEVELS)  # at 0 there is no noise to be told
        noise = torch.randn(*share.whole.shape, x.shape[-1], device=x.device)[self._team.share]
        if not self._team.first:
            torch.manual_seed(torch.initial_seed() + self._team.rank)  # what is dropped out differs
        alpha, sigma = (torch.from_numpy(y).to(x)[:, None, None] for y in self._schedule.levels(t.numpy()))
        keep = (no_text >= config.drop_text).to(x.device)
        action = torch.where((no_action < config.by_action).to(x.device), share.action, -1)
        with torch.autocast(x.device.type, torch.bfloat16, enabled=self._bf16):
            said = share.words, share.word_mask, share.sentence
            guess = self._network(alpha * x + sigma * noise, t.to(x), share.frames, *said, keep, action)
        if config.prediction == "noise":
            weight = noise_weight(alpha, sigma) if config.model.patch > 1 else torch.ones_like(alpha)
            return {"total": noise_loss(guess.float(), noise, share.frames, share.whole, weight[:, 0, 0])}
        weight = balanced_weights(t.to(x)) if config.balanced else torch.ones_like(x[:, 0, 0])
        return self._geometric(guess.float(), x, share.frames, share.whole, weight, *self._scale, config.weights)
