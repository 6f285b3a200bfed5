"""The denoiser: MDM's transformer (Tevet et al. 2022), encoder or decoder, with some frames to a token.

In both forms the sentence vector, added to the embedding of the noise level, is prepended as a token, as in the paper
(Sec. 3, Fig. 2). The decoder also listens to the word vectors by cross-attention, so that "left" can reach the arm. A
learned vector may stand for the text: that of an action, or that of no text at all. Every token is told its
place from the start and from the end, so that five claps can be laid out over the length that there is.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from motiongen.diffusion.configs import MdmConfig

TO_END = 64  # waves that tell how many tokens are left


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
    """Self-attention, in a decoder cross-attention to the words, feed-forward: each on a normalised input, added to the
    stream."""

    def __init__(self, c: MdmConfig) -> None:
        super().__init__()
        decoder = c.form == "decoder"
        self.norms = nn.ModuleList(nn.LayerNorm(c.width) if i != 1 or decoder else nn.Identity() for i in range(3))
        self.self_attention = Attention(c.width, c.heads)
        self.cross_attention = Attention(c.width, c.heads) if decoder else None
        self.feed_forward = nn.Sequential(
            nn.Linear(c.width, c.feed_forward), nn.GELU(), nn.Dropout(c.dropout), nn.Linear(c.feed_forward, c.width)
        )

    def forward(self, x: Tensor, mask: Tensor, words: Tensor, word_mask: Tensor) -> Tensor:
        """(B, N, width)."""
        y = self.norms[0](x)
        x = x + self.self_attention(y, y, mask)
        if self.cross_attention is not None:
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
        self.to_end = nn.Linear(TO_END, c.width, bias=False)
        self.no_sentence = nn.Parameter(torch.zeros(c.width))
        self.no_words = nn.Parameter(torch.zeros(c.width))
        self.action = nn.Embedding(c.actions, c.width) if c.actions else None
        self.steer = nn.Linear(c.steering * c.patch, c.width, bias=False) if c.steering else None
        self.blocks = nn.ModuleList(Block(c) for _ in range(c.layers))
        self.norm = nn.LayerNorm(c.width)
        self.write = nn.Linear(c.width, c.features * c.patch)
        nn.init.zeros_(self.to_end.weight)
        if self.steer is not None:
            nn.init.zeros_(self.steer.weight)

    def forward(
        self,
        x: Tensor,
        t: Tensor,
        frames: Tensor,
        words: Tensor,
        word_mask: Tensor,
        sentence: Tensor,
        keep: Tensor,
        action: Tensor | None = None,
        steering: Tensor | None = None,
    ) -> Tensor:
        """Estimate of x_0 (B, T, features).

        `x` (B, T, features) normalised, T a multiple of the patch, of which a history is not noised; `t` (B,) in
        [0, 1]; `frames` (B, T) bool: which are part of the clip; `words` (B, N, text), `word_mask` (B, N), `sentence`
        (B, text); `keep` (B,): where false the text is replaced by the learned "no text"; `action` (B,): where not
        negative, the action that stands for the text; `steering` (B, T, steering): where to go (see
        motiongen/live/steering.py).
        """
        c = self.config
        batch, length, _ = x.shape
        tokens = self.read(x.reshape(batch, length // c.patch, c.patch * c.features))
        if self.steer is not None and steering is not None:
            tokens = tokens + self.steer(steering.reshape(batch, length // c.patch, -1))
        said, heard = self.sentence(sentence), self.word(words)
        if self.action is not None and action is not None:
            act, is_act = self.action(action.clamp(min=0)), (action >= 0)[:, None]
            said, heard = torch.where(is_act, act, said), torch.where(is_act[:, None], act[:, None], heard)
        said = torch.where(keep[:, None], said, self.no_sentence)
        heard = torch.where(keep[:, None, None], heard, self.no_words)
        first = self.level(waves(t * 1000.0, c.width)) + said
        real = frames.view(batch, -1, c.patch).any(-1)
        places = torch.arange(tokens.shape[1] + 1, device=x.device, dtype=x.dtype)
        left = (real.sum(1, keepdim=True) - places[:-1]).clamp(min=0)
        tokens = tokens + self.to_end(waves(left, TO_END))
        stream = torch.cat([first[:, None], tokens], dim=1) + waves(places, c.width)
        mask = torch.cat([torch.ones_like(real[:, :1]), real], dim=1)
        for block in self.blocks:
            stream = block(stream, mask, heard, word_mask)
        return self.write(self.norm(stream[:, 1:])).view(batch, length, c.features)


def waves(at: Tensor, width: int) -> Tensor:
    """Sinusoidal embedding (…, width) of numbers (…) (Vaswani et al. 2017)."""
    rate = torch.exp(torch.arange(width // 2, device=at.device, dtype=at.dtype) * (-math.log(10000.0) / (width // 2)))
    angle = at[..., None] * rate
    return torch.cat([angle.sin(), angle.cos()], dim=-1)
