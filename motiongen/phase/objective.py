"""What DiffusionPhase's two networks learn from: stretches of clips with their segments; codes of such stretches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from motiongen.data.texts import Texts
from motiongen.diffusion.batches import Batches, Scale
from motiongen.diffusion.configs import DiffusionPhaseConfig, PhaseAutoencoderConfig, TrainConfig
from motiongen.diffusion.objective import Objective
from motiongen.diffusion.processes import Team
from motiongen.phase.autoencoder import margin
from motiongen.phase.codes import Codes, held, segmented
from motiongen.phase.denoiser import PhaseDenoiser
from motiongen.phase.phases import Course, Timing, course, readings

NEAR_NOTHING = 1e-3  # weight of the squares of codes: so a number that says nothing is left at 0
MEANT = 0.5  # weight of what codes mean, beside what they are
WINDOW = 48  # frames of a motion that are decoded for it


@dataclass(frozen=True)
class SegmentShare:
    """A process's share of a batch of stretches, for the auto-encoder: `x` (B, T, features); `frames` (B, T) that
    count, `whole` (N, T) those of all clips of the batch; the rest as `PhaseAutoencoder.forward` takes it."""

    x: Tensor
    frames: Tensor
    whole: Tensor
    read: Tensor
    shares: Tensor
    at: Course
    captions: tuple[str, ...]


@dataclass(frozen=True)
class CodeShare:
    """A process's share of a batch of codes, for the denoiser. `x` (B, width), normalised; `at`: courses of a window of
    each of the first few motions, with the margin's frames, and `frames` of these windows that count; the rest as
    `PhaseDenoiser.forward` takes it."""

    x: Tensor
    pose: Tensor
    counts: Tensor
    words: Tensor
    word_mask: Tensor
    sentence: Tensor
    at: Course
    frames: Tensor
    captions: tuple[str, ...]


def load_segments(
    batches: Batches, sizes: PhaseAutoencoderConfig, config: TrainConfig, team: Team, step: int
) -> SegmentShare:
    """This process's share of the batch of a step, on the device."""
    batch = batches.draw(step, team.share)
    timing = segmented(batch, config.seed, step)
    length, edge = batch.x.shape[1], margin(sizes.kernel)
    read = readings(timing, length, sizes.highest)
    at = course(timing, np.arange(-edge, length + edge))
    arrays = held(batch), batch.frames, batch.whole, read, timing.shares
    x, frames, whole, read_, shares = (torch.from_numpy(y).to(team.device) for y in arrays)
    return SegmentShare(x, frames, whole, read_, shares, _on(team, at), batch.captions)


def load_codes(
    codes: Codes, sizes: DiffusionPhaseConfig, kernel: int, texts: Texts, config: TrainConfig, team: Team, step: int
) -> CodeShare:
    """This process's share of the batch of a step, on the device; `kernel` of the auto-encoder's convolutions."""
    rng = np.random.default_rng([config.seed, step])
    rows = rng.integers(len(codes.codes), size=config.batch)[team.share]
    shown, edge = rows[: sizes.decoded], margin(kernel)
    timing = Timing(codes.timing.head[shown], codes.timing.period[shown], codes.timing.tail[shown])
    first = rng.integers(np.maximum(timing.frames - WINDOW, 0) + 1)[:, None]
    at = course(timing, first + np.arange(-edge, WINDOW + edge))
    frames = first + np.arange(WINDOW) < timing.frames[:, None]
    captions = tuple(codes.captions[i] for i in rows)
    arrays = codes.normalised(rows), codes.poses[rows], codes.timing.frames[rows], *texts.batch(captions), frames
    x, pose, counts, words, mask, sentence, there = (torch.from_numpy(y).to(team.device) for y in arrays)
    return CodeShare(x, pose, counts, words, mask, sentence, _on(team, at), there, captions)


def _on(team: Team, at: Course) -> Course:
    return Course(*(torch.from_numpy(y).to(team.device) for y in (at.k, at.head, at.tail)))


class AutoencoderObjective(Objective[SegmentShare]):
    """The loss of the auto-encoder, Eq. 4: features, and the places and speeds of joints that they mean."""

    def _terms(self, step: int, share: SegmentShare) -> dict[str, Tensor]:
        _seed(self._config, self._team, step)
        with torch.autocast(share.x.device.type, torch.bfloat16, enabled=self._bf16):
            guess, code = self._network(share.x, share.read, share.shares, share.at)
        even, scale = torch.ones_like(share.x[:, 0, 0]), self._scale
        terms = self._geometric(guess.float(), share.x, share.frames, share.whole, even, *scale, self._config.weights)
        terms["code"] = code.square().mean(1).sum() / len(share.whole)
        terms["total"] = terms["total"] + NEAR_NOTHING * terms["code"]
        return terms


class PhaseObjective(Objective[CodeShare]):
    """The loss of the denoiser, Eq. 7: what codes are, token by token; and of some, the motions that they mean."""

    def __init__(self, config: TrainConfig, model: PhaseDenoiser, scale: Scale, team: Team) -> None:
        super().__init__(config, model, scale, team)
        self._denoiser = model

    def _terms(self, step: int, share: CodeShare) -> dict[str, Tensor]:
        _seed(self._config, self._team, step)
        x, model = share.x, self._denoiser
        t, no_text, no_pose = torch.rand(3, len(x), device=x.device)
        alpha, sigma = (torch.from_numpy(y).to(x)[:, None] for y in self._schedule.levels(t.cpu().numpy()))
        noised = alpha * x + sigma * torch.randn_like(x)
        said = share.words, share.word_mask, share.sentence, no_text >= self._config.drop_text
        with torch.autocast(x.device.type, torch.bfloat16, enabled=self._bf16):
            guess = self._network(noised, t, *said, share.pose, no_pose >= model.drop_pose, share.counts).float()
            off = (guess - x).square()
            code = torch.stack([off[:, token].mean(1) for token in model.tokens]).mean(0).sum() / self._config.batch
            shown = slice(len(share.at.k))
            meant, true = (model.decode(y[shown], share.at).float() for y in (guess, x))
        even = torch.ones_like(t[shown])
        terms = self._geometric(meant, true, share.frames, share.frames, even, *self._scale, self._config.weights)
        terms = {name: value / self._team.size for name, value in terms.items()}
        return {**terms, "code": code, "total": code + MEANT * terms["total"]}


def _seed(config: TrainConfig, team: Team, step: int) -> None:
    torch.manual_seed((config.seed * 1_000_003 + step) * team.size + team.rank)
