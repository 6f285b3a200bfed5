"""What a denoiser is trained to keep small: the features themselves, and the geometry that they mean (MDM, Eq. 2–5)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from motiongen.features import CONTACTS, FPS, HEIGHT, PLANAR, TURNS, YAW
from motiongen.motion import FOOT_JOINTS, SMPL_JOINTS, SMPL_PARENTS

_FEET = [SMPL_JOINTS.index(n) for n in FOOT_JOINTS]


@dataclass(frozen=True)
class LossWeights:
    """Weights; a position error of 0.1 m, a speed error of 0.5 m/s and a foot speed of 0.5 m/s count as 1."""

    position: float = 0.5
    velocity: float = 0.25
    foot: float = 0.25


def joint_positions(features: Tensor, offsets: Tensor) -> Tensor:
    """Joints (B, T, 22, 3) in metres in the heading frame, below and around the pelvis at (0, 0, height).

    Orientations are global but for the heading, so forward kinematics is a sum of turned offsets down each limb.
    """
    turn = features[..., TURNS].unflatten(-1, (len(SMPL_JOINTS), 2, 3))
    x = F.normalize(turn[..., 0, :], dim=-1)
    y = F.normalize(turn[..., 1, :] - (x * turn[..., 1, :]).sum(-1, keepdim=True) * x, dim=-1)
    axes = torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)
    parents = [max(p, 0) for p in SMPL_PARENTS]
    bones = (axes[..., parents, :, :] @ offsets[..., None])[..., 0]
    return bones.transpose(-1, -2).matmul(_ancestors(offsets)).transpose(-1, -2) + _at_height(features)


def _ancestors(like: Tensor) -> Tensor:
    """(J, J): column j sums the bones from the root to joint j."""
    matrix = torch.zeros(len(SMPL_JOINTS), len(SMPL_JOINTS), dtype=like.dtype, device=like.device)
    for j in range(len(SMPL_JOINTS)):
        at = j
        while at > 0:
            matrix[at, j] = 1.0
            at = SMPL_PARENTS[at]
    return matrix


def _at_height(features: Tensor) -> Tensor:
    height = features[..., HEIGHT]
    return torch.stack([torch.zeros_like(height), torch.zeros_like(height), height], dim=-1)[..., None, :]


def world_velocity(features: Tensor, joints: Tensor) -> Tensor:
    """World velocity (B, T − 1, 22, 3) of the joints in m/s, written in each frame's heading."""
    now, after = joints[:, :-1], joints[:, 1:]
    turn = features[:, :-1, None, YAW] / FPS
    cos, sin = turn.cos(), turn.sin()
    x = cos * after[..., 0] - sin * after[..., 1]
    y = sin * after[..., 0] + cos * after[..., 1]
    moved = (torch.stack([x, y, after[..., 2]], dim=-1) - now) * FPS
    planar = F.pad(features[:, :-1, PLANAR], (0, 1))
    return moved + planar[:, :, None]


def loss(
    guess: Tensor, clean: Tensor, frames: Tensor, mean: Tensor, std: Tensor, offsets: Tensor, w: LossWeights
) -> dict[str, Tensor]:
    """Terms by name, `total` among them, of normalised features (B, T, 140); `frames` (B, T): which count."""
    real = frames.to(guess.dtype)
    share = real / real.sum()
    pair = real[:, 1:] * real[:, :-1]
    pair = pair / pair.sum()
    said, true = guess * std + mean, clean * std + mean
    joints, joints_true = joint_positions(said, offsets), joint_positions(true, offsets)
    speed, speed_true = world_velocity(said, joints), world_velocity(true, joints_true)
    planted = true[:, :-1, CONTACTS]
    feature = (((guess - clean) ** 2).mean(-1) * share).sum()
    position = ((joints - joints_true) ** 2).sum(-1).mean(-1) / 0.1**2
    velocity = ((speed - speed_true) ** 2).sum(-1).mean(-1) / 0.5**2
    foot = ((speed[:, :, _FEET] ** 2).sum(-1) * planted).mean(-1) / 0.5**2
    terms = {
        "feature": feature,
        "position": (position * share).sum(),
        "velocity": (velocity * pair).sum(),
        "foot": (foot * pair).sum(),
    }
    terms["total"] = feature + w.position * terms["position"] + w.velocity * terms["velocity"] + w.foot * terms["foot"]
    return terms
