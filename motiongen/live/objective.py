"""What a live network is to learn from: a chunk noised after a history that is not, and where it should go.

Some histories it has drawn itself, so that it meets in training what it meets on stage ("scheduled" training, as in
DART, Zhao et al. 2024). It draws them from the true past under more or less noise, so that the true chunk still follows
from them; what they differ from the truth at their end dies away in the target by a cubic, as in an inertialized seam.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from motiongen.data.texts import Texts
from motiongen.diffusion.configs import LiveConfig, MdmConfig, TrainConfig
from motiongen.diffusion.levels import balanced_times, balanced_weights
from motiongen.diffusion.losses import joint_positions
from motiongen.diffusion.objective import Objective
from motiongen.diffusion.processes import Team
from motiongen.diffusion.schedule import COSINE, LEVELS
from motiongen.features import CONTACTS
from motiongen.live import steering
from motiongen.live.windows import Windows

SETTLE = 15  # frames after which a chunk is as the truth is
NOISY = 0.6  # least noise under which the past is drawn anew; half of the pasts are drawn from noise alone
AGAIN = 0.45  # of its noise is left for the second of the two passes that draw it


@dataclass(frozen=True)
class LiveShare:
    """A process's share of a batch of windows; tensors as `Mdm.forward` takes them.

    `x` (B, P + H + C, 140); `frames` (B, H + C); `rolled` (R,): the rows whose history is drawn, and what was said
    then: `before` words (R, …), mask and sentence; `whole` (N, H + C): the frames of all windows of the batch.
    """

    x: Tensor
    frames: Tensor
    words: Tensor
    word_mask: Tensor
    sentence: Tensor
    rolled: Tensor
    before: tuple[Tensor, Tensor, Tensor] | None
    whole: Tensor
    captions: tuple[str, ...]


def load_live_share(windows: Windows, texts: Texts, config: TrainConfig, team: Team, step: int) -> LiveShare:
    """This process's share of the batch of a step, on the device."""
    drawn, live = windows.draw(step, team.share), config.live or LiveConfig()
    chance = np.random.default_rng([config.seed, step, 1]).random(len(drawn.whole))[team.share]
    rolled = np.flatnonzero(drawn.unbroken & (chance < live.rollouts)) if step >= live.truth else np.zeros(0, int)
    before = None
    if len(rolled):
        heard, mask, meant = (
            torch.from_numpy(y).to(team.device) for y in texts.batch([drawn.before[i] for i in rolled])
        )
        before = heard, mask, meant
    x, frames, words, word_mask, sentence, rows, whole = (
        torch.from_numpy(y).to(team.device)
        for y in (drawn.x, drawn.frames, *texts.batch(drawn.captions), rolled, drawn.whole)
    )
    return LiveShare(x, frames, words, word_mask, sentence, rows, before, whole, drawn.captions)


class LiveObjective(Objective[LiveShare]):
    """The loss of a live network and its gradients."""

    def _terms(self, step: int, share: LiveShare) -> dict[str, Tensor]:
        """This process's part of the terms. All draw the noise of the whole batch, so that any number draw the same."""
        config, live, model = self._config, self._config.live, self._config.model
        if live is None or not isinstance(model, MdmConfig):
            raise ValueError("no config of a live network")
        chunk, history, count = live.chunk, model.history, len(share.whole)
        torch.manual_seed(config.seed * 1_000_003 + step)
        chance = torch.rand(6, count)[:, self._team.share]
        at = torch.randint(chunk, (2, count))[:, self._team.share]
        noise = torch.randn(count, chunk, share.x.shape[-1], device=share.x.device)[self._team.share]
        past, truth = share.x[:, chunk : chunk + history], share.x[:, chunk + history :]
        if share.before is not None:
            past, truth = self._rolled(share, past, truth, history, chunk)
        t = (balanced_times(chance[0]) if config.balanced else chance[0]).clamp(min=1 / LEVELS)
        x = torch.cat([past, self._noised(truth, noise, t)], dim=1)
        keep = (chance[1] >= config.drop_text).to(x.device)
        given = chance[2:5] < torch.tensor([[live.steer_root], [live.steer_hand], [live.steer_hand]])
        steer = self._steering(past, truth, given.to(x.device), at.to(x.device))
        with torch.autocast(x.device.type, torch.bfloat16, enabled=self._bf16):
            said = share.words, share.word_mask, share.sentence
            guess = self._network(x, t.to(x), share.frames, *said, keep, None, steer).float()
        clean = torch.cat([past, truth], dim=1)
        guess = torch.cat([past, guess[:, history:]], dim=1)
        counts, of_all = share.frames.clone(), share.whole.clone()
        counts[:, : history - 1] = of_all[:, : history - 1] = False  # the last frame counts: from there on it goes
        weight = balanced_weights(t.to(x)) if config.balanced else torch.ones_like(x[:, 0, 0])
        return self._geometric(guess, clean, counts, of_all, weight, *self._scale, config.weights)

    def _noised(self, x: Tensor, noise: Tensor, t: Tensor) -> Tensor:
        alpha, sigma = (torch.from_numpy(y).to(x)[:, None, None] for y in COSINE.levels(t.numpy()))
        return alpha * x + sigma * noise

    @torch.no_grad()
    def _rolled(self, share: LiveShare, past: Tensor, truth: Tensor, history: int, chunk: int) -> tuple[Tensor, Tensor]:
        """Past and truth with the rows of `share.rolled` as the network itself goes on from further back."""
        if share.before is None:
            return past, truth
        x = share.x[share.rolled]
        first, clean = x[:, :history], x[:, history : history + chunk]
        t = torch.rand(len(x))
        t = torch.where(t < 0.5, torch.ones_like(t), NOISY + (1 - NOISY) * (2 * t - 1))
        frames = torch.ones(x.shape[0], history + chunk, dtype=torch.bool, device=x.device)
        keep = frames[:, 0]
        steer = torch.zeros(*frames.shape, steering.WIDTH, device=x.device)
        noisy = self._noised(clean, torch.randn_like(clean), t)
        for level, last in ((t, False), (t * AGAIN, True)):
            with torch.autocast(x.device.type, torch.bfloat16, enabled=self._bf16):
                told = torch.cat([first, noisy], dim=1), level.to(x), frames, *share.before, keep, None, steer
                drawn = self._model(*told).float()[:, history:]
            if not last:
                noisy = self._noised(drawn, torch.randn_like(drawn), t * AGAIN)
        drawn = drawn[:, chunk - history :]
        past, truth = past.clone(), truth.clone()
        off = drawn[:, -2:] - past[share.rolled, -2:]
        past[share.rolled] = drawn
        truth[share.rolled] += settling(off, chunk)
        return past, truth

    def _steering(self, past: Tensor, truth: Tensor, given: Tensor, at: Tensor) -> Tensor:
        """(B, H + C, 12) with the groups of `given` (3, B) told; hands from frame `at` (2, B) of the chunk on."""
        batch, history, chunk = len(past), past.shape[1], truth.shape[1]
        out = past.new_zeros(batch, history + chunk, steering.WIDTH)
        told = out[:, history:]
        root = torch.cat([past, truth], dim=1)[..., steering.ROOT].mT
        even = F.avg_pool1d(root, steering.SWAY, 1, steering.SWAY // 2, count_include_pad=False).mT[:, history:]
        told[..., steering.ROOT] = even * given[0, :, None, None]
        told[..., steering.ROOT_GIVEN] = given[0, :, None].float()
        mean, std, offsets = self._scale
        wrists = joint_positions(truth * std + mean, offsets)[:, :, steering.WRISTS] / steering.METRES
        frames = torch.arange(chunk, device=past.device)
        for hand, (place, flag) in enumerate(zip(steering.HANDS, steering.HANDS_GIVEN, strict=True)):
            now = (given[1 + hand, :, None] & (frames >= at[hand, :, None])).float()
            told[..., place] = wrists[:, :, hand] * now[..., None]
            told[..., flag] = now
        return out


def settling(off: Tensor, count: int) -> Tensor:
    """(B, count, 140) to add to the frames after two that were `off` (B, 2, 140): the last offset and its rate die away
    by a cubic within `SETTLE` frames; contacts are left."""
    u = torch.arange(1, count + 1, device=off.device, dtype=off.dtype).clamp(max=SETTLE)[:, None] / SETTLE
    rate = (off[:, 1:] - off[:, :1]) * SETTLE
    out = off[:, 1:] * (1 - 3 * u**2 + 2 * u**3) + rate * (u - 2 * u**2 + u**3)
    out[..., CONTACTS] = 0.0
    return out
