"""A puppet that nobody has a model of: what somebody says of its joints, as a model of capsules.

The file of answers, in metres and degrees; x forward, y left, z up, the puppet upright with its limbs hanging down:

    [bus]
    protocol = "feetech"
    baud = 1_000_000

    [[servo]]
    id = 3
    model = "STS3215"
    joint = "left_elbow"
    parent = "left_shoulder"   # the joint that carries it, or "base"
    axis = "-y"                # it turns about this by the right-hand rule as its angle grows
    at = [0, 0, -0.09]         # where it sits, from its parent joint (the middle of the base)
    limits = [0, 120]
    tip = [0, 0, -0.10]        # where its link ends, from itself; only of a joint that carries none
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import mujoco

from retarget.rig import Bus
from retarget.servos import PROTOCOLS, ServoModel, servo_models
from retarget.table import RigError, Table, known, read_toml, unique

BASE = "base"
AXES = {
    sign + name: tuple(float(f"{sign}1") * (k == n) for k in range(3))
    for n, name in enumerate("xyz")
    for sign in ("", "-")
}
# Guesses, and said to be: nobody has weighed or measured the links.
RADIUS = 0.012  # m
SHELL = 0.5  # of a servo's mass: what its bracket and cover weigh
ARMATURE, DAMPING = 0.003, 0.025  # kg·m² and N·m·s/rad for each N·m of stall torque: as the puppet's
START = 0.3  # m: where the base is drawn, above what is later its floor

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Part:
    """A joint with its servo, and the link that it turns; lengths in m, `limits` in rad. `tip`: None where it carries
    other joints, and its link ends there."""

    id: int
    model: ServoModel
    joint: str
    parent: str
    axis: str
    at: Point
    limits: tuple[float, float]
    tip: Point | None = None


@dataclass(frozen=True)
class Puppet:
    """All that somebody said of a puppet; parents come before what they carry."""

    bus: Bus
    parts: tuple[Part, ...]

    def children(self, joint: str) -> tuple[Part, ...]:
        """The parts that `joint`, or the base, carries."""
        return tuple(p for p in self.parts if p.parent == joint)


def read_answers(path: Path) -> Puppet:
    """The puppet of a file of answers. Raises RigError in one line: what is wrong and what would be right."""
    try:
        return read_toml(path).all(_puppet)
    except RigError as problem:
        raise RigError(str(problem) if str(problem).startswith(str(path)) else f"{path}: {problem}") from None


def puppet_of(bus: Bus, parts: tuple[Part, ...]) -> Puppet:
    """The puppet of these parts in any order. Raises RigError where they do not make one body."""
    unique([p.joint for p in parts], "joint")
    unique([p.id for p in parts], "servo id")
    names = (BASE, *(p.joint for p in parts))
    ordered: list[Part] = []
    for part in parts:
        known(part.parent, [n for n in names if n != part.joint], f"{part.joint}: parent")
    while left := [p for p in parts if p not in ordered]:
        ready = [p for p in left if p.parent in (BASE, *(o.joint for o in ordered))]
        if not ready:
            raise RigError(f"{left[0].joint}: its parents lead back to itself, not to the {BASE!r}")
        ordered += ready
    puppet = Puppet(bus, tuple(ordered))
    for part in parts:
        if part.limits[1] - part.limits[0] > reach(part.model):
            raise RigError(f"{part.joint}: limits are wider than the {reach_text(part.model)} of a {part.model.name}")
        if (part.tip is None) != bool(puppet.children(part.joint)):
            raise RigError(f"{part.joint}: a joint that carries no other has a tip, one that does has none")
    return puppet


def reach(model: ServoModel) -> float:
    """From the first to the last position of a servo, rad."""
    first, last = model.ticks
    return (last - first) / model.ticks_per_turn * 2 * math.pi


def reach_text(model: ServoModel) -> str:
    """The same in degrees."""
    return f"{math.degrees(reach(model)):.0f}°"


def answers(puppet: Puppet) -> str:
    """The text of the file that `read_answers` reads."""
    lines = ["[bus]", f'protocol = "{puppet.bus.protocol}"', f"baud = {puppet.bus.baud}"]
    for p in puppet.parts:
        lines += ["", "[[servo]]", f"id = {p.id}", f'model = "{p.model.name}"', f'joint = "{p.joint}"']
        lines += [f'parent = "{p.parent}"', f'axis = "{p.axis}"', f"at = {_listed(p.at)}"]
        lines += [f"limits = {_listed([math.degrees(x) for x in p.limits])}"]
        lines += [] if p.tip is None else [f"tip = {_listed(p.tip)}"]
    return "\n".join(lines) + "\n"


def capsule_spec(puppet: Puppet) -> mujoco.MjSpec:
    """The puppet of capsules, its base floating: a body and a hinge for each part, named as its joint.

    What overlaps at zero angles is never taken to collide. Raises RigError where MuJoCo does not take it.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "puppet"
    spec.compiler.degree = False
    base = spec.worldbody.add_body(name=BASE, pos=[0, 0, START])
    base.add_freejoint()
    weight = sum(p.model.mass for p in puppet.parts)
    _add_links(base, BASE, [p.at for p in puppet.children(BASE)], weight)
    bodies = {BASE: base}
    for part in puppet.parts:
        body = bodies[part.parent].add_body(name=part.joint, pos=part.at)
        torque = part.model.stall_torque
        hinge = body.add_joint(name=part.joint, axis=AXES[part.axis], range=part.limits, limited=True)
        hinge.armature, hinge.damping = ARMATURE * torque, [DAMPING * torque, 0, 0]
        ends = [part.tip] if part.tip is not None else [p.at for p in puppet.children(part.joint)]
        _add_links(body, part.joint, ends, (1 + SHELL) * part.model.mass)
        bodies[part.joint] = body
    for one, other in _overlapping(spec):
        spec.add_exclude(bodyname1=one, bodyname2=other)
    return spec


def guesses(puppet: Puppet) -> tuple[str, ...]:
    """What the model says that nobody told, a line each."""
    return (
        f"links are capsules of {RADIUS * 1e3:.0f} mm radius; each weighs its servo and {SHELL:.0%} more, the base as "
        "much as all servos",
        "rotor inertia and damping of the joints: in proportion to the servos' torque, as the built-in puppet's",
    )


def _add_links(body: mujoco.MjsBody, name: str, ends: list[Point], mass: float) -> None:
    """A capsule from the body's origin to each of `ends`, or a ball where that is no way off."""
    for k, end in enumerate(ends):
        geom = body.add_geom(name=name if k == 0 else f"{name}_{k + 1}", mass=mass / len(ends))
        if math.hypot(*end) < 1e-3:
            geom.type, geom.size = mujoco.mjtGeom.mjGEOM_SPHERE, [RADIUS, 0, 0]
        else:
            geom.type, geom.size = mujoco.mjtGeom.mjGEOM_CAPSULE, [RADIUS, 0, 0]
            geom.fromto = [0.0, 0.0, 0.0, *end]


def _overlapping(spec: mujoco.MjSpec) -> list[tuple[str, str]]:
    """Names of bodies that touch at zero angles."""
    try:
        model = spec.compile()
    except ValueError as problem:
        raise RigError(f"MuJoCo does not take this puppet: {' '.join(str(problem).split())}") from None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pairs = {tuple(sorted(int(model.geom_bodyid[g]) for g in contact.geom)) for contact in data.contact[: data.ncon]}
    return [(model.body(a).name, model.body(b).name) for a, b in sorted(pairs)]


def _puppet(t: Table) -> Puppet:
    bus = t.table("bus", lambda b: Bus("main", b.choice("protocol", PROTOCOLS), b.integer("baud", 1, 10**8)))
    parts = t.tables("servo", partial(_part, bus))
    if not parts:
        raise RigError("it tells of no [[servo]]")
    return puppet_of(bus, parts)


def _part(bus: Bus, t: Table) -> Part:
    model = servo_models()[t.choice("model", tuple(servo_models()))]
    if model.protocol != bus.protocol:
        raise RigError(f"{t.where}: model {model.name} speaks {model.protocol}, the bus {bus.protocol}")
    lower, upper = t.span("limits")
    return Part(
        id=t.integer("id", 0, 252),
        model=model,
        joint=t.text("joint"),
        parent=t.text("parent"),
        axis=t.choice("axis", tuple(AXES)),
        at=t.point("at"),
        limits=(math.radians(lower), math.radians(upper)),
        tip=t.point("tip") if "tip" in t.data else None,
    )


def _listed(values: Point | list[float]) -> str:
    return f"[{', '.join(f'{x:.6g}' for x in values)}]"
