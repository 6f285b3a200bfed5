"""An evaluator after TMR (Petrovich et al. 2023): transformer encoders of text and motion, trained by InfoNCE.

TMR is a text-to-motion auto-encoder too; its decoder and variational loss are left out, since only the space is needed.
Frames go in by fours, which is as fine as the eye of the other evaluator and makes training sixteen times cheaper.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from motiongen.evaluation.judges.guo import UNIT


@dataclass(frozen=True)
class TmrConfig:
    """Sizes: numbers a frame, a word vector; of the encoders; the joint space; steps that positions are known for."""

    seen: int = 71
    word: int = 384
    width: int = 128
    layers: int = 3
    heads: int = 4
    feed_forward: int = 256
    latent: int = 256
    steps: int = 48


class Encoder(nn.Module):
    """Sequences (B, N, size), of which `mask` (B, N) is there, to unit vectors (B, latent) by one token put before."""

    def __init__(self, size: int, config: TmrConfig) -> None:
        super().__init__()
        self.enter = nn.Linear(size, config.width)
        self.token = nn.Parameter(torch.randn(config.width) * 0.02)
        self.place = nn.Parameter(torch.randn(config.steps + 1, config.width) * 0.02)
        layer = nn.TransformerEncoderLayer(
            config.width,
            config.heads,
            config.feed_forward,
            dropout=0.1,
            activation="gelu",
            batch_first=True,
            norm_first=True,
        )
        self.layers = nn.TransformerEncoder(layer, config.layers, enable_nested_tensor=False)
        self.leave = nn.Linear(config.width, config.latent)

    def forward(self, x: Tensor, mask: Tensor) -> Tensor:
        inside = torch.cat([self.token.expand(len(x), 1, -1), self.enter(x)], dim=1) + self.place[: x.shape[1] + 1]
        hidden = F.pad(~mask, (1, 0), value=False)
        return F.normalize(self.leave(self.layers(inside, src_key_padding_mask=hidden)[:, 0]), dim=-1)


class Tmr(nn.Module):
    """Texts and motions to one unit sphere."""

    def __init__(self, config: TmrConfig) -> None:
        super().__init__()
        self.motion_encoder = Encoder(UNIT * config.seen, config)
        self.text_encoder = Encoder(config.word, config)

    def embed_motions(self, x: Tensor, frames: Tensor) -> Tensor:
        """(B, latent) of what is seen (B, T, seen), normalised, T a multiple of four; `frames` (B) of each are there.

        Frames of an unfinished snippet of four are not heard.
        """
        snippets = x.unflatten(1, (-1, UNIT)).flatten(2)
        mask = torch.arange(snippets.shape[1], device=x.device) < (frames // UNIT)[:, None]
        return self.motion_encoder(snippets, mask)

    def embed_texts(self, words: Tensor, mask: Tensor) -> Tensor:
        """(B, latent) of word vectors (B, N, word); `mask` (B, N) says which are there."""
        return self.text_encoder(words, mask)


def info_nce(text: Tensor, motion: Tensor, same: Tensor, temperature: float = 0.1) -> Tensor:
    """Symmetric InfoNCE (TMR, Eq. 2) of unit vectors (B, latent); `same` (B, B): pairs that are no wrong answers."""
    score = text @ motion.T / temperature
    score = score.masked_fill(same & ~torch.eye(len(score), dtype=torch.bool, device=score.device), -torch.inf)
    own = torch.arange(len(score), device=score.device)
    return (F.cross_entropy(score, own) + F.cross_entropy(score.T, own)) / 2
