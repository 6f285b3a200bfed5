"""A first `rig.toml` for a model that nobody has described yet; every guess is said."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from motiongen.rotation import Array
from retarget.anatomy import (
    ELBOW,
    KNEE,
    Chain,
    Skeleton,
    bend,
    far_end,
    geom_corners,
    read_skeleton,
    solid_geoms,
)
from retarget.goals import LIMBS
from retarget.rig import Bus, Follow
from retarget.table import RigError

SPEED_GUESS = 10.0  # rad/s, of the order of what geared motors do
TORQUE_GUESS = 1.5  # N·m per kg of the robot and metre of its height: about what knees of walking robots have
CROUCH = 0.3  # rad that the knees bend in the nominal pose, so that they know which way to go
WEIGHTS = {"wrist": (1.0, 0.0), "elbow": (1.0, 0.0), "knee": (0.5, 0.0), "ankle": (10.0, 5.0)}


@dataclass(frozen=True)
class Drive:
    """Limits (rad), torque (N·m) and no-load speed (rad/s) of a joint; what is None the model does not say.

    `servo`: id and model of the servo that turns it, where that is known.
    """

    limits: tuple[float, float] | None = None
    torque: float | None = None
    speed: float | None = None
    servo: tuple[int, str] | None = None


@dataclass(frozen=True)
class Proposal:
    """`toml`, the text of a rig file, and `guesses`, one line for each thing in it that wants checking."""

    toml: str
    guesses: tuple[str, ...]


def propose(
    model: mujoco.MjModel,
    where: str,
    *,
    drives: Mapping[str, Drive] | None = None,
    limit: float | None = None,
    follow: tuple[Follow, ...] = (),
    notes: tuple[str, ...] = (),
    bus: Bus | None = None,
) -> Proposal:
    """A rig file for `model`, with `where` (a line of TOML) saying where it lies.

    `drives` by joint name go before what the model says; with a `bus` each of them names its servo, and the rig is on a
    stand, for nobody has balanced it yet; `limit` (rad, to both sides) is for joints without limits;
    `follow` goes before what names and geometry say, and `notes` are guesses that went into it.

    Raises RigError for a model without a free joint, with joints that are no hinges, or without limits and no `limit`.
    """
    skeleton = read_skeleton(model)
    guesses = list(notes)
    joints = _joints(skeleton, dict(drives or {}), limit, guesses)
    sites, found = _limbs(skeleton, [] if follow else guesses)
    follows = _completed(follow, found, guesses) if follow else found
    sites = [site for site in sites if site[0] in {f.body for f in follows}]
    ends = {f.human: f.body for f in follows}
    feet = [(human, ends[human]) for human in ("left_ankle", "right_ankle") if human in ends]
    for human, body in feet:
        heel, toe = _sole(skeleton, model.body(body).id)
        side = human.partition("_")[0]
        sites += [(f"{side}_heel", body, heel), (f"{side}_toe", body, toe)]
    mount = "hung" if feet and bus is None else "stand"
    if mount == "stand":
        guesses.append(f"{'nobody has balanced it' if feet else 'it has no feet'}, so it is on a stand, its root fixed")
    pose = _nominal(skeleton, joints)
    height = _height(skeleton, pose, [s for s in sites if s[0].endswith(("heel", "toe"))])
    out = ["# Proposed from the model. Check it, then take this line out.", where]
    out += [f'root = "{model.body(skeleton.root).name}"', f'mount = "{mount}"', ""]
    for name in ("nominal", "safe"):
        out += [f"[{name}]", f"height = {height:.4f}  # m", f"[{name}.joints]  # rad"]
        out += [f"{joint} = {angle:.3f}" for joint, angle in pose.items() if abs(angle) > 5e-4] + [""]
    out += ["[sensors]", "encoders = true", f"imu = {'true' if bus is None else 'false'}", "delay = 0.0", ""]
    if bus is not None:
        out += ["[[bus]]", f'name = "{bus.name}"', f'protocol = "{bus.protocol}"', f"baud = {bus.baud}", ""]
    for joint, drive in joints.items():
        lower, upper = drive.limits or (0.0, 0.0)
        limits = f"limits = [{lower:.4f}, {upper:.4f}]"
        if bus is not None and drive.servo is not None:
            ident, made = drive.servo
            out += ["[[servo]]", f'joint = "{joint}"', f'bus = "{bus.name}"', f"id = {ident}", f'model = "{made}"']
            out += [limits, ""]
        else:
            out += ["[[joint]]", f'name = "{joint}"', limits]
            out += [f"torque = {drive.torque:.4g}", f"no_load_speed = {drive.speed:.4g}", ""]
    for name, body, pos in sites:
        local = skeleton.data.xmat[model.body(body).id].reshape(3, 3).T @ (pos - skeleton.data.body(body).xpos)
        out += ["[[site]]", f'name = "{name}"', f'body = "{body}"']
        out += [f"pos = [{', '.join(f'{x:.4f}' for x in local + 0.0)}]", ""]
    for each in follows:
        out += ["[[follow]]", f'body = "{each.body}"', f'human = "{each.human}"']
        weights = {"position": each.position, "rotation": each.rotation}
        out += [f"{key} = {value:g}" for key, value in weights.items() if value]
        out += [""]
    for human, body in feet:
        side = human.partition("_")[0]
        out += ["[[foot]]", f'name = "{side}_foot"', f'body = "{body}"']
        out += [f'sites = ["{side}_heel", "{side}_toe"]', f'human = "{human}"', ""]
    return Proposal("\n".join(out).rstrip() + "\n", tuple(guesses))


def _joints(s: Skeleton, drives: dict[str, Drive], limit: float | None, guesses: list[str]) -> dict[str, Drive]:
    model, out = s.model, {}
    without = []
    torque_guess = TORQUE_GUESS * float(model.body_subtreemass[s.root]) * s.size
    for j in range(1, model.njnt):
        name, given = model.joint(j).name, drives.get(model.joint(j).name, Drive())
        limits = given.limits or (tuple(model.jnt_range[j].tolist()) if model.jnt_limited[j] else None)
        if limits is None:
            without.append(name)
            limits = (-(limit or 0.0), limit or 0.0)
        torque = given.torque or _torque(model, j)
        speed = given.speed or SPEED_GUESS
        out[name] = Drive((limits[0], limits[1]), torque or torque_guess, speed, given.servo)
        if torque is None:
            guesses.append(f"torque of {name}: the model does not say; {torque_guess:.3g} N·m from mass and height")
    if without and limit is None:
        raise RigError(f"joints without limits: {', '.join(without)}; give them a range in the model, or --limit RAD")
    if without:
        guesses.append(f"limits of {', '.join(without)}: the model has none; ±{limit:g} rad")
    unknown = [name for name in out if not drives.get(name, Drive()).speed]
    if unknown:
        guesses.append(f"no_load_speed of {len(unknown)} joints: an MJCF does not say; {SPEED_GUESS:g} rad/s")
    return out


def _torque(model: mujoco.MjModel, joint: int) -> float | None:
    """N·m that the model allows the joint's motor, by the range of the joint's force or the motor's; else None."""
    if model.jnt_actfrclimited[joint]:
        return float(np.abs(model.jnt_actfrcrange[joint]).max())
    for a in range(model.nu):
        if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT and model.actuator_trnid[a, 0] == joint:
            gear = abs(float(model.actuator_gear[a, 0]))
            if model.actuator_forcelimited[a]:
                return gear * float(np.abs(model.actuator_forcerange[a]).max())
            plain = model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE
            if plain and model.actuator_ctrllimited[a]:
                gain = abs(float(model.actuator_gainprm[a, 0]))
                return gear * gain * float(np.abs(model.actuator_ctrlrange[a]).max())
    return None


Sites = list[tuple[str, str, Array]]


def _completed(given: tuple[Follow, ...], found: list[Follow], guesses: list[str]) -> list[Follow]:
    """`given` with what only the tree can say: where limbs begin, and ankles that `given` has on no body of the model.

    Files for another solver put the beginning of a limb on a body that turns with it, such as the upper arm's.
    """
    has = {f.human for f in given}
    begin = {limb[0] for limb in LIMBS} & has
    taken = [f for f in found if f.human in begin or (f.human.endswith("ankle") and f.human not in has)]
    guesses += [f"{f.human} by geometry: {f.body}" for f in taken]
    return [f for f in given if f.human not in {t.human for t in taken}] + taken


def _limbs(s: Skeleton, guesses: list[str]) -> tuple[Sites, list[Follow]]:
    """Sites at the hips, knees and hands, in world coordinates, and what follows what."""
    model = s.model
    sites: Sites = []
    follows = [Follow(model.body(s.root).name, "pelvis", 1.0, 1.0)]
    arms = [c for side in ("left", "right") if (c := s.limb("arm", side))]
    head = s.limb("head", "")
    chests = {int(model.body_parentid[c.bodies[0]]) for c in arms}
    if len(chests) == 1 and (chest := chests.pop()) != s.root:
        follows.append(Follow(model.body(chest).name, "spine3", 0.0, 1.0))
    if head:
        follows.append(Follow(model.body(head.bodies[-1]).name, "head", 0.0, 0.5))
        _say(guesses, model, "head", head, {"head": head.bodies[-1]})
    for arm in arms:
        follows += _arm(s, arm, sites, guesses)
    for side in ("left", "right"):
        if leg := s.limb("leg", side):
            follows += _leg(s, leg, sites, guesses)
    used = {id(c) for c in (head, *arms, s.limb("leg", "left"), s.limb("leg", "right"))}
    for chain in s.chains:
        if id(chain) not in used:
            guesses.append(f"{model.body(chain.bodies[-1]).name} follows nothing: no human part for it was found")
    return sites, follows


def _leg(s: Skeleton, leg: Chain, sites: Sites, guesses: list[str]) -> list[Follow]:
    """Hip and knee are put on the vertical through the ankle, so that a straight human leg makes a straight one."""
    model, data, side = s.model, s.data, leg.side
    knee, foot = bend(model, leg, KNEE, 3), leg.bodies[-1]
    ankle = data.xpos[foot]
    above = leg.bodies[: leg.bodies.index(knee)] or leg.bodies[:1]
    pitch = max(above, key=lambda b: abs(_axis(s, b)[1]))
    _say(guesses, model, f"{side} leg", leg, {"hip": pitch, "knee": knee, "ankle": foot})
    root = model.body(s.root).name
    sites.append((f"{side}_hip", root, np.array([ankle[0], ankle[1], data.xpos[pitch][2]])))
    sites.append((f"{side}_knee", model.body(knee).name, np.array([ankle[0], ankle[1], data.xpos[knee][2]])))
    return [
        Follow(f"{side}_hip", f"{side}_hip", 0.0, 0.0),
        Follow(f"{side}_knee", f"{side}_knee", *WEIGHTS["knee"]),
        Follow(model.body(foot).name, f"{side}_ankle", *WEIGHTS["ankle"]),
    ]


def _arm(s: Skeleton, arm: Chain, sites: Sites, guesses: list[str]) -> list[Follow]:
    """The shoulder is where its second axis is, where the first two meet; the hand is the far end of the last body."""
    model, side = s.model, arm.side
    elbow = bend(model, arm, ELBOW, 3 if len(arm.bodies) > 3 else 2)
    before = arm.bodies[: arm.bodies.index(elbow)] or arm.bodies[:1]
    shoulder = before[min(1, len(before) - 1)]
    _say(guesses, model, f"{side} arm", arm, {"shoulder": shoulder, "elbow": elbow, "hand": arm.bodies[-1]})
    sites.append((f"{side}_hand", model.body(arm.bodies[-1]).name, far_end(s, arm.bodies[-1])))
    return [
        Follow(model.body(shoulder).name, f"{side}_shoulder", 0.0, 0.0),
        Follow(model.body(elbow).name, f"{side}_elbow", *WEIGHTS["elbow"]),
        Follow(f"{side}_hand", f"{side}_wrist", *WEIGHTS["wrist"]),
    ]


def _say(guesses: list[str], model: mujoco.MjModel, part: str, chain: Chain, bodies: dict[str, int]) -> None:
    how = "names" if chain.named else "geometry"
    guesses.append(f"{part} by {how}: " + ", ".join(f"{k} {model.body(b).name}" for k, b in bodies.items()))


def _axis(s: Skeleton, body: int) -> Array:
    return s.data.xaxis[s.model.body_jntadr[body]]


def _sole(s: Skeleton, foot: int) -> tuple[Array, Array]:
    """Heel and toe (3,), world: the ends of the lowest edge of the foot's solid geoms."""
    corners = np.array([c for g in solid_geoms(s.model, foot) for c in geom_corners(s.model, s.data, g)])
    if not len(corners):
        raise RigError(f"foot {s.model.body(foot).name!r} has no geom, so nobody can say where its sole is")
    low, high = corners.min(0), corners.max(0)
    middle = (low[1] + high[1]) / 2
    return np.array([low[0], middle, low[2]]), np.array([high[0], middle, low[2]])


def _nominal(s: Skeleton, joints: Mapping[str, Drive]) -> dict[str, float]:
    """Zero, brought within the limits, with the knees a little bent and the soles level."""
    pose = {name: float(np.clip(0.0, *(d.limits or (0, 0)))) for name, d in joints.items()}
    for side in ("left", "right"):
        leg = s.limb("leg", side)
        if leg is None or len(leg.bodies) < 3:
            continue
        knee = bend(s.model, leg, KNEE, 3)
        at = leg.bodies.index(knee)
        parts = (max(leg.bodies[: at or 1], key=lambda b: abs(_axis(s, b)[1])), knee)
        below = leg.bodies[at + 1 :] or (knee,)
        for body, turn in zip((*parts, max(below, key=lambda b: abs(_axis(s, b)[1]))), (-0.5, 1, -0.5), strict=True):
            name = s.model.joint(int(s.model.body_jntadr[body])).name
            angle = math.copysign(CROUCH * turn, turn * _axis(s, body)[1])
            lower, upper = joints[name].limits or (0, 0)
            pose[name] = float(np.clip(angle, lower, upper))
    return pose


def _height(s: Skeleton, pose: Mapping[str, float], soles: Sites) -> float:
    """Metres of the root over its lowest sole in `pose`, or over its lowest point where it has none."""
    data = mujoco.MjData(s.model)
    data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *pose.values()]
    mujoco.mj_kinematics(s.model, data)
    lows = []
    for _, body, pos in soles:
        b = s.model.body(body).id
        local = s.data.xmat[b].reshape(3, 3).T @ (pos - s.data.xpos[b])
        lows.append(float((data.xpos[b] + data.xmat[b].reshape(3, 3) @ local)[2]))
    return max(-min(lows) if lows else s.height, 0.05 * s.size)
