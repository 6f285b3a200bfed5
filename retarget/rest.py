"""The rig at its zero pose: where its followers are, and the points of its soles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np

from motiongen.rotation import Array, quat_conj, quat_rotate
from retarget.rig import Rig
from retarget.treads import tread_of


@dataclass(frozen=True)
class Rest:
    """`place`: human joint → position (3,) of its follower; `turn`: its orientation (4,); at the zero pose, in metres
    from the root and in the root's frame. `soles`: human ankle → sole points (n, 3) in the frame of the foot's body;
    `treads`: what the foot covers of the floor, as `tread_of` gives it.
    """

    place: dict[str, Array]
    turn: dict[str, Array]
    soles: dict[str, Array]
    treads: dict[str, Array]

    @cached_property
    def offsets(self) -> dict[tuple[str, str], Array]:
        """(3,) from one follower to another, in the frame of the first, at the zero pose."""
        names = list(self.place)
        place, turn = (np.array([part[name] for name in names]) for part in (self.place, self.turn))
        way = quat_rotate(quat_conj(turn)[:, None], place[None] - place[:, None])
        return {(a, b): way[i, j] for i, a in enumerate(names) for j, b in enumerate(names)}


def rest_of(rig: Rig, model: mujoco.MjModel) -> Rest:
    """Forward kinematics of `model` (of the rig, with its free joint) at zero joint angles."""
    data = mujoco.MjData(model)
    data.qpos[:] = 0
    data.qpos[3] = 1
    mujoco.mj_kinematics(model, data)
    place, turn, soles, treads = {}, {}, {}, {}
    for follow in rig.follow:
        frame = data.site(follow.body) if is_site(model, follow.body) else data.body(follow.body)
        place[follow.human] = np.array(frame.xpos)
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, frame.xmat.ravel())
        turn[follow.human] = quat
    for foot in rig.feet:
        body = data.body(foot.body)
        points = np.array([data.site(site).xpos for site in foot.sites]) - body.xpos
        soles[foot.human] = quat_rotate(quat_conj(body.xquat), points)
        treads[foot.human] = tread_of(model, body.id, body.xquat)
    return Rest(place, turn, soles, treads)


def is_site(model: mujoco.MjModel, name: str) -> bool:
    """Whether the follower is a site of the model (else it is a body)."""
    return mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name) >= 0
