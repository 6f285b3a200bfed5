"""A small classifier of content, trained on real clips, that judges whether a motion shows what was asked for.

It sees features, not files, and not one clip that it is tested on. Its inputs are low-frequency enough that the seams
and the smoothness of generated motion do not matter to it.
"""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from motiongen.corpus import Corpus
from motiongen.losses import joint_positions

LENGTH = 180
RATE = 2  # every second frame


class Judge(nn.Module):
    """Content of a clip from its joints in the heading frame and its root's speed."""

    def __init__(self, contents: list[str], offsets: Tensor) -> None:
        super().__init__()
        self.contents = contents
        self.register_buffer("offsets", offsets)
        channels = 22 * 3 + 4
        self.norm = nn.BatchNorm1d(channels)
        self.layers = nn.ModuleList(
            nn.Conv1d(a, 96, 5, stride=s, padding=2) for a, s in ((channels, 2), (96, 2), (96, 1))
        )
        self.head = nn.Linear(2 * 96, len(contents))

    def forward(self, features: Tensor, frames: Tensor) -> Tensor:
        """Logits (B, contents) of features (B, T, 140) in their own units, of which `frames` (B, T) count."""
        joints = joint_positions(features, self.offsets).flatten(-2)
        x = torch.cat([joints, features[..., :4]], dim=-1)[:, ::RATE].transpose(1, 2)
        real = frames[:, None, ::RATE].float()
        x = self.norm(x) * real
        for layer in self.layers:
            x = F.gelu(layer(F.dropout(x, 0.2, self.training)))
            real = F.max_pool1d(real, 2, ceil_mode=True) if layer.stride[0] == 2 else real
            x = x * real[..., : x.shape[-1]]
        real = real[..., : x.shape[-1]]
        mean = x.sum(-1) / real.sum(-1)
        peak = x.masked_fill(real == 0, -1e4).amax(-1)
        return self.head(torch.cat([mean, peak], dim=-1))

    @torch.inference_mode()
    def judge(self, clips: list[np.ndarray]) -> list[str]:
        """The content that each clip (T, 140) shows."""
        self.eval()
        return [self.contents[int(i)] for i in self(*pad(clips)).argmax(-1)]


def pad(clips: list[np.ndarray]) -> tuple[Tensor, Tensor]:
    """Features (B, 180, 140) and which frames count, clips cut or padded at the end."""
    x = np.zeros((len(clips), LENGTH, clips[0].shape[1]), np.float32)
    frames = np.zeros((len(clips), LENGTH), bool)
    for i, clip in enumerate(clips):
        n = min(len(clip), LENGTH)
        x[i, :n], frames[i, :n] = clip[:n], True
        x[i, n:] = clip[n - 1]
    return torch.from_numpy(x), torch.from_numpy(frames)


def train_judge(corpus: Corpus, contents: list[str], *, steps: int, seed: int = 0) -> Judge:
    """A judge of `contents`, each drawn equally often, from the clips that are not held out and their mirrors."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    rows: dict[str, list[tuple[int, bool]]] = {c: [] for c in contents}
    for i in np.flatnonzero(~corpus.held_out):
        for mirrored in (False, True):
            if corpus.content(i, mirrored) in rows:
                rows[corpus.content(i, mirrored)].append((int(i), mirrored))
    model = Judge(contents, torch.tensor(corpus.offsets, dtype=torch.float32))
    optimizer = torch.optim.AdamW(model.parameters(), lr=2e-3, weight_decay=0.05)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps)
    for _ in range(steps):
        which = rng.integers(0, len(contents), 48)
        clips = []
        for c in which:
            each = rows[contents[c]]
            clip = corpus.clip(*each[rng.integers(len(each))])
            if len(clip) > 60 and rng.random() < 0.5:  # a generated clip may start later or stop earlier
                start = rng.integers(0, min(len(clip) // 5, 30) + 1)
                clip = clip[start : len(clip) - rng.integers(0, len(clip) // 5 + 1)]
            clips.append(clip)
        loss = F.cross_entropy(model(*pad(clips)), torch.from_numpy(which), label_smoothing=0.05)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    return model
