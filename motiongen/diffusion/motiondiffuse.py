"""MotionDiffuse's network (Zhang et al. 2022, Sec. 3.4): a cross-modality linear transformer, some frames to a token.

It estimates the noise. Attention among frames and from frames to words is the efficient one (Eq. 8), whose cost grows
with the number of frames and not with its square; what a block adds to the stream is styled by the text and the noise
level (Eq. 9). Every token is told its place from the start and from the end.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from motiongen.diffusion.configs import MotionDiffuseConfig
from motiongen.diffusion.mdm import TO_END, Attention, waves
from motiongen.diffusion.schedule import LEVELS, LINEAR

LEAST, MOST = 1.0, 5.0  # how much an error of the clean features counts, from the noisiest level to the cleanest


def efficient_attention(q: Tensor, k: Tensor, v: Tensor, mask: Tensor, heads: int) -> Tensor:
    """Eq. 8 in `heads` heads: (B, N, width) of `q` (B, N, width), `k` and `v` (B, M, width).

    `mask` (B, M): which of the source is listened to, at least one in each row. softmax(Q) is over a head's features,
    softmax(K) over the source.
    """
    q, v = q.unflatten(-1, (heads, -1)).softmax(-1), v.unflatten(-1, (heads, -1))
    k = k.masked_fill(~mask[..., None], -torch.inf).softmax(1).unflatten(-1, (heads, -1))
    overview = torch.einsum("bmhi,bmhj->bhij", k, v)
    return torch.einsum("bnhi,bhij->bnhj", q, overview).flatten(-2)


class LinearAttention(nn.Module):
    """Efficient attention of `x` (B, N, width) to `source` (B, M, of its width), where `mask` (B, M) is true."""

    def __init__(self, width: int, source: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query, self.key, self.value = nn.Linear(width, width), nn.Linear(source, width), nn.Linear(source, width)

    def forward(self, x: Tensor, source: Tensor, mask: Tensor) -> Tensor:
        """(B, N, width)."""
        return efficient_attention(self.query(x), self.key(source), self.value(source), mask, self.heads)


class Stylize(nn.Module):
    """Eq. 9, Y′ = Y · ψ_w(φ(e)) + ψ_b(φ(e)), with Y normalised and a SiLU behind φ.

    Both ψ begin at zero, so that a new block passes its input on as it is (as Peebles & Xie 2023, Sec. 3.2).
    """

    def __init__(self, width: int, condition: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.phi = nn.Linear(condition, condition)
        self.scale, self.shift = nn.Linear(condition, width), nn.Linear(condition, width)
        for layer in (self.scale, self.shift):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    def forward(self, y: Tensor, e: Tensor) -> Tensor:
        """(B, N, width) of `y` (B, N, width) and `e` (B, condition)."""
        style = nn.functional.silu(self.phi(e))[:, None]
        return self.norm(y) * self.scale(style) + self.shift(style)


class Block(nn.Module):
    """Self-attention, cross-attention to the text, feed-forward: each on a normalised input, styled, and added."""

    def __init__(self, c: MotionDiffuseConfig) -> None:
        super().__init__()
        self.norms = nn.ModuleList(nn.LayerNorm(c.width) for _ in range(3))
        self.self_attention = LinearAttention(c.width, c.width, c.heads)
        self.cross_attention = LinearAttention(c.width, c.text_width, c.heads)
        self.feed_forward = _feed_forward(c.width, c.feed_forward)
        self.styles = nn.ModuleList(Stylize(c.width, c.text_width) for _ in range(3))

    def forward(self, x: Tensor, mask: Tensor, text: Tensor, text_mask: Tensor, e: Tensor) -> Tensor:
        """(B, N, width)."""
        y = self.norms[0](x)
        x = x + self.styles[0](self.self_attention(y, y, mask), e)
        x = x + self.styles[1](self.cross_attention(self.norms[1](x), text, text_mask), e)
        return x + self.styles[2](self.feed_forward(self.norms[2](x)), e)


class TextBlock(nn.Module):
    """One layer of the text transformer: classical attention (Eq. 6 and 7) and feed-forward."""

    def __init__(self, c: MotionDiffuseConfig) -> None:
        super().__init__()
        self.norms = nn.ModuleList(nn.LayerNorm(c.text_width) for _ in range(2))
        self.attention = Attention(c.text_width, c.heads)
        self.feed_forward = _feed_forward(c.text_width, c.text_feed_forward)

    def forward(self, text: Tensor, mask: Tensor) -> Tensor:
        """(B, N, text_width)."""
        y = self.norms[0](text)
        text = text + self.attention(y, y, mask)
        return text + self.feed_forward(self.norms[1](text))


def _feed_forward(width: int, inner: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(width, inner), nn.GELU(), nn.Linear(inner, inner), nn.GELU(), nn.Linear(inner, width)
    )


class MotionDiffuse(nn.Module):
    """Estimate of the noise in noisy features, from them, their noise level and a text."""

    log_signal: Tensor

    def __init__(self, config: MotionDiffuseConfig) -> None:
        super().__init__()
        c = self.config = config
        self.sentence, self.word = nn.Linear(c.text, c.text_width), nn.Linear(c.text, c.text_width)
        self.no_text = nn.Parameter(torch.zeros(c.text_width))
        self.action = nn.Embedding(c.actions, c.text_width) if c.actions else None
        self.text_blocks = nn.ModuleList(TextBlock(c) for _ in range(c.text_layers))
        self.text_norm = nn.LayerNorm(c.text_width)
        self.text = nn.Linear(c.text_width, c.text_width)
        self.level = nn.Sequential(nn.Linear(c.width, c.text_width), nn.SiLU(), nn.Linear(c.text_width, c.text_width))
        self.read = nn.Linear(c.features * c.patch, c.width)
        self.to_end = nn.Linear(TO_END, c.width, bias=False)
        self.blocks = nn.ModuleList(Block(c) for _ in range(c.layers))
        self.norm = nn.LayerNorm(c.width)
        self.write = nn.Linear(c.width, c.features * c.patch)
        nn.init.zeros_(self.to_end.weight)
        table = np.log(LINEAR.levels(np.arange(LEVELS + 1) / LEVELS)[0])
        self.register_buffer("log_signal", torch.from_numpy(table).float(), persistent=False)

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
    ) -> Tensor:
        """Estimate of ε (B, T, features) in x = α(t)·x_0 + σ(t)·ε on the linear schedule; arguments as `Mdm.forward`.

        A token of one frame is wide enough to write the noise itself, as in the paper. One of several frames is not:
        all their noise cannot pass through it. It writes the clean features, and ε is what is then left of x.
        """
        c = self.config
        batch, length, _ = x.shape
        text, text_mask = self._text(words, word_mask, sentence, keep, action)
        e = self.text(text[:, 0]) + self.level(waves(t * 1000.0, c.width))
        real = frames.view(batch, -1, c.patch).any(-1)
        places = torch.arange(real.shape[1], device=x.device, dtype=x.dtype)
        left = (real.sum(1, keepdim=True) - places).clamp(min=0)
        stream = self.read(x.reshape(batch, -1, c.patch * c.features))
        stream = stream + waves(places, c.width) + self.to_end(waves(left, TO_END))
        for block in self.blocks:
            stream = block(stream, real, text, text_mask, e)
        out = self.write(self.norm(stream)).view(batch, length, c.features)
        if c.patch == 1:
            return out
        alpha, sigma = self._levels(t)
        return (x - alpha * out) / sigma

    def _text(
        self, words: Tensor, word_mask: Tensor, sentence: Tensor, keep: Tensor, action: Tensor | None
    ) -> tuple[Tensor, Tensor]:
        """Text features (B, 1 + N, text_width), the sentence's first, and which of them count."""
        text = torch.cat([self.sentence(sentence)[:, None], self.word(words)], dim=1)
        if self.action is not None and action is not None:
            text = torch.where((action >= 0)[:, None, None], self.action(action.clamp(min=0))[:, None], text)
        text = torch.where(keep[:, None, None], text, self.no_text)
        mask = torch.cat([torch.ones_like(word_mask[:, :1]), word_mask], dim=1)
        for block in self.text_blocks:
            text = block(text, mask)
        return self.text_norm(text), mask

    def _levels(self, t: Tensor) -> tuple[Tensor, Tensor]:
        """α and σ (B, 1, 1) as `LINEAR` has them, but below its first level, where σ goes to nothing, those of it."""
        at = (t * LEVELS).clamp(min=1.0)
        low = at.floor().clamp(max=LEVELS - 1).long()
        log = torch.lerp(self.log_signal[low], self.log_signal[low + 1], at - low)[:, None, None]
        return log.exp(), (-torch.expm1(2 * log)).sqrt()


def noise_loss(guess: Tensor, noise: Tensor, frames: Tensor, whole: Tensor, weight: Tensor) -> Tensor:
    """Eq. 4: the mean squared error of ε (B, T, features) over `frames` (B, T), each clip's by its `weight` (B,).

    `whole` (N, T): `frames` of all clips that the mean goes over, where these B are a share of them.
    """
    share = frames * weight[:, None] / whole.sum()
    return ((guess - noise).square().mean(-1) * share).sum()


def noise_weight(alpha: Tensor, sigma: Tensor) -> Tensor:
    """Weights (B,) of `noise_loss` at the levels α and σ (B,) for a network that writes clean features.

    An error of x_0 shows in ε by α/σ only, which is 0.006 at t = 1: with Eq. 4 as it stands nothing would teach what
    to make of pure noise, yet there it is settled what is done. With these weights an error of x_0 counts α²/σ² times,
    but at least LEAST (Salimans & Ho 2022, Sec. 4) and at most MOST times (Hang et al. 2023).
    """
    ratio = (alpha / sigma).square()
    return ratio.clamp(LEAST, MOST) / ratio
