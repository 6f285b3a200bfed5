"""Which way a part of a rig goes, in words, when one of its joints turns: for somebody who stands before it."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from retarget.model import load_model
from retarget.rig import Rig

SMALL = 0.05  # rad
SLIDES = 0.02  # m a rad: a part that goes less than this is said to turn
GOES = (("back", "forward"), ("right", "left"), ("down", "up"))
TURNS = (("its left side up", "its right side up"), ("its front up", "its front down"), ("to the right", "to the left"))


def way_of(rig: Rig, joint: str, way: int) -> str:
    """What somebody sees when `joint` turns by `way` (+1 or -1) from the nominal pose: "right_hand goes up".

    Left and right are the rig's own. Raises RigError where the model does not load.
    """
    model = load_model(rig)
    data = mujoco.MjData(model)
    hinge = model.joint(joint)
    names, before = _points(model, data, rig, int(hinge.bodyid[0]), {})
    axis = data.xaxis[hinge.id].copy()
    _, after = _points(model, data, rig, int(hinge.bodyid[0]), {joint: way * SMALL})
    moved = after - before
    furthest = int(np.linalg.norm(moved, axis=1).argmax())
    at = int(np.abs(moved[furthest]).argmax())
    along = float(moved[furthest, at])
    if abs(along) > SLIDES * SMALL and abs(axis[2]) < 0.7:
        return f"{names[furthest]} goes {GOES[at][int(along > 0)]}"
    at = int(np.abs(axis).argmax())
    return f"{names[0]} turns {TURNS[at][int(axis[at] * way > 0)]}"


def _points(
    model: mujoco.MjModel, data: mujoco.MjData, rig: Rig, top: int, extra: dict[str, float]
) -> tuple[list[str], NDArray[np.float64]]:
    """Named bodies, sites and geoms from body `top` on, and where they are (n, 3) in the nominal pose and `extra`."""
    angles = np.array(rig.pose_vector(rig.nominal))
    for name, angle in extra.items():
        angles[rig.joint_names().index(name)] += angle
    data.qpos[:] = [0, 0, rig.nominal.height, 1, 0, 0, 0, *angles]
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    found = [(model.body(b).name, b, data.xipos[b]) for b in range(model.nbody)]
    found += [(model.site(s).name, model.site_bodyid[s], data.site_xpos[s]) for s in range(model.nsite)]
    found += [(model.geom(g).name, model.geom_bodyid[g], data.geom_xpos[g]) for g in range(model.ngeom)]
    named = [(name, place.copy()) for name, body, place in found if name and _below(model, int(body), top)]
    return [name for name, _ in named], np.array([place for _, place in named])


def _below(model: mujoco.MjModel, body: int, top: int) -> bool:
    while body > top:
        body = int(model.body_parentid[body])
    return body == top
