"""Where each follower of the rig should be: human motion carried over limb by limb.

A limb keeps the human's directions and takes the rig's lengths, so that a target is never out of reach: elbow =
shoulder + direction of the human upper arm × the rig's upper arm, and so on down. Arms and head are measured in the
frame of the chest (rigs without a waist then still wave as the person does), legs from the hips. The pelvis keeps its
orientation; its path is scaled by the length of the legs.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from motiongen.motion import Motion
from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate, yaw_of_quat, yaw_quat
from retarget.rest import Rest
from retarget.rig import Follow, Rig
from retarget.table import RigError

ROOT, CHEST = "pelvis", "spine3"
LIMBS = tuple(
    tuple(f"{side}_{joint}" for joint in limb)
    for side in ("left", "right")
    for limb in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
)
UPPER = ("neck", "head", *(f"{s}_{j}" for s in ("left", "right") for j in ("collar", "shoulder", "elbow", "wrist")))


@dataclass(frozen=True)
class Goal:
    """`follow.body` should be at `pos` (T, 3), metres, turned by `quat` (T, 4): in the frame of the follower of the
    human joint `base`, or in the world where `base` is empty. `firm` (T,) scales the weights of `follow`.
    """

    follow: Follow
    base: str
    pos: Array
    quat: Array
    firm: Array


def leg_scale(motion: Motion, rest: Rest) -> float:
    """Length of the rig's legs over the human's, hip to ankle; 1 where the rig has none."""
    legs = [limb for limb in LIMBS if limb[0].endswith("hip") and limb[0] in rest.place and limb[2] in rest.place]
    ratios = [sum(_rig_lengths(_chain(leg, rest), rest)) / _human_length(motion, leg[0], leg[2]) for leg in legs]
    return float(np.mean(ratios)) if ratios else 1.0


def root_goal(motion: Motion, rest: Rest, start: Motion) -> tuple[Array, Array]:
    """Path (T, 3) and orientation (T, 4) of the root; heights are still 0.

    The first frame of `start`, of which `motion` is a part or the whole, is over the origin and faces +x.
    """
    home = quat_conj(yaw_quat(yaw_of_quat(start.joint_quat[:1, 0])))
    path = quat_rotate(home, motion.root_pos - start.root_pos[0]) * leg_scale(motion, rest)
    path[:, 2] = 0.0
    return path, quat_mul(home, motion.joint_quat[:, 0])


def goals(motion: Motion, rig: Rig, rest: Rest, root_pos: Array, root_quat: Array) -> dict[str, Goal]:
    """A goal for every follower but the root's, by human joint, for a root at `root_pos` (T, 3), `root_quat` (T, 4).

    Raises RigError where `rig.follow` gives a position weight to a joint that no limb leads to.
    """
    turn = motion.global_quat()
    upper = quat_conj(turn[:, motion.skeleton.index(CHEST)])
    to_rig = quat_mul(root_quat, quat_conj(turn[:, 0]))
    place = _limb_places(motion, rest, upper)
    firm = np.ones(len(motion))
    out: dict[str, Goal] = {}
    for follow in rig.follow:
        name = follow.human
        if name == ROOT:
            continue
        if follow.position > 0 and name not in place:
            leads = ", ".join(joint for limb in LIMBS for joint in limb[1:])
            raise RigError(f"rig {rig.name!r}: {name} cannot have a position weight; a limb must lead to it: {leads}")
        local = place.get(name, np.zeros((len(motion), 3)))
        human = turn[:, motion.skeleton.index(name)]
        if name in UPPER:
            base = _chest(rest)
            frame = quat_mul(quat_conj(rest.turn[base]), quat_mul(upper, human))
            out[name] = Goal(follow, base, local, quat_mul(frame, rest.turn[name]), firm)
        else:
            world = quat_mul(quat_mul(to_rig, human), rest.turn[name])
            out[name] = Goal(follow, "", root_pos + quat_rotate(root_quat, local), world, firm)
    return out


def _limb_places(motion: Motion, rest: Rest, upper: Array) -> dict[str, Array]:
    """Positions (T, 3) of the followers along the limbs: arms in the chest follower's frame, legs in the root's."""
    position = motion.positions()
    level = quat_conj(motion.joint_quat[:, 0])
    out: dict[str, Array] = {}
    for limb in LIMBS:
        chain = _chain(limb, rest)
        if limb[0] not in chain:
            continue
        arm = limb[0] in UPPER
        base, frame = (_chest(rest), upper) if arm else (ROOT, level)
        at = np.broadcast_to(rest.offset(base, chain[0]), (len(motion), 3))
        for above, joint, length in zip(chain, chain[1:], _rig_lengths(chain, rest), strict=False):
            reach = position[:, motion.skeleton.index(joint)] - position[:, motion.skeleton.index(above)]
            reach = quat_rotate(frame, reach) * (length / _human_length(motion, above, joint))
            at = at + quat_rotate(quat_conj(rest.turn[base]), reach)
            out[joint] = at
    return out


def _chest(rest: Rest) -> str:
    return CHEST if CHEST in rest.place else ROOT


def _chain(limb: tuple[str, ...], rest: Rest) -> tuple[str, ...]:
    return tuple(joint for joint in limb if joint in rest.place)


def _rig_lengths(chain: tuple[str, ...], rest: Rest) -> list[float]:
    return [float(np.linalg.norm(rest.offset(a, b))) for a, b in pairwise(chain)]


def _human_length(motion: Motion, above: str, joint: str) -> float:
    """Metres along the skeleton from `above` down to `joint`."""
    skeleton, total = motion.skeleton, 0.0
    index, stop = skeleton.index(joint), skeleton.index(above)
    while index != stop:
        total += float(np.linalg.norm(skeleton.offsets[index]))
        index = skeleton.parents[index]
    return total
