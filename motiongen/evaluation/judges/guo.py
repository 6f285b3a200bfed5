"""The evaluator of Guo et al. 2022: convolutions over movement, then recurrent networks, one space for both.

The same network, with other sizes, takes their published weights (`published.py`), so its parameters keep their names.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.utils.rnn import pack_padded_sequence

UNIT = 4  # frames to one step of the recurrent network: two convolutions of stride 2


@dataclass(frozen=True)
class GuoConfig:
    """Sizes: numbers a frame, a word vector, a word's part of speech (0: not heard); layers; the joint space."""

    seen: int = 71
    word: int = 384
    part: int = 0
    movement: int = 192
    motion: int = 192
    text: int = 192
    latent: int = 512


class Movement(nn.Module):
    """Frames (B, T, seen) to movement snippets (B, T / 4, movement)."""

    def __init__(self, seen: int, width: int) -> None:
        super().__init__()
        self.main = nn.Sequential(
            nn.Conv1d(seen, width, 4, 2, 1),
            nn.Dropout(0.2),
            nn.LeakyReLU(0.2),
            nn.Conv1d(width, width, 4, 2, 1),
            nn.Dropout(0.2),
            nn.LeakyReLU(0.2),
        )
        self.out_net = nn.Linear(width, width)

    def forward(self, x: Tensor) -> Tensor:
        return self.out_net(self.main(x.transpose(1, 2)).transpose(1, 2))


class Recurrent(nn.Module):
    """Sequences (B, N, size) of `lengths` (B) to the joint space (B, latent); what follows an end is not read."""

    def __init__(self, size: int, hidden: int, latent: int, part: int = 0) -> None:
        super().__init__()
        if part:
            self.pos_emb = nn.Linear(part, size)
        self.input_emb = nn.Linear(size, hidden)
        self.gru = nn.GRU(hidden, hidden, batch_first=True, bidirectional=True)
        self.output_net = nn.Sequential(
            nn.Linear(2 * hidden, hidden), nn.LayerNorm(hidden), nn.LeakyReLU(0.2), nn.Linear(hidden, latent)
        )
        self.hidden = nn.Parameter(torch.randn(2, 1, hidden))

    def forward(self, x: Tensor, lengths: Tensor, parts: Tensor | None = None) -> Tensor:
        if parts is not None:
            x = x + self.pos_emb(parts)
        steps = pack_padded_sequence(self.input_emb(x), lengths.cpu(), batch_first=True, enforce_sorted=False)
        last = self.gru(steps, self.hidden.repeat(1, len(x), 1).contiguous())[1]
        return self.output_net(torch.cat([last[0], last[1]], dim=-1))


class Guo(nn.Module):
    """Texts and motions to one space, compared by Euclidean distance."""

    def __init__(self, config: GuoConfig) -> None:
        super().__init__()
        self.movement_encoder = Movement(config.seen, config.movement)
        self.motion_encoder = Recurrent(config.movement, config.motion, config.latent)
        self.text_encoder = Recurrent(config.word, config.text, config.latent, config.part)

    def embed_motions(self, x: Tensor, frames: Tensor) -> Tensor:
        """(B, latent) of what is seen (B, T, seen), normalised, 0 from the end of each clip's `frames` (B) on.

        Frames of an unfinished snippet of four are not heard. T must reach at least four frames past the longest clip
        or, where it is as long as clips can be, to its end: the convolutions look that far.
        """
        return self.motion_encoder(self.movement_encoder(x), frames // UNIT)

    def embed_texts(self, words: Tensor, mask: Tensor, parts: Tensor | None = None) -> Tensor:
        """(B, latent) of word vectors (B, N, word); `mask` (B, N) says which are there."""
        return self.text_encoder(words, mask.sum(1), parts)


def margin_loss(text: Tensor, motion: Tensor, same: Tensor, margin: float = 10.0) -> Tensor:
    """Contrastive loss of Hadsell et al. 2006: own pairs together, wrong ones at least `margin` apart.

    `text`, `motion` (B, latent); `same` (B, B): pairs that are no wrong answers. All pairs of the batch are compared
    (the published training compares each text with one other motion); those still too near share the push.
    """
    apart = torch.cdist(text, motion)
    own = apart.diagonal().square().mean()
    short = (margin - apart[~same]).clamp(min=0)
    return own + short.square().sum() / (short > 0).sum().clamp(min=1)
