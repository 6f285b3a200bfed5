"""What a denoiser is trained to keep small: the features themselves, and the geometry that they mean (MDM, Eq. 2–5)."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from motiongen.diffusion.configs import LossWeights
from motiongen.features import CONTACTS, FPS, HEIGHT, PLANAR, TURNS, YAW
from motiongen.motion import FOOT_JOINTS, SMPL_JOINTS, SMPL_PARENTS

_FEET = [SMPL_JOINTS.index(n) for n in FOOT_JOINTS]


def joint_positions(features: Tensor, offsets: Tensor) -> Tensor:
    """Joints (B, T, 22, 3) in metres in the heading frame, below and around the pelvis at (0, 0, height).

    Orientations are global but for the heading, so forward kinematics is a sum of turned offsets down each limb: one
    product of the axes of all joints with a matrix that holds the offsets.
    """
    turn = features[..., TURNS].unflatten(-1, (len(SMPL_JOINTS), 2, 3))
    first, second = turn.movedim((-2, -1), (0, 1)).contiguous()  # coordinates first: three times as fast
    x = _unit(first)
    y = _unit(second - (x * second).sum(0) * x)
    joints = torch.cat([x, y, _cross(x, y)], dim=-1) @ _limbs(offsets)
    height = features[..., HEIGHT, None]
    return torch.stack([joints[0], joints[1], joints[2] + height]).movedim(0, -1)


def _unit(x: Tensor) -> Tensor:
    return x * (x.square().sum(0) + 1e-12).rsqrt()


def _cross(a: Tensor, b: Tensor) -> Tensor:
    (ax, ay, az), (bx, by, bz) = a, b
    return torch.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _limbs(offsets: Tensor) -> Tensor:
    """(3 J, J): how much of each joint's x axis, of each one's y and z axis, adds up to the place of joint j."""
    count = len(SMPL_JOINTS)
    limbs = torch.zeros(3, count, count, dtype=offsets.dtype, device=offsets.device)
    for j in range(count):
        bone = j
        while bone > 0:
            limbs[:, SMPL_PARENTS[bone], j] += offsets[bone]
            bone = SMPL_PARENTS[bone]
    return limbs.reshape(3 * count, count)


def world_velocity(features: Tensor, joints: Tensor) -> Tensor:
    """World velocity (B, T − 1, 22, 3) of the joints in m/s, written in each frame's heading."""
    now, after = joints[:, :-1], joints[:, 1:]
    turn = features[:, :-1, None, YAW] / FPS
    cos, sin = turn.cos(), turn.sin()
    x = cos * after[..., 0] - sin * after[..., 1]
    y = sin * after[..., 0] + cos * after[..., 1]
    moved = (torch.stack([x, y, after[..., 2]]) - now.movedim(-1, 0)) * FPS
    planar = F.pad(features[:, :-1, PLANAR], (0, 1))
    return (moved + planar.movedim(-1, 0)[..., None]).movedim(0, -1)


def loss(
    guess: Tensor,
    clean: Tensor,
    frames: Tensor,
    whole: Tensor,
    weight: Tensor,
    mean: Tensor,
    std: Tensor,
    offsets: Tensor,
    w: LossWeights,
) -> dict[str, Tensor]:
    """Terms by name, `total` among them, of normalised features (B, T, 140); `frames` (B, T): which count; `weight`
    (B,): how much each clip does.

    `whole` (N, T): `frames` of all clips that the means go over, where these B are a share of them; the terms of the
    shares add up to those of the whole.
    """
    pair = (frames[:, 1:] & frames[:, :-1]) / (whole[:, 1:] & whole[:, :-1]).sum() * weight[:, None]
    share = frames / whole.sum() * weight[:, None]
    said, true = guess * std + mean, clean * std + mean
    joints = joint_positions(said, offsets)
    speed = world_velocity(said, joints)
    with torch.no_grad():
        joints_true = joint_positions(true, offsets)
        speed_true = world_velocity(true, joints_true)
    planted = true[:, :-1, CONTACTS].clamp(0, 1)  # of a motion that was decoded they may lie beyond
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
