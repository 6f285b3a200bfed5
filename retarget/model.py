"""MuJoCo models of rigs: `model.xml` with the joint ranges of `rig.toml`."""

from __future__ import annotations

import math

import mujoco

from retarget.rig import Rig
from retarget.table import RigError


def load_spec(rig: Rig) -> mujoco.MjSpec:
    """Kinematics, geoms and masses of the rig: a free joint on the root, ranges of `rig.toml`; no floor, no motors.

    Raises RigError where the model cannot be read, its joints are not those of `rig.toml` in the same order, or a body
    or site that the rig names is missing.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(rig.model))
    except ValueError as problem:
        raise RigError(f"{rig.model}: {' '.join(str(problem).split())}") from None
    root = spec.body(rig.root)
    if root is None or [j.type for j in root.joints] != [mujoco.mjtJoint.mjJNT_FREE]:
        raise RigError(f"{rig.model}: body {rig.root!r}, the rig's root, should be there and have just a free joint")
    hinges = {j.name: j for j in spec.joints if j.type != mujoco.mjtJoint.mjJNT_FREE}
    if tuple(hinges) != rig.joint_names():
        raise RigError(
            f"{rig.model}: joints {', '.join(hinges)} are not those of rig.toml: {', '.join(rig.joint_names())}"
        )
    unit = math.degrees(1) if spec.compiler.degree else 1.0  # a spec keeps the file's unit until it compiles
    for joint in rig.joints:
        hinges[joint.name].range = [joint.lower * unit, joint.upper * unit]
        hinges[joint.name].limited = True
    bodies, sites = {b.name for b in spec.bodies}, {s.name for s in spec.sites}
    _known([f.body for f in rig.follow], bodies | sites, "follow: body or site", rig)
    _known([f.body for f in rig.feet], bodies, "foot: body", rig)
    _known([s for f in rig.feet for s in f.sites], sites, "foot: site", rig)
    return spec


def load_model(rig: Rig) -> mujoco.MjModel:
    """The compiled `load_spec(rig)`: qpos is (7 + nj,), the root's position and quaternion, then the rig's joints.

    Raises RigError as `load_spec` does, and where the model does not compile.
    """
    try:
        return load_spec(rig).compile()
    except ValueError as problem:
        raise RigError(f"{rig.model}: {' '.join(str(problem).split())}") from None


def _known(names: list[str], have: set[str], what: str, rig: Rig) -> None:
    for name in names:
        if name not in have:
            raise RigError(f"{rig.model}: {what} {name!r} is not in the model")
