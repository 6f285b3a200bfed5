"""The phase auto-encoder: motion to phases and back (DiffusionPhase, Sec. 3.2).

The encoder is a convolution that narrows the features, then four layers over how much of every whole frequency the
primary segment holds. The decoder is four convolutions over the signals. Beside both lies a straight way: a motion that
is a sum of the layout's waves is one from the first step on, and the layers learn the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from motiongen.diffusion.configs import PhaseAutoencoderConfig
from motiongen.phase.phases import Course, Layout, signals

DEPTH = 4  # layers of the encoder, convolutions of the decoder


def margin(kernel: int) -> int:
    """Frames on either side of a stretch that its decoder sees too, for convolutions of `kernel` frames."""
    return DEPTH * (kernel // 2)


class Encoder(nn.Module):
    """Codes of motions."""

    def __init__(self, c: PhaseAutoencoderConfig) -> None:
        super().__init__()
        layout = self.layout = Layout(c.highest, c.phases, c.cosine)
        self.narrow = nn.Conv1d(c.features, c.narrow, c.kernel, padding="same", padding_mode="replicate")
        sizes = [c.narrow * (2 * c.highest + 5) + 2, *[c.hidden] * (DEPTH - 1), layout.width - 2]
        self.layers = _stack(nn.Linear, sizes)
        self.waves = nn.Parameter(torch.randn(len(layout.frequencies), c.narrow, layout.group) / math.sqrt(c.narrow))
        self.ends = nn.Linear(2 * c.narrow, layout.channels, bias=False)

    def forward(self, x: Tensor, read: Tensor, shares: Tensor) -> Tensor:
        """Codes (B, width) of normalised features `x` (B, T, features), by the `readings` (B, 2H + 5, T) and the
        `shares` (B, 2) of their timing."""
        y = self.narrow(x.transpose(1, 2)).transpose(1, 2)
        with torch.autocast(x.device.type, enabled=False):
            seen = read @ y.to(read)
            code = self._straight(seen)
        return torch.cat([code + self.layers(torch.cat([seen.flatten(1), shares], 1)).to(code), shares], 1)

    def _straight(self, seen: Tensor) -> Tensor:
        """(B, width − 2): what is a sum of waves, as that."""
        at = torch.tensor(self.layout.frequencies, device=seen.device)
        mean = seen[:, :1].expand(-1, len(at), -1)
        waves = torch.stack([seen[:, at], seen[:, self.layout.highest + at], mean], 2) @ self.waves
        head, tail = (self.ends(seen[:, rows].flatten(1)) for rows in (slice(-4, -2), slice(-2, None)))
        return torch.cat([waves.flatten(1), head, tail], 1)


class Decoder(nn.Module):
    """Motions of signals."""

    def __init__(self, c: PhaseAutoencoderConfig) -> None:
        super().__init__()
        channels = Layout(c.highest, c.phases, c.cosine).channels
        self.straight = nn.Linear(channels, c.features)
        sizes = [channels, *[c.width] * (DEPTH - 1), c.features]
        self.layers = _stack(lambda a, b: nn.Conv1d(a, b, c.kernel), sizes)

    def forward(self, signal: Tensor) -> Tensor:
        """Normalised features (B, T, features) of signals (B, T + 2·margin, C)."""
        y = self.layers(signal.transpose(1, 2)).transpose(1, 2)
        edge = (signal.shape[1] - y.shape[1]) // 2
        return self.straight(signal[:, edge : edge + y.shape[1]]) + y


class PhaseAutoencoder(nn.Module):
    """Both."""

    def __init__(self, config: PhaseAutoencoderConfig) -> None:
        super().__init__()
        self.layout = Layout(config.highest, config.phases, config.cosine)
        self.noise = config.noise
        self.encoder, self.decoder = Encoder(config), Decoder(config)

    def forward(self, x: Tensor, read: Tensor, shares: Tensor, at: Course) -> tuple[Tensor, Tensor]:
        """Normalised features (B, T, features) as the codes (B, width) of `x` tell them, and those codes.

        `at`: the course of all T frames and the margin's. In training, noise is added to the codes on the way: what is
        drawn later will not be exact either.
        """
        code = self.encoder(x, read, shares)
        noise = self.noise * torch.randn_like(code) if self.training else 0.0
        return self.decode(code + noise, at), code

    def decode(self, code: Tensor, at: Course) -> Tensor:
        """Normalised features (B, T, features) of codes (B, width) on a course of T frames and the margin's."""
        decoded: Tensor = self.decoder(signals(code, at, self.layout))
        return decoded


def _stack(layer: Callable[[int, int], nn.Module], sizes: Sequence[int]) -> nn.Sequential:
    """Layers from each size to the next, GELU between; what the last one gives begins at nothing."""
    layers = [layer(a, b) for a, b in pairwise(sizes)]
    for tensor in layers[-1].parameters():
        nn.init.zeros_(tensor)
    return nn.Sequential(*[each for one in layers for each in (nn.GELU(), one)][1:])
