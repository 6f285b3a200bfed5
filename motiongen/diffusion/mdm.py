"""The denoiser: MDM's transformer (Tevet et al. 2022) in its decoder form, with six frames to a token.

Text comes in twice: the sentence vector, added to the embedding of the noise level, is prepended as a token, as in the
paper; the word vectors are listened to by cross-attention, so that "left" can reach the arm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn


@dataclass(frozen=True)
class MdmConfig:
    """Sizes. `patch`: frames to a token; `text`: width of the text encoder's vectors."""

    features: int = 140
    patch: int = 6
    width: int = 256
    layers: int = 4
    heads: int = 4
    feed_forward: int = 768
    text: int = 384
    dropout: float = 0.1


class Attention(nn.Module):
    """Multi-head attention of `x` (B, N, width) over `source` (B, M, width), where `mask` (B, M) is true."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query, self.key, self.value, self.out = (nn.Linear(width, width) for _ in range(4))

    def forward(self, x: Tensor, source: Tensor, mask: Tensor) -> Tensor:
        """(B, N, width)."""
        batch, count, width = x.shape
        q, k, v = (
            layer(y).view(batch, y.shape[1], self.heads, -1).transpose(1, 2)
            for layer, y in ((self.query, x), (self.key, source), (self.value, source))
        )
        if x.device.type == "cpu":  # its attention has a fast backward pass in full precision only
            with torch.autocast("cpu", enabled=False):
                heard = F.scaled_dot_product_attention(q.float(), k.float(), v.float(), mask[:, None, None])
        else:
            heard = F.scaled_dot_product_attention(q, k, v, mask[:, None, None])
        return self.out(heard.transpose(1, 2).reshape(batch, count, width))


class Block(nn.Module):
    """Self-attention, cross-attention to the words, feed-forward: each on a normalised input, added to the stream."""

    def __init__(self, c: MdmConfig) -> None:
        super().__init__()
        self.norms = nn.ModuleList(nn.LayerNorm(c.width) for _ in range(3))
        self.self_attention = Attention(c.width, c.heads)
        self.cross_attention = Attention(c.width, c.heads)
        self.feed_forward = nn.Sequential(
            nn.Linear(c.width, c.feed_forward), nn.GELU(), nn.Dropout(c.dropout), nn.Linear(c.feed_forward, c.width)
        )

    def forward(self, x: Tensor, mask: Tensor, words: Tensor, word_mask: Tensor) -> Tensor:
        """(B, N, width)."""
        y = self.norms[0](x)
        x = x + self.self_attention(y, y, mask)
        x = x + self.cross_attention(self.norms[1](x), words, word_mask)
        return x + self.feed_forward(self.norms[2](x))


class Mdm(nn.Module):
    """Estimate of clean features from noisy ones, their noise level and a text."""

    def __init__(self, config: MdmConfig) -> None:
        super().__init__()
        c = self.config = config
        self.read = nn.Linear(c.features * c.patch, c.width)
        self.level = nn.Sequential(nn.Linear(c.width, c.width), nn.SiLU(), nn.Linear(c.width, c.width))
        self.sentence = nn.Linear(c.text, c.width)
        self.word = nn.Linear(c.text, c.width)
        self.no_sentence = nn.Parameter(torch.zeros(c.width))
        self.no_words = nn.Parameter(torch.zeros(c.width))
        self.blocks = nn.ModuleList(Block(c) for _ in range(c.layers))
        self.norm = nn.LayerNorm(c.width)
        self.write = nn.Linear(c.width, c.features * c.patch)

    def forward(
        self, x: Tensor, t: Tensor, frames: Tensor, words: Tensor, word_mask: Tensor, sentence: Tensor, keep: Tensor
    ) -> Tensor:
        """Estimate of x_0 (B, T, features).

        `x` (B, T, features) normalised, T a multiple of the patch; `t` (B,) in [0, 1]; `frames` (B, T) bool: which are
        part of the clip; `words` (B, N, text), `word_mask` (B, N), `sentence` (B, text); `keep` (B,): where false the
        text is replaced by the learned "no text".
        """
        c = self.config
        batch, length, _ = x.shape
        tokens = self.read(x.reshape(batch, length // c.patch, c.patch * c.features))
        said = torch.where(keep[:, None], self.sentence(sentence), self.no_sentence)
        first = self.level(_waves(t * 1000.0, c.width)) + said
        places = _waves(torch.arange(tokens.shape[1] + 1, device=x.device, dtype=x.dtype), c.width)
        stream = torch.cat([first[:, None], tokens], dim=1) + places
        heard = torch.where(keep[:, None, None], self.word(words), self.no_words)
        real = frames.view(batch, -1, c.patch).any(-1)
        mask = torch.cat([torch.ones_like(real[:, :1]), real], dim=1)
        for block in self.blocks:
            stream = block(stream, mask, heard, word_mask)
        return self.write(self.norm(stream[:, 1:])).view(batch, length, c.features)


def _waves(at: Tensor, width: int) -> Tensor:
    """Sinusoidal embedding (N, width) of numbers (N,) (Vaswani et al. 2017)."""
    rate = torch.exp(torch.arange(width // 2, device=at.device, dtype=at.dtype) * (-math.log(10000.0) / (width // 2)))
    angle = at[:, None] * rate
    return torch.cat([angle.sin(), angle.cos()], dim=-1)
