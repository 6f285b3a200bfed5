"""Where the parts of a rig are in every frame, and what overlaps what: forward kinematics and collision alone."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.scene import FLOOR, Scene

Array = NDArray[np.float64]
ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")  # human joints whose followers are hands and feet


@dataclass(frozen=True)
class Geometry:
    """T poses in world coordinates, metres.

    `soles`: foot name → (T, S, 3) of its sole sites. `touching`: foot name → (T,), its body touches the floor.
    `ends` (T, E, 3): the hands and feet, named by `end_names`. `bodies` (T, B, 3): centres of mass, named by
    `body_names`. `root_up` (T, 3): the root's z axis. `floor_depth` (T,): how deep the deepest part is in the floor,
    and `floor_body` which. `self_depth` (T,): deepest overlap of two parts that are not neighbours, and `self_pair`
    which.
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


def measure(scene: Scene, qpos: Array) -> Geometry:
    """The geometry of `qpos` (T, 7 + nj); on a stand the root is where it was bolted, whatever `qpos` says."""
    model, data = scene.model, mujoco.MjData(scene.model)
    floor, frames = model.geom(FLOOR).id, len(qpos)
    feet = {f.name: (model.body(f.body).id, [model.site(s).id for s in f.sites]) for f in scene.rig.feet}
    hands = [f.body for f in scene.rig.follow if f.human in ENDS]
    moving = [b for b in range(1, model.nbody) if model.body_mocapid[b] < 0]
    root = model.body(scene.rig.root).id
    soles = {name: np.empty((frames, len(sites), 3)) for name, (_, sites) in feet.items()}
    touching = {name: np.zeros(frames, bool) for name in feet}
    ends, bodies = np.empty((frames, len(hands), 3)), np.empty((frames, len(moving), 3))
    root_up, floor_depth, self_depth = np.empty((frames, 3)), np.zeros(frames), np.zeros(frames)
    floor_body, self_pair = [""] * frames, [("", "")] * frames
    for k, row in enumerate(qpos):
        scene.place(data, row)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        bodies[k], root_up[k] = data.xipos[moving], data.xmat[root].reshape(3, 3)[:, 2]
        ends[k] = np.reshape([_position(model, data, name) for name in hands], (-1, 3))  # a bust has none
        on_floor, depth, pairs = _contacts(model, data, floor)
        for name, (body, sites) in feet.items():
            soles[name][k] = data.site_xpos[sites]
            touching[name][k] = bool(np.any(on_floor & (pairs == body).any(1)))
        if on_floor.any():
            worst = int(np.argmax(np.where(on_floor, depth, -1.0)))
            floor_depth[k], floor_body[k] = max(depth[worst], 0.0), model.body(int(pairs[worst].max())).name
        if not on_floor.all():
            worst = int(np.argmax(np.where(on_floor, -1.0, depth)))
            self_depth[k] = max(depth[worst], 0.0)
            self_pair[k] = (model.body(int(pairs[worst, 0])).name, model.body(int(pairs[worst, 1])).name)
    return Geometry(
        soles=soles,
        touching=touching,
        end_names=tuple(hands),
        ends=ends,
        body_names=tuple(model.body(b).name for b in moving),
        bodies=bodies,
        root_up=root_up,
        floor_depth=floor_depth,
        floor_body=tuple(floor_body),
        self_depth=self_depth,
        self_pair=tuple(self_pair),
    )


def _contacts(
    model: mujoco.MjModel, data: mujoco.MjData, floor: int
) -> tuple[NDArray[np.bool_], Array, NDArray[np.int_]]:
    """Per contact: is it with the floor, how deep (m), and which two bodies."""
    geoms = data.contact.geom
    return (geoms == floor).any(1), -data.contact.dist, model.geom_bodyid[geoms]


def _position(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Array:
    """World position (3,) of the body or, where there is none of that name, the site."""
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    return data.xpos[body] if body >= 0 else data.site(name).xpos
