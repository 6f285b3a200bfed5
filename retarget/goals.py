"""Where each follower of the rig should be: human motion carried over limb by limb.

A limb keeps the human's directions and takes the rig's lengths, so that a target is never out of reach: elbow =
shoulder + direction of the human upper arm × the rig's upper arm, and so on down. Arms and head are measured in the
frame of the chest (rigs without a waist then still wave as the person does), legs from the hips. The pelvis keeps its
orientation; its path is scaled by the length of the legs.
"""

from __future__ import annotations

import math
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
    place = _limb_places(motion, rest, turn, upper)
    follows = [follow for follow in rig.follow if follow.human != ROOT]
    _require_limbs(rig, follows, set(place))
    base, firm, none = _chest(rest), np.ones(len(motion)), np.zeros((len(motion), 3))
    arms = [follow for follow in follows if follow.human in UPPER]
    legs = [follow for follow in follows if follow.human not in UPPER]
    out: dict[str, Goal] = {}
    frame = quat_mul(quat_conj(rest.turn[base]), upper)
    for follow, quat in zip(arms, _turns(motion, rest, turn, frame, arms), strict=True):
        out[follow.human] = Goal(follow, base, place.get(follow.human, none), quat, firm)
    frame = quat_mul(root_quat, quat_conj(turn[:, 0]))
    for follow, quat in zip(legs, _turns(motion, rest, turn, frame, legs), strict=True):
        local = place.get(follow.human, none)
        out[follow.human] = Goal(follow, "", root_pos + quat_rotate(root_quat, local), quat, firm)
    return out


def _require_limbs(rig: Rig, follows: list[Follow], placed: set[str]) -> None:
    for follow in follows:
        if follow.position > 0 and follow.human not in placed:
            leads = ", ".join(joint for limb in LIMBS for joint in limb[1:])
            raise RigError(
                f"rig {rig.name!r}: {follow.human} cannot have a position weight; a limb must lead to it: {leads}"
            )


def _turns(motion: Motion, rest: Rest, turn: Array, frame: Array, follows: list[Follow]) -> list[Array]:
    """(T, 4) each: how the human joints are turned in the world, `turn` (T, J, 4), as seen from `frame` (T, 4), carried
    over to what follows them.
    """
    if not follows:
        return []
    human = turn[:, [motion.skeleton.index(follow.human) for follow in follows]]
    own = np.stack([rest.turn[follow.human] for follow in follows])
    return list(np.moveaxis(quat_mul(quat_mul(frame[:, None], human), own), 1, 0))


def _limb_places(motion: Motion, rest: Rest, turn: Array, upper: Array) -> dict[str, Array]:
    """Positions (T, 3) of the followers along the limbs: arms in the chest follower's frame, legs in the root's."""
    position, level = motion.positions(turn), quat_conj(turn[:, 0])
    out: dict[str, Array] = {}
    for base, frame, arms in ((_chest(rest), upper, True), (ROOT, level, False)):
        chains = [_chain(limb, rest) for limb in LIMBS if (limb[0] in UPPER) == arms and limb[0] in rest.place]
        bones = [bone for chain in chains for bone in pairwise(chain)]
        if not bones:
            continue
        above, below = ([motion.skeleton.index(bone[end]) for bone in bones] for end in (0, 1))
        scale = np.array([_length(rest.offsets[bone]) / _human_length(motion, *bone) for bone in bones])
        reach = (position[:, below] - position[:, above]) * scale[:, None]
        reach = quat_rotate(quat_mul(quat_conj(rest.turn[base]), frame)[:, None], reach)
        for chain in chains:
            at = np.broadcast_to(rest.offsets[base, chain[0]], (len(motion), 3))
            for bone in pairwise(chain):
                at = out[bone[1]] = at + reach[:, bones.index(bone)]
    return out


def _chest(rest: Rest) -> str:
    return CHEST if CHEST in rest.place else ROOT


def _chain(limb: tuple[str, ...], rest: Rest) -> tuple[str, ...]:
    return tuple(joint for joint in limb if joint in rest.place)


def _rig_lengths(chain: tuple[str, ...], rest: Rest) -> list[float]:
    return [_length(rest.offsets[bone]) for bone in pairwise(chain)]


def _length(way: Array) -> float:
    return math.sqrt(float(way @ way))


def _human_length(motion: Motion, above: str, joint: str) -> float:
    """Metres along the skeleton from `above` down to `joint`."""
    skeleton, total = motion.skeleton, 0.0
    index, stop = skeleton.index(joint), skeleton.index(above)
    while index != stop:
        total += _length(skeleton.offsets[index])
        index = skeleton.parents[index]
    return total
