"""A small classifier of contents, trained on real clips, that judges whether a motion shows what was asked for.

It sees features, not files, and not one clip that it is tested on. Its inputs are low-frequency enough that the seams
and the smoothness of generated motion do not matter to it. Motions of another body are seen on that of its clips.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from motiongen.data.dataset import Dataset
from motiongen.diffusion.losses import joint_positions
from motiongen.evaluation.judges.seen import leg_length
from motiongen.features import HEIGHT, PLANAR, motion_to_features
from motiongen.motion import Motion
from motiongen.text.captions import swap_sides

LENGTH = 240
RATE = 2  # every second frame
STRIDES = (2, 2, 1)
BATCH = 64


class Contents(nn.Module):
    """Content of a clip from its joints in the heading frame and its root's speed."""

    offsets: Tensor

    def __init__(self, contents: list[str], offsets: Tensor) -> None:
        super().__init__()
        self.contents = contents
        self.register_buffer("offsets", offsets)
        channels = 22 * 3 + 4
        self.norm = nn.BatchNorm1d(channels)
        self.layers = nn.ModuleList(
            nn.Conv1d(a, 96, 5, stride=s, padding=2) for a, s in zip((channels, 96, 96), STRIDES, strict=True)
        )
        self.head = nn.Linear(2 * 96, len(contents))

    def forward(self, features: Tensor, frames: Tensor) -> Tensor:
        """Logits (B, contents) of features (B, T, 140) in their own units, of which `frames` (B, T) count."""
        joints = joint_positions(features, self.offsets).flatten(-2)
        x = torch.cat([joints, features[..., :4]], dim=-1)[:, ::RATE].transpose(1, 2)
        real = frames[:, None, ::RATE].float()
        x = self.norm(x) * real
        for layer, stride in zip(self.layers, STRIDES, strict=True):
            x = F.gelu(layer(F.dropout(x, 0.2, self.training)))
            real = F.max_pool1d(real, 2, ceil_mode=True) if stride == 2 else real
            x = x * real[..., : x.shape[-1]]
        real = real[..., : x.shape[-1]]
        mean = x.sum(-1) / real.sum(-1)
        peak = x.masked_fill(real == 0, -1e4).amax(-1)
        return self.head(torch.cat([mean, peak], dim=-1))

    @torch.inference_mode()
    def judge(self, clips: Sequence[np.ndarray]) -> list[str]:
        """The content that each clip (T, 140), of the body that it learnt from, shows."""
        self.eval()
        parts = [list(clips[start : start + BATCH]) for start in range(0, len(clips), BATCH)]
        return [self.contents[int(i)] for part in parts for i in self(*pad(part)).argmax(-1)]

    def judge_motions(self, motions: Sequence[Motion]) -> list[str]:
        """The content that each motion shows: its joint angles, its way and height scaled by the length of the legs."""
        return self.judge([on_body(motion, self.offsets.numpy()) for motion in motions])


def on_body(motion: Motion, offsets: np.ndarray) -> np.ndarray:
    """Features (T, 140) of a motion as a body with `offsets` (22, 3) in metres would do it."""
    features = motion_to_features(motion).astype(np.float32)
    size = leg_length(offsets) / leg_length(motion.skeleton.offsets)
    features[:, PLANAR] *= size
    features[:, HEIGHT] *= size
    return features


def pad(clips: list[np.ndarray]) -> tuple[Tensor, Tensor]:
    """Features (B, 240, 140) and which frames count, clips cut or padded at the end."""
    x = np.zeros((len(clips), LENGTH, clips[0].shape[1]), np.float32)
    frames = np.zeros((len(clips), LENGTH), bool)
    for i, clip in enumerate(clips):
        n = min(len(clip), LENGTH)
        x[i, :n], frames[i, :n] = clip[:n], True
        x[i, n:] = clip[n - 1]
    return torch.from_numpy(x), torch.from_numpy(frames)


def judged_contents(data: Dataset, least: int = 12) -> list[str]:
    """Contents that a data set has at least `least` clips of and some to test with; composed clips do not count."""
    counts = Counter(e.content for e in data.entries if e.content and e.source != "composed")
    common = sorted(content for content, count in counts.items() if count >= least)
    tested = clips_of(data, common, "test")
    return [content for content in common if tested[content]]


def clips_of(data: Dataset, contents: list[str], split: str) -> dict[str, list[tuple[int, bool]]]:
    """Clip and whether mirrored, of every clip of `split` that shows one of `contents`."""
    rows: dict[str, list[tuple[int, bool]]] = {c: [] for c in contents}
    for i, entry in enumerate(data.entries):
        for mirrored in (False, True):
            content = swap_sides(entry.content) if mirrored else entry.content
            if entry.split == split and entry.source != "composed" and content in rows:
                rows[content].append((i, mirrored))
    return rows


def train_contents(data: Dataset, contents: list[str], *, steps: int, seed: int = 0) -> Contents:
    """A classifier of `contents`, each drawn equally often, from the training clips and their mirror images.

    Raises ValueError naming a content without training clips.
    """
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    rows = clips_of(data, contents, "train")
    if empty := [c for c in contents if not rows[c]]:
        raise ValueError(f"{data.folder}: no training clip of {', '.join(empty)}")
    offsets = torch.tensor(next(e.offsets for e in data.entries), dtype=torch.float32)
    model = Contents(contents, offsets)
    optimizer = torch.optim.AdamW(model.parameters(), lr=2e-3, weight_decay=0.05)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps)
    for _ in range(steps):
        which = rng.integers(0, len(contents), 64)
        clips = []
        for c in which:
            each = rows[contents[c]]
            clip = data.features(*each[rng.integers(len(each))])
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
