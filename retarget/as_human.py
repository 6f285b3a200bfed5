"""What a person would do to be followed by a rig as it is: retargeting, the other way round.

Limbs get the rig's directions, pelvis, chest, head, hands and feet the turns of the bodies that follow them. What the
rig does not have goes with what carries it, and how an upper arm is turned about itself nobody can tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from motiongen.motion import Motion, Skeleton
from motiongen.rotation import Array, quat_conj, quat_mul, quat_normalize, quat_rotate, shortest_arc, slerp
from motiongen.smpl import SMPL_SKELETON
from retarget.goals import CHEST, LIMBS, ROOT, leg_scale
from retarget.model import load_model
from retarget.rest import Rest, is_site, rest_of
from retarget.rig import Rig

BACK = {"spine1": 1 / 3, "spine2": 2 / 3}  # how far each is turned from the pelvis to the chest


@dataclass(frozen=True)
class Body:
    """A rig that can be seen as a person of `skeleton`, whose legs are `scale` times as long as the rig's."""

    rig: Rig
    model: mujoco.MjModel
    rest: Rest
    skeleton: Skeleton
    scale: float


def body_of(rig: Rig, skeleton: Skeleton = SMPL_SKELETON) -> Body:
    """`rig` as a person of `skeleton`. Raises RigError where its model cannot be had."""
    model = load_model(rig)
    rest = rest_of(rig, model)
    still = Motion(np.zeros((1, 3)), np.tile([1.0, 0, 0, 0], (1, len(skeleton.names), 1)), 1.0, skeleton)
    return Body(rig, model, rest, skeleton, 1 / leg_scale(still, rest))


def as_human(body: Body, qpos: Array, fps: float) -> Motion:
    """The motion that a person shows who is followed as `qpos` (T, 7 + nj) says, `fps` frames a second."""
    place, turn = _followers(body, qpos)
    count, names = len(qpos), body.skeleton.names
    world: dict[str, Array] = {ROOT: turn[ROOT]}
    world[CHEST] = turn.get(CHEST, turn[ROOT])
    for name, share in BACK.items():
        world[name] = slerp(world[ROOT], world[CHEST], np.full(count, share))
    for name, parent in zip(names, body.skeleton.parents, strict=True):
        if name not in world:
            world[name] = _turned(name, world[names[parent]], body, place, turn)
    stacked = np.stack([world[name] for name in names], axis=1)
    local = stacked.copy()
    local[:, 1:] = quat_mul(quat_conj(stacked[:, list(body.skeleton.parents[1:])]), stacked[:, 1:])
    return Motion(place[ROOT] * body.scale, quat_normalize(local), fps, body.skeleton)


def _followers(body: Body, qpos: Array) -> tuple[dict[str, Array], dict[str, Array]]:
    """By human joint: place (T, 3) of its follower; turn (T, 4) in the world, the identity where that is at rest."""
    data, follow = mujoco.MjData(body.model), body.rig.follow
    place, turn = np.empty((len(follow), len(qpos), 3)), np.empty((len(follow), len(qpos), 4))
    at = [data.site(f.body) if is_site(body.model, f.body) else data.body(f.body) for f in follow]
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(body.model, data)
        for i, frame in enumerate(at):
            place[i, k] = frame.xpos
            mujoco.mju_mat2Quat(turn[i, k], frame.xmat.ravel())
    names = [f.human for f in follow]
    turned = quat_mul(turn, quat_conj(np.stack([body.rest.turn[name] for name in names]))[:, None])
    return dict(zip(names, place, strict=True)), dict(zip(names, turned, strict=True))


def _turned(name: str, carrier: Array, body: Body, place: dict[str, Array], turn: dict[str, Array]) -> Array:
    """Turn (T, 4) in the world of a joint that `carrier` (T, 4) carries."""
    for limb in LIMBS:
        if name in limb[:-1]:
            below = next((joint for joint in limb[limb.index(name) + 1 :] if joint in place), None)
            if name not in place or below is None:
                return carrier
            bone = body.skeleton.offsets[body.skeleton.index(limb[limb.index(name) + 1])]
            is_now = quat_rotate(carrier, bone / np.linalg.norm(bone))
            shown = place[below] - place[name]
            return quat_mul(shortest_arc(is_now, shown / np.linalg.norm(shown, axis=1, keepdims=True)), carrier)
    follow = next((f for f in body.rig.follow if f.human == name and f.rotation > 0), None)
    return carrier if follow is None else turn[name]
