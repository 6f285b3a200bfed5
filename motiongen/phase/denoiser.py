"""The denoiser of phase codes (DiffusionPhase, Sec. 3.3): a transformer over their frequencies, head, tail and timing.

It is told a text, as MDM's decoder is, how long the motion is, and the pose in which its primary segment begins; text
and pose may each be left out.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from motiongen.diffusion.configs import DiffusionPhaseConfig, MdmConfig, PhaseAutoencoderConfig
from motiongen.diffusion.mdm import Block, waves
from motiongen.phase.autoencoder import PhaseAutoencoder
from motiongen.phase.phases import Course, Layout

LENGTH = 100.0  # of the logarithm of a motion's frames: waves tell numbers apart that are about 1 from each other


class PhaseDenoiser(nn.Module):
    """Estimate of a clean code, in numbers that `center` and `spread` (width,) normalise. It holds the auto-encoder, as
    it was trained."""

    center: Tensor
    spread: Tensor

    def __init__(self, c: DiffusionPhaseConfig, autoencoder: PhaseAutoencoderConfig) -> None:
        super().__init__()
        layout = Layout(autoencoder.highest, autoencoder.phases, autoencoder.cosine)
        self.tokens = layout.tokens
        self.width, self.drop_pose = c.width, c.drop_pose
        self.autoencoder = PhaseAutoencoder(autoencoder).requires_grad_(False)
        self.register_buffer("center", torch.zeros(layout.width))
        self.register_buffer("spread", torch.ones(layout.width))
        sizes = [each.stop - each.start for each in self.tokens]
        self.read = nn.ModuleList(nn.Linear(n, c.width) for n in sizes)
        self.write = nn.ModuleList(nn.Linear(c.width, n) for n in sizes)
        self.level = nn.Sequential(nn.Linear(c.width, c.width), nn.SiLU(), nn.Linear(c.width, c.width))
        self.sentence, self.word = nn.Linear(c.text, c.width), nn.Linear(c.text, c.width)
        self.pose = nn.Linear(c.features, c.width)
        self.no_sentence, self.no_words, self.no_pose = (nn.Parameter(torch.zeros(c.width)) for _ in range(3))
        block = MdmConfig(width=c.width, heads=c.heads, feed_forward=c.feed_forward)
        self.blocks = nn.ModuleList(Block(block) for _ in range(c.layers))
        self.norm = nn.LayerNorm(c.width)

    def forward(
        self,
        x: Tensor,
        t: Tensor,
        words: Tensor,
        word_mask: Tensor,
        sentence: Tensor,
        keep: Tensor,
        pose: Tensor,
        keep_pose: Tensor,
        frames: Tensor,
    ) -> Tensor:
        """Estimate of x_0 (B, width).

        `x` (B, width) normalised; `t` (B,) in [0, 1]; `words` (B, N, text), `word_mask` (B, N), `sentence` (B, text);
        `keep` (B,): where false nothing is said; `pose` (B, features), normalised, and `keep_pose` (B,) likewise;
        `frames` (B,): how many the motion has.
        """
        said = torch.where(keep[:, None], self.sentence(sentence), self.no_sentence)
        heard = torch.where(keep[:, None, None], self.word(words), self.no_words)
        stands = torch.where(keep_pose[:, None], self.pose(pose), self.no_pose)
        first = self.level(waves(t * 1000.0, self.width)) + said
        long = waves(frames.to(x).log() * LENGTH, self.width)
        tokens = [read(x[:, token]) for read, token in zip(self.read, self.tokens, strict=True)]
        stream = torch.stack([first, stands, long, *tokens], 1)
        stream = stream + waves(torch.arange(stream.shape[1], device=x.device, dtype=stream.dtype), self.width)
        mask = torch.ones_like(stream[..., 0], dtype=torch.bool)
        for block in self.blocks:
            stream = block(stream, mask, heard, word_mask)
        made = self.norm(stream[:, -len(self.tokens) :]).unbind(1)
        return torch.cat([write(y) for write, y in zip(self.write, made, strict=True)], -1)

    def decode(self, x: Tensor, at: Course) -> Tensor:
        """Normalised features (B, T, features) of normalised codes (B, width) on a course of T frames and the
        margin's."""
        return self.autoencoder.decode(x * self.spread + self.center, at)
