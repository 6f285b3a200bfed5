"""What mending has to know of a rig: its soles, its legs, and where both are in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate, yaw_of_quat, yaw_quat
from retarget.kinematics import ROOT_DOFS, Poses, Tree, on_body, poses, tree_of
from retarget.rig import Foot, Rig
from sim.scene import Scene, build_scene
from sim.support import find_soles

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Leg:
    """A foot and what moves it: `body` and `hip` are ids, `dofs` (n,) the joints between root and foot as columns of
    the velocity. `sole` (K, 3): its corners in metres in the frame of `body`; `flat` (4,) is how `body` is turned when
    the sole is level and faces +x, and `rise` (m) how high its origin then is. `length` (m): hip to foot, straight.
    """

    name: str
    body: int
    hip: int
    dofs: NDArray[np.intp]
    sole: Array
    flat: Array
    rise: float
    length: float


@dataclass(frozen=True)
class Body:
    """A rig on the floor, nothing holding it. `beat` (s) is √(height / g), by which it falls and so by which it steps;
    `height` (m) that of its root in the nominal pose.
    """

    rig: Rig
    scene: Scene
    tree: Tree
    legs: tuple[Leg, ...]
    height: float
    beat: float


def body_of(rig: Rig) -> Body:
    """Raises ValueError where a foot of the rig has no sole."""
    nominal = np.array([0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)], float)
    straight = np.concatenate([nominal[:7], np.zeros(len(rig.joints))])
    scene = build_scene(rig, "free", nominal)
    tree = tree_of(scene.model)
    at = poses(tree, np.stack([nominal, straight]))
    soles = find_soles(scene)
    legs = tuple(_leg(tree, at, foot, scene.model.body(foot.body).id, soles[foot.name]) for foot in rig.feet)
    return Body(rig, scene, tree, legs, rig.nominal.height, float(np.sqrt(rig.nominal.height / GRAVITY)))


def _leg(tree: Tree, at: Poses, foot: Foot, body: int, sole: Array) -> Leg:
    dofs = np.flatnonzero(tree.carries[body])
    dofs = dofs[dofs >= ROOT_DOFS]
    hip = int(tree.model.dof_bodyid[dofs[0]])
    turn = at.turn[0, body]  # in the nominal pose soles are on the floor
    flat = quat_mul(quat_conj(yaw_quat(yaw_of_quat(turn))), turn)
    length = float(np.linalg.norm(at.place[1, body] - at.place[1, hip]))
    return Leg(foot.name, body, hip, dofs, sole, flat, -float(quat_rotate(flat, sole)[:, 2].min()), length)


def sole_turn(leg: Leg, at: Poses) -> Array:
    """(T, 4) how the sole is turned; no turn is level and facing +x."""
    return quat_mul(at.turn[:, leg.body], quat_conj(leg.flat))


def sole_height(leg: Leg, at: Poses) -> Array:
    """(T,) metres of the lowest point of the sole above the floor."""
    return on_body(at, np.full(len(leg.sole), leg.body), leg.sole)[..., 2].min(1)
