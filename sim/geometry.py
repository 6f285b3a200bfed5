"""Where the parts of a rig are in every frame, and what overlaps what: forward kinematics and collision alone."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.scene import FLOOR, Scene

Array = NDArray[np.float64]
ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")  # human joints whose followers are hands and feet


FINGER = 0.025  # m: what a finger fits into; no less keeps it from being crushed (ISO 13854)


@dataclass(frozen=True)
class Geometry:
    """T poses in world coordinates, metres.

    `soles`: foot name → (T, S, 3) of its sole sites. `touching`: foot name → (T,), its body touches the floor.
    `ends` (T, E, 3): the hands and feet, named by `end_names`. `bodies` (T, B, 3): centres of mass, named by
    `body_names`. `root_up` (T, 3): the root's z axis. `floor_depth` (T,): how deep the deepest part is in the floor,
    and `floor_body` which. `self_depth` (T,): deepest overlap of two parts that are not neighbours, and `self_pair`
    which. `gaps`: two such parts → (T,) how near they are, infinite where that is more than FINGER; only parts that
    ever come so near.
    """

    soles: dict[str, Array]
    touching: dict[str, NDArray[np.bool_]]
    end_names: tuple[str, ...]
    ends: Array
    body_names: tuple[str, ...]
    bodies: Array
    root_up: Array
    floor_depth: Array
    floor_body: tuple[str, ...]
    self_depth: Array
    self_pair: tuple[tuple[str, str], ...]
    gaps: dict[tuple[str, str], Array]


def measure(scene: Scene, qpos: Array) -> Geometry:
    """The geometry of `qpos` (T, 7 + nj); on a stand the root is where it was bolted, whatever `qpos` says."""
    model, frames = copy.copy(scene.model), len(qpos)
    floor = model.geom(FLOOR).id
    model.geom_margin[np.arange(model.ngeom) != floor] = FINGER / 2  # MuJoCo adds the margins of two
    model.body_margin[1:] = FINGER / 2  # and before looking closer, those of their bodies
    data = mujoco.MjData(model)
    inertial, body_pos = np.empty((frames, model.nbody, 3)), np.empty((frames, model.nbody, 3))
    site_pos, root_up = np.empty((frames, model.nsite, 3)), np.empty((frames, 3))
    poses = scene.poses(qpos)
    # Views, since to ask MuJoCo for them anew in every frame takes as long as the kinematics.
    pose, xipos, xpos, sites = data.qpos, data.xipos, data.xpos, data.site_xpos
    up = data.xmat[model.body(scene.rig.root).id, 2::3]
    touch = []
    for k in range(frames):
        pose[:] = poses[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        inertial[k], body_pos[k], site_pos[k], root_up[k] = xipos, xpos, sites, up
        if data.ncon:
            touch.append(_Touch(k, data.contact.geom.copy(), data.contact.dist.copy()))
    near = _Near.of(model, frames, floor, touch)
    floor_depth, floor_pair = near.deepest(near.on_floor)
    self_depth, self_pair = near.deepest(~near.on_floor)
    hands = [f.body for f in scene.rig.follow if f.human in ENDS]
    moving = [b for b in range(1, model.nbody) if model.body_mocapid[b] < 0]
    return Geometry(
        soles={f.name: site_pos[:, [model.site(s).id for s in f.sites]] for f in scene.rig.feet},
        touching={f.name: near.touches_floor(model.body(f.body).id) for f in scene.rig.feet},
        end_names=tuple(hands),
        ends=np.stack([_positions(model, body_pos, site_pos, name) for name in hands], axis=1)
        if hands
        else np.empty((frames, 0, 3)),
        body_names=tuple(model.body(b).name for b in moving),
        bodies=inertial[:, moving],
        root_up=root_up,
        floor_depth=floor_depth,
        floor_body=tuple(model.body(int(b)).name if b else "" for b in floor_pair.max(1)),
        self_depth=self_depth,
        self_pair=tuple((model.body(int(a)).name, model.body(int(b)).name) if b else ("", "") for a, b in self_pair),
        gaps=near.gaps(model),
    )


class _Touch(NamedTuple):
    frame: int
    geom: NDArray[np.int_]
    dist: Array


@dataclass(frozen=True)
class _Near:
    """All contacts of all frames, those that are only near included: `frame`, `pair` of bodies, `dist` in m."""

    frames: int
    frame: NDArray[np.int_]
    pair: NDArray[np.int_]
    dist: Array
    on_floor: NDArray[np.bool_]

    @classmethod
    def of(cls, model: mujoco.MjModel, frames: int, floor: int, touch: list[_Touch]) -> _Near:
        geoms = np.concatenate([np.empty((0, 2), int), *(t.geom for t in touch)])
        return cls(
            frames=frames,
            frame=np.repeat([t.frame for t in touch], [len(t.dist) for t in touch]).astype(int),
            pair=np.sort(model.geom_bodyid[geoms], axis=1),
            dist=np.concatenate([np.empty(0), *(t.dist for t in touch)]),
            on_floor=(geoms == floor).any(1),
        )

    def deepest(self, which: NDArray[np.bool_]) -> tuple[Array, NDArray[np.int_]]:
        """(T,) depth in m of the deepest contact among `which`, 0 where none touches, and its bodies (T, 2)."""
        order = np.flatnonzero(which & (self.dist <= 0))
        order = order[np.argsort(-self.dist[order], kind="stable")]  # the deepest is written last
        depth, pair = np.zeros(self.frames), np.zeros((self.frames, 2), int)
        depth[self.frame[order]], pair[self.frame[order]] = -self.dist[order], self.pair[order]
        return depth, pair

    def touches_floor(self, body: int) -> NDArray[np.bool_]:
        out = np.zeros(self.frames, bool)
        out[self.frame[self.on_floor & (self.dist <= 0) & (self.pair == body).any(1)]] = True
        return out

    def gaps(self, model: mujoco.MjModel) -> dict[tuple[str, str], Array]:
        mine = ~self.on_floor
        pairs, which = np.unique(self.pair[mine], axis=0, return_inverse=True)
        gap = np.full((len(pairs), self.frames), np.inf)
        np.minimum.at(gap, (which.ravel(), self.frame[mine]), self.dist[mine])
        names = [(model.body(int(a)).name, model.body(int(b)).name) for a, b in pairs]
        return dict(zip(names, gap, strict=True))


def _positions(model: mujoco.MjModel, body_pos: Array, site_pos: Array, name: str) -> Array:
    """World positions (T, 3) of the body or, where there is none of that name, the site."""
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    return body_pos[:, body] if body >= 0 else site_pos[:, model.site(name).id]
