"""What a rig does, as human motion: the bones of a person turned as the rig's limbs are, and its way scaled back."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from motiongen.motion import Motion, Skeleton, Source
from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate, shortest_arc, slerp
from retarget.goals import CHEST, LIMBS, ROOT, UPPER, leg_scale
from retarget.kinematics import on_body, poses, tree_of
from retarget.model import load_model
from retarget.rest import is_site, rest_of
from retarget.rig import Rig

TRUNK = {"spine1": 1 / 3, "spine2": 2 / 3, CHEST: 1.0}  # of the turn from the pelvis to the chest
LEG = ("left_hip", "left_knee", "left_ankle")


def read_back(qpos: Array, fps: float, rig: Rig, skeleton: Skeleton) -> Motion:
    """The motion of a person of `skeleton` that `qpos` (T, 7 + nj) of `rig` shows.

    Thighs, shins, upper arms and forearms point where the rig's do; trunk, head and feet are turned as theirs are, and
    joints that the rig does not have are straight. Twists about the limbs' own length are not read. Raises KeyError
    where the rig lacks a limb.
    """
    place, turn = _followers(qpos, rig)
    index, bones = skeleton.index, skeleton.offsets
    pelvis, chest = turn[ROOT], turn.get(CHEST, turn[ROOT])
    world = np.stack([chest if name in UPPER else pelvis for name in skeleton.names], axis=1)
    for name, share in TRUNK.items():
        world[:, index(name)] = slerp(pelvis, chest, np.full(len(qpos), share))
    for limb in LIMBS:
        for above, joint in pairwise(limb):
            straight = world[:, index(above)]
            bone = _unit(quat_rotate(straight, bones[index(joint)]))
            turned = quat_mul(shortest_arc(bone, _unit(place[joint] - place[above])), straight)
            world[:, index(above)] = world[:, index(joint)] = turned
    for name in ("head", "left_ankle", "right_ankle"):
        world[:, index(name)] = turn.get(name, world[:, index(name)])
    for side in ("left", "right"):
        world[:, index(f"{side}_foot")] = world[:, index(f"{side}_ankle")]

    local = world.copy()
    for j, parent in enumerate(skeleton.parents):
        if parent >= 0:
            local[:, j] = quat_mul(quat_conj(world[:, parent]), world[:, j])
    straight = skeleton.foot_height[0] - sum(float(bones[index(joint), 2]) for joint in LEG)
    person = Motion(qpos[:, :3], local, fps, skeleton)
    path = (qpos[:, :3] - [0, 0, rig.nominal.height]) / leg_scale(person, rest_of(rig, load_model(rig)))
    return Motion(path + np.array([0, 0, straight]), local, fps, skeleton, source=Source("rig"))


def _followers(qpos: Array, rig: Rig) -> tuple[dict[str, Array], dict[str, Array]]:
    """Human joint → where its follower is (T, 3), and how it is turned from the zero pose (T, 4), in the world."""
    model = load_model(rig)
    rest, at = rest_of(rig, model), poses(tree_of(model), qpos)
    place, turn = {}, {}
    for follow in rig.follow:
        if is_site(model, follow.body):
            body, point = model.site(follow.body).bodyid[0], model.site(follow.body).pos
            own = model.site(follow.body).quat
        else:
            body, point, own = model.body(follow.body).id, np.zeros(3), np.array([1.0, 0, 0, 0])
        place[follow.human] = on_body(at, np.array([body]), point[None])[:, 0]
        turn[follow.human] = quat_mul(quat_mul(at.turn[:, body], own), quat_conj(rest.turn[follow.human]))
    return place, turn


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
