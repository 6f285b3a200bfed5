"""Which body of a robot is which part of a human: guessed from names where they say it, else from geometry."""

from __future__ import annotations

import re
from dataclasses import dataclass

import mujoco
import numpy as np

from motiongen.rotation import Array
from retarget.table import RigError

KINDS = {
    "leg": re.compile(r"hip|knee|ankle|ank|thigh|shin|calf|leg|foot|toe"),
    "arm": re.compile(r"shoulder|sho|elbow|arm|wrist|hand"),
    "head": re.compile(r"head|neck"),
}
KNEE, ELBOW = re.compile(r"knee|kfe|shin|calf"), re.compile(r"elbow|_el(_|$)|forearm")
SAME_PLACE = 0.02  # of the robot's height: bodies that are no farther apart count as one


@dataclass(frozen=True)
class Chain:
    """A limb: its bodies with a joint from the trunk out, and where it ends, (3,) metres at the zero pose."""

    kind: str
    side: str
    bodies: tuple[int, ...]
    tip: Array
    named: bool


@dataclass(frozen=True)
class Skeleton:
    """`model` with its free joint, its kinematics at the zero pose in `data`, the limbs, `height` (m) of the root's
    origin over the lowest point, and `size` (m) from there to the highest."""

    model: mujoco.MjModel
    data: mujoco.MjData
    root: int
    chains: tuple[Chain, ...]
    height: float
    size: float

    def limb(self, kind: str, side: str) -> Chain | None:
        """The longest limb of that kind and side; None where there is none."""
        have = [c for c in self.chains if (c.kind, c.side) == (kind, side)]
        return max(have, key=lambda c: len(c.bodies), default=None)


def read_skeleton(model: mujoco.MjModel) -> Skeleton:
    """The limbs of a compiled model, whose first joint is the free joint of the root.

    Raises RigError where it has no free joint, or a joint that is not a hinge.
    """
    free = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE]
    if len(free) != 1 or free[0] != 0:
        raise RigError("the model should have one free joint, on its root, before all others: add <freejoint/> there")
    for j in range(1, model.njnt):
        if model.jnt_type[j] != mujoco.mjtJoint.mjJNT_HINGE:
            raise RigError(f"joint {model.joint(j).name!r} is no hinge; hinges are all that a rig can have")
        if not model.joint(j).name:
            raise RigError(f"a joint of body {model.body(int(model.jnt_bodyid[j])).name!r} has no name")
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    root = int(model.jnt_bodyid[0])
    corners = [c for g in range(model.ngeom) if _inside(model, g, root) for c in geom_corners(model, data, g)]
    low, high = (f([c[2] for c in corners] or [0.0]) for f in (min, max))
    leaves = [b for b in range(1, model.nbody) if model.body_jntnum[b] and not _later(model, b) and b != root]
    chains = [_chain(model, data, b, root, float(high - low)) for b in leaves]
    return Skeleton(model, data, root, tuple(chains), float(-low), float(high - low))


def geom_corners(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Array:
    """(8, 3) world corners of a geom's bounding box."""
    centre, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    return data.geom_xpos[geom] + (centre + signs * half) @ data.geom_xmat[geom].reshape(3, 3).T


def solid_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Geoms of `body` that can touch something, or all of them where none can."""
    own = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
    return [g for g in own if model.geom_contype[g] or model.geom_conaffinity[g]] or own


def far_end(skeleton: Skeleton, body: int) -> Array:
    """(3,) the middle of the side of a body's bounding box that is farthest from the body's origin, world."""
    model, data = skeleton.model, skeleton.data
    geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == body]
    corners = np.array([c for g in geoms for c in geom_corners(model, data, g)])
    if not len(corners):
        return np.array(data.xpos[body])
    low, high = corners.min(0), corners.max(0)
    reach = np.where(high - data.xpos[body] > data.xpos[body] - low, high, low) - data.xpos[body]
    along = int(np.argmax(np.abs(reach)))
    end = (low + high) / 2
    end[along] = data.xpos[body][along] + reach[along]
    return end


def bend(model: mujoco.MjModel, chain: Chain, pattern: re.Pattern[str], otherwise: int) -> int:
    """The body of the knee or elbow in `chain`: the last one that is named so, else number `otherwise` in it."""
    named = [b for b in chain.bodies if pattern.search(_words(model, b))]
    return named[-1] if named else chain.bodies[min(otherwise, len(chain.bodies) - 1)]


def _chain(model: mujoco.MjModel, data: mujoco.MjData, leaf: int, root: int, size: float) -> Chain:
    path = [leaf]
    while model.body_parentid[path[0]] != root:
        path.insert(0, int(model.body_parentid[path[0]]))
    path = [b for b in path if model.body_jntnum[b] and len(_leaves(model, b)) == 1]
    tip = np.array(data.xpos[leaf])
    side = "left" if tip[1] > SAME_PLACE * size else "right" if tip[1] < -SAME_PLACE * size else ""
    said = [kind for kind, words in KINDS.items() if any(words.search(_words(model, b)) for b in path)]
    if len(said) == 1:
        kind = said[0]
    elif tip[2] < data.xpos[path[0], 2] - 0.15 * size and tip[2] < data.xpos[root, 2]:
        kind = "leg"
    else:
        kind = "arm" if side else "head"
    return Chain(kind, "" if kind == "head" else side, tuple(path), tip, len(said) == 1)


def _words(model: mujoco.MjModel, body: int) -> str:
    first = model.body_jntadr[body]
    joints = [model.joint(j).name for j in range(first, first + model.body_jntnum[body])]
    return " ".join([model.body(body).name, *joints]).lower()


def _later(model: mujoco.MjModel, body: int) -> list[int]:
    """Bodies with a joint below `body`."""
    return [b for b in range(body + 1, model.nbody) if model.body_jntnum[b] and _inside_body(model, b, body)]


def _leaves(model: mujoco.MjModel, body: int) -> list[int]:
    below = [body, *_later(model, body)]
    return [b for b in below if not _later(model, b)]


def _inside(model: mujoco.MjModel, geom: int, body: int) -> bool:
    return _inside_body(model, int(model.geom_bodyid[geom]), body)


def _inside_body(model: mujoco.MjModel, child: int, body: int) -> bool:
    while child > body:
        child = int(model.body_parentid[child])
    return child == body
