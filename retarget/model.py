"""MuJoCo models of rigs: `model.xml` with the joint ranges of `rig.toml`."""

from __future__ import annotations

import math
from pathlib import Path

import mujoco

from retarget.menagerie import how_to_get
from retarget.rig import Rig
from retarget.table import RigError


def load_spec(rig: Rig) -> mujoco.MjSpec:
    """Kinematics, geoms and masses of the rig: a free joint on the root, ranges, damping and sites of `rig.toml`; no
    floor, no motors. A rig on a stand may have its base fixed to the world: it gets the free joint here.

    Raises RigError where the model is not there or cannot be read, its joints are not those of `rig.toml` in the same
    order, or a body or site that the rig names is missing.
    """
    spec = read_spec(rig.model)
    bare(spec)
    _free_root(spec, rig)
    _forgive_neighbours(spec, rig)
    hinges = {j.name: j for j in spec.joints if j.type != mujoco.mjtJoint.mjJNT_FREE}
    if tuple(hinges) != rig.joint_names():
        raise RigError(
            f"{rig.model}: joints {', '.join(hinges)} are not those of rig.toml: {', '.join(rig.joint_names())}"
        )
    unit = math.degrees(1) if spec.compiler.degree else 1.0  # a spec keeps the file's unit until it compiles
    for joint in rig.joints:
        hinges[joint.name].range = [joint.lower * unit, joint.upper * unit]
        hinges[joint.name].limited = True
        if rig.damping is not None:
            hinges[joint.name].damping = [rig.damping, 0, 0]  # the linear part; MuJoCo has powers of the speed too
    bodies = {b.name for b in spec.bodies}
    for site in rig.sites:
        _known([site.body], bodies, "site: body", rig)
        if (theirs := spec.site(site.name)) is not None:
            spec.delete(theirs)
        spec.body(site.body).add_site(name=site.name, pos=site.pos)
    for foot in rig.feet:
        _let_stand(spec.body(foot.body))
    sites = {s.name for s in spec.sites}
    _known([f.body for f in rig.follow], bodies | sites, "follow: body or site", rig)
    _known([f.body for f in rig.feet], bodies, "foot: body", rig)
    _known([s for f in rig.feet for s in f.sites], sites, "foot: site", rig)
    return spec


def read_spec(path: Path) -> mujoco.MjSpec:
    """The MJCF or URDF at `path` as it is. Raises RigError in one line where it is not there or does not load."""
    if not path.is_file():
        raise RigError(f"{path}: no such model" if path.is_absolute() else how_to_get(str(path)))
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as problem:
        raise RigError(f"{path}: {' '.join(str(problem).split())}") from None


def bare(spec: mujoco.MjSpec) -> None:
    """Take away the motors, sensors, poses and lights of a vendor's model: a rig and its scenes bring theirs."""
    for part in (*spec.actuators, *spec.sensors, *spec.keys, *spec.lights):
        spec.delete(part)


def without_looks(spec: mujoco.MjSpec) -> None:
    """Take away the meshes that touch nothing and weigh nothing: compiling those of some vendors takes seconds."""
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    for geom in spec.geoms:
        solid = geom.contype or geom.conaffinity or geom.name in paired
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and not solid and geom.parent.explicitinertial:
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    for mesh in spec.meshes:
        if mesh.name not in used:
            spec.delete(mesh)


def _forgive_neighbours(spec: mujoco.MjSpec, rig: Rig) -> None:
    """MuJoCo lets a body overlap its parent, but not a parent that is fixed to the world, as the root is on a stand."""
    have = {frozenset((e.bodyname1, e.bodyname2)) for e in spec.excludes}
    for child in spec.body(rig.root).bodies:
        if child.name and frozenset((rig.root, child.name)) not in have:
            spec.add_exclude(bodyname1=rig.root, bodyname2=child.name)


def _let_stand(foot: mujoco.MjsBody | None) -> None:
    """A foot that may touch nothing, as where a model pairs it with a floor of its own, meets floors by its shapes that
    are no mesh."""
    geoms = [] if foot is None else list(foot.geoms)
    if not any(geom.contype or geom.conaffinity for geom in geoms):
        for geom in geoms:
            geom.conaffinity = int(geom.type != mujoco.mjtGeom.mjGEOM_MESH)


def _free_root(spec: mujoco.MjSpec, rig: Rig) -> None:
    root = spec.body(rig.root)
    kinds = None if root is None else [j.type for j in root.joints]
    if root is not None and kinds == [] and rig.mount == "stand" and root.parent.name == "world":
        root.add_freejoint()
    elif kinds != [mujoco.mjtJoint.mjJNT_FREE]:
        fixed = "" if rig.mount != "stand" else ", or none and be fixed to the world"
        raise RigError(
            f"{rig.model}: body {rig.root!r}, the rig's root, should be there and have just a free joint{fixed}"
        )


def load_model(rig: Rig) -> mujoco.MjModel:
    """The compiled `load_spec(rig)` without its looks: qpos is (7 + nj,), the root's position and quaternion, then the
    rig's joints.

    Raises RigError as `load_spec` does, and where the model does not compile.
    """
    spec = load_spec(rig)
    without_looks(spec)
    try:
        return spec.compile()
    except ValueError as problem:
        raise RigError(f"{rig.model}: {' '.join(str(problem).split())}") from None


def _known(names: list[str], have: set[str], what: str, rig: Rig) -> None:
    for name in names:
        if name not in have:
            raise RigError(f"{rig.model}: {what} {name!r} is not in the model")
