"""Those whom a rig can mirror: who sends bones as VMC, and generators that send poses of the Unitree G1 as SONIC."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from drivers.inbox import Heard
from drivers.osc import messages_in
from drivers.people import Person
from drivers.sonic import RATE_HZ, ROBOT, read_sonic
from drivers.vmc import NEEDED, Performer
from motiongen.motion import Skeleton
from motiongen.smpl import SMPL_SKELETON
from retarget.as_human import as_human, body_of
from retarget.rig import load_rig

NS = 1_000_000_000
CREEP = 200e-6  # two crystal clocks drift apart by less
RESTART_NS = NS // 2  # frames that are told to come so much sooner or later than they did are of another run


class Telling(Protocol):
    """Makes poses of what a performer tells."""

    def hear(self, heard: Heard) -> list[Person]:
        """The poses that this makes whole. Raises OscError, VmcError, SonicError (all ValueError)."""
        ...

    def skeleton(self) -> Skeleton:
        """The proportions of whoever was heard. Raises VmcError where nobody has them."""
        ...

    @property
    def lacking(self) -> str:
        """What nothing can be done without and has not come; "" where all has."""
        ...


class OfBones:
    """Tells by VMC."""

    def __init__(self) -> None:
        self._performer = Performer()

    def hear(self, heard: Heard) -> list[Person]:
        person = self._performer.take(messages_in(heard.data), heard.at_ns)
        return [] if person is None else [person]

    def skeleton(self) -> Skeleton:
        return self._performer.skeleton()

    @property
    def lacking(self) -> str:
        missing = self._performer.missing
        return f"bones that never came: {', '.join(missing)}" if 0 < len(missing) < len(NEEDED) else ""


class OfSonic:
    """Tells by SONIC, which is seen as the person whom the robot would follow.

    A frame is at its number's time after the one whose message was quickest; see `drivers.gate`.
    """

    def __init__(self) -> None:
        rig = load_rig(ROBOT)
        self._body = body_of(rig)
        self._root = np.array([0.0, 0.0, rig.nominal.height])
        self._next = 0
        self._offset_ns = self._heard_ns = 0

    def hear(self, heard: Heard) -> list[Person]:
        sonic = read_sonic(heard.data)
        first_ns = heard.at_ns - round(int(sonic.index[0]) * NS / RATE_HZ)
        let_up = self._offset_ns + int(CREEP * (heard.at_ns - self._heard_ns))
        if abs(first_ns - let_up) > RESTART_NS:
            self._next, let_up = 0, first_ns
        self._offset_ns, self._heard_ns = min(first_ns, let_up), heard.at_ns
        new = sonic.index >= self._next
        if not new.any():
            return []
        self._next = int(sonic.index[-1]) + 1
        root = np.tile(self._root, (int(new.sum()), 1))
        motion = as_human(self._body, np.concatenate([root, sonic.quat[new], sonic.pos[new]], axis=1), RATE_HZ)
        at_ns = [self._offset_ns + round(int(k) * NS / RATE_HZ) for k in sonic.index[new]]
        return [Person(*each) for each in zip(at_ns, motion.root_pos, motion.joint_quat, strict=True)]

    def skeleton(self) -> Skeleton:
        return SMPL_SKELETON

    @property
    def lacking(self) -> str:
        return ""


def telling(address: str) -> Telling:
    """Who tells at `address`, see `drivers.inbox`. Raises RigError where the robot's model cannot be had."""
    return OfSonic() if address.startswith("sonic:") else OfBones()
