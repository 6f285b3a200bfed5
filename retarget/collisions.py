"""Which geoms of a rig must not meet: those that physics would let collide."""

from __future__ import annotations

from itertools import combinations

import mujoco


def collision_pairs(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Pairs of geom ids whose contact bits match and whose bodies differ, are no parent and child, and not excluded."""
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    excluded |= {(int(model.body_parentid[body]), body) for body in range(1, model.nbody)}
    excluded |= {(b, a) for a, b in excluded}
    solid = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
    return [
        (a, b)
        for a, b in combinations(solid, 2)
        if (model.geom_contype[a] & model.geom_conaffinity[b]) or (model.geom_contype[b] & model.geom_conaffinity[a])
        if model.geom_bodyid[a] != model.geom_bodyid[b]
        if (int(model.geom_bodyid[a]), int(model.geom_bodyid[b])) not in excluded
    ]
