"""The Virtual Motion Capture protocol: the bones of a person as OSC over UDP, under the names of Unity's humanoid.

Unity's world is left-handed, x right, y up, z forward, in metres, and its quaternions are x y z w. All bones are turned
by the identity in the T-pose, each relative to the one that carries it, as in a `Motion`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from drivers.osc import Argument, Message, bundle
from drivers.people import Person
from motiongen.motion import SMPL_JOINTS, Motion, Skeleton
from motiongen.rotation import Array, quat_mul, quat_rotate
from motiongen.smpl import SMPL_SKELETON

PORT = 39539  # where those who show bones listen
ROOT, BONE, TIME, WELL = "/VMC/Ext/Root/Pos", "/VMC/Ext/Bone/Pos", "/VMC/Ext/T", "/VMC/Ext/OK"
_SIDES = {
    "UpperLeg": "hip", "LowerLeg": "knee", "Foot": "ankle", "Toes": "foot", "Shoulder": "collar",
    "UpperArm": "shoulder", "LowerArm": "elbow", "Hand": "wrist",
}  # fmt: skip
BONES = {
    "Hips": "pelvis", "Spine": "spine1", "Chest": "spine2", "UpperChest": "spine3", "Neck": "neck", "Head": "head",
    **{f"{side}{bone}": f"{side.lower()}_{joint}" for side in ("Left", "Right") for bone, joint in _SIDES.items()},
}  # fmt: skip
# A humanoid has the others or has not (Unity's HumanTrait); what is not there goes with what carries it.
OPTIONAL = ("Chest", "UpperChest", "Neck", "LeftShoulder", "RightShoulder", "LeftToes", "RightToes")
NEEDED = tuple(bone for bone in BONES if bone not in OPTIONAL)
LIMBS = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in ("knee", "ankle", "elbow", "wrist"))
BONES_AT_ONCE = 11  # in a datagram, which then fits an Ethernet frame
FURTHEST = 1000.0  # m: nothing real is
UNIT = 0.1  # by which the length of a quaternion may be off: senders round
SHORTEST, LONGEST = 0.01, 2.0  # m, of the bone of a limb: what is shorter was not told


class VmcError(ValueError):
    """Messages that cannot be a person's bones; one line says why."""


# --- out


def datagrams(motion: Motion, frame: int, time_s: float) -> list[bytes]:
    """The bones of one frame of `motion`, as those expect them who show avatars; `time_s` since the stream began."""
    names = {joint: bone for bone, joint in BONES.items()}
    offsets = motion.skeleton.offsets
    bones = [
        Message(BONE, (names[joint], *_unity(motion.root_pos[frame] if j == 0 else offsets[j], turn)))
        for j, (joint, turn) in enumerate(zip(motion.skeleton.names, motion.joint_quat[frame], strict=True))
    ]
    still = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    head = [Message(WELL, (1,)), Message(TIME, (time_s,)), Message(ROOT, ("root", *still))]
    parts = [bones[k : k + BONES_AT_ONCE] for k in range(0, len(bones), BONES_AT_ONCE)]
    return [bundle([*head, *parts[0]]), *map(bundle, parts[1:])]


def _unity(pos: Array, quat: Array) -> tuple[float, ...]:
    (x, y, z), (w, i, j, k) = pos.tolist(), quat.tolist()
    return (-y, z, x, j, -k, -i, w)


# --- in


class Performer:
    """Puts together what a performer says: a pose is whole once every bone that is needed has come again."""

    def __init__(self) -> None:
        self._pos: dict[str, Array] = {}
        self._turn: dict[str, Array] = {}
        self._root = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self._awaited = set(NEEDED)

    @property
    def missing(self) -> tuple[str, ...]:
        """The bones that are needed and have never come."""
        return tuple(bone for bone in NEEDED if bone not in self._turn)

    def take(self, messages: Iterable[Message], at_ns: int) -> Person | None:
        """The pose that `messages`, which came at `at_ns`, make whole, None where they make none.

        Others than bones and root are ignored.

        Raises VmcError where a number is missing or senseless; nothing of them counts then.
        """
        bones: dict[str, tuple[Array, Array]] = {}
        root = self._root
        for message in messages:
            if message.address == ROOT:
                root = _place(message.args)
            elif message.address == BONE:
                place = _place(message.args)
                if message.args[0] in BONES:
                    bones[str(message.args[0])] = place
        self._root = root
        for bone, (pos, turn) in bones.items():
            self._pos[bone], self._turn[bone] = pos, turn
        self._awaited -= bones.keys()
        if self._awaited:
            return None
        self._awaited = set(NEEDED)
        return self._person(at_ns)

    def skeleton(self) -> Skeleton:
        """The performer's proportions, as far as they were told, else those of SMPL; of a whole pose.

        Raises VmcError for a limb that nobody has.
        """
        offsets = np.zeros((len(SMPL_JOINTS), 3))
        for bone, joint in BONES.items():
            j = SMPL_JOINTS.index(joint)
            if j and bone in self._pos:
                offsets[j] = self._pos[bone]
        limbs = {joint: float(np.linalg.norm(offsets[SMPL_JOINTS.index(joint)])) for joint in LIMBS}
        if min(limbs.values()) < SHORTEST:
            return SMPL_SKELETON
        longest = max(limbs, key=limbs.__getitem__)
        if limbs[longest] > LONGEST:
            raise VmcError(f"VMC: the bone to {longest} is {limbs[longest]:.3g} m long; VMC is in metres")
        for j, joint in enumerate(SMPL_JOINTS):
            if joint.endswith("_foot") and not offsets[j].any():
                offsets[j] = SMPL_SKELETON.offsets[j]
        return Skeleton(SMPL_JOINTS, SMPL_SKELETON.parents, offsets, SMPL_SKELETON.foot_height)

    def _person(self, at_ns: int) -> Person:
        turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(SMPL_JOINTS), 1))
        for bone, turn in self._turn.items():
            turns[SMPL_JOINTS.index(BONES[bone])] = turn
        pos, turn = self._root
        turns[0] = quat_mul(turn, turns[0])
        return Person(at_ns, pos + quat_rotate(turn, self._pos["Hips"]), turns)


def _place(args: tuple[Argument, ...]) -> tuple[Array, Array]:
    """Position (3,) and quaternion (4,) of ours, of a name and seven numbers (more may follow: a scale)."""
    name, numbers = (args[0] if args else ""), args[1:8]
    if not isinstance(name, str) or len(numbers) < 7 or not all(isinstance(n, float) for n in numbers):
        raise VmcError(f"VMC: {str(name)[:40]!r} must come with 7 floats: where it is and how it is turned")
    x, y, z, i, j, k, w = (float(n) for n in numbers)
    length = math.sqrt(i * i + j * j + k * k + w * w)
    if not (abs(x) <= FURTHEST and abs(y) <= FURTHEST and abs(z) <= FURTHEST):
        raise VmcError(f"VMC: {name[:40]!r} is at {x:g} {y:g} {z:g} m; at most {FURTHEST:g}")
    if not abs(length - 1) <= UNIT:
        raise VmcError(f"VMC: the quaternion of {name[:40]!r} has length {length:.3g}, not 1")
    return np.array([z, -x, y]), np.array([w, -k, i, -j]) / length
