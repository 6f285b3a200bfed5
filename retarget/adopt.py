"""A model that somebody has, MJCF or URDF, or what they say of a puppet without one, made into the folder of a rig."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco

from motiongen.files import replacing
from retarget.anatomy import read_skeleton
from retarget.capsules import Puppet, answers, capsule_spec, guesses
from retarget.gmr import read_gmr
from retarget.model import read_spec
from retarget.propose import Drive, propose
from retarget.rig import Follow
from retarget.table import RigError


def adopt(model: Path, folder: Path, *, gmr: Path | None = None, limit: float | None = None) -> tuple[str, ...]:
    """Write `folder`/rig.toml for `model` (for a URDF also model.xml) and give back what was guessed, a line each.

    Raises RigError where the model does not load, has no free joint, joints without limits and no `limit` (rad), or
    there is a rig already; OSError where the folder cannot be written.
    """
    target = new_rig_file(folder)
    if limit is not None and limit <= 0:
        raise RigError(f"--limit {limit:g} should be above 0 rad")
    urdf = model.suffix.lower() == ".urdf"
    drives: dict[str, Drive] = {}
    if urdf:
        spec, drives = _from_urdf(model)
    else:
        spec = read_spec(model.resolve())
    try:
        body = spec.compile()
    except ValueError as problem:
        raise RigError(f"{model}: {' '.join(str(problem).split())}") from None
    try:
        skeleton = read_skeleton(body)
        notes: tuple[str, ...] = ()
        follow: tuple[Follow, ...] = ()
        if gmr is not None:
            bodies = {body.body(b).name for b in range(body.nbody)}
            follow, notes = read_gmr(gmr, body.body(skeleton.root).name, bodies)
        where = 'model = "model.xml"' if urdf else f"model = '{model.resolve()}'"
        proposal = propose(body, where, drives=drives, limit=limit, follow=follow, notes=notes)
    except RigError as problem:
        raise RigError(f"{model}: {problem}") from None
    folder.mkdir(parents=True, exist_ok=True)
    if urdf:
        (folder / "model.xml").write_text(spec.to_xml())
    with replacing(target) as unfinished:
        unfinished.write_text(proposal.toml)
    return proposal.guesses


def adopt_puppet(puppet: Puppet, folder: Path) -> tuple[str, ...]:
    """Write `folder`/rig.toml, model.xml and answers.toml for `puppet` and give back what was guessed, a line each.

    Raises RigError where there is a rig already or MuJoCo does not take it; OSError where it cannot be written.
    """
    target = new_rig_file(folder)
    spec = capsule_spec(puppet)
    body = spec.compile()
    drives = {
        p.joint: Drive(p.limits, p.model.stall_torque, p.model.no_load_speed, (p.id, p.model.name))
        for p in puppet.parts
    }
    proposal = propose(body, 'model = "model.xml"', drives=drives, notes=guesses(puppet), bus=puppet.bus)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "model.xml").write_text(spec.to_xml())
    (folder / "answers.toml").write_text(answers(puppet))
    with replacing(target) as unfinished:
        unfinished.write_text(proposal.toml)
    return proposal.guesses


def new_rig_file(folder: Path) -> Path:
    """`folder`/rig.toml; raises RigError where it is there already."""
    target = folder / "rig.toml"
    if target.exists():
        raise RigError(f"{target}: is there already; name another folder with --out")
    return target


def _from_urdf(path: Path) -> tuple[mujoco.MjSpec, dict[str, Drive]]:
    """The URDF with its base floating, and what it says of its joints; MuJoCo would weld the base to the world."""
    if not path.is_file():
        raise RigError(f"{path}: no such model")
    try:
        robot = ET.fromstring(path.read_bytes())
    except ET.ParseError as problem:
        raise RigError(f"{path}: {problem}") from None
    extension = robot.find("mujoco")
    extension = ET.SubElement(robot, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ET.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.attrib |= {"fusestatic": "false", "discardvisual": "false", "balanceinertia": "true"}
    compiler.attrib.setdefault("meshdir", str(path.resolve().parent))
    try:
        spec = mujoco.MjSpec.from_string(ET.tostring(robot, encoding="unicode"))
    except ValueError as problem:
        raise RigError(f"{path}: {' '.join(str(problem).split())}") from None
    base = spec.worldbody.first_body()
    if base is None or base.joints:
        raise RigError(f"{path}: its base should be one link without a joint above it")
    base.add_freejoint()
    return spec, {j.get("name", ""): _drive(j) for j in robot.findall("joint")}


def _drive(joint: ET.Element) -> Drive:
    limit = joint.find("limit")
    if limit is None:
        return Drive()
    torque, speed = (float(limit.get(key, "0")) or None for key in ("effort", "velocity"))
    return Drive(None, torque, speed)
