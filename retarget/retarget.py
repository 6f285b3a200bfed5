"""Human motion in, joint trajectory of a rig out."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from motiongen.motion import Motion
from motiongen.rotation import Array, quat_continuous, quat_normalize, yaw_of_quat, yaw_quat
from retarget.contacts import Flags, pelvis_height, planted, supported
from retarget.feet import flattened, pinned, riding_height
from retarget.goals import ROOT, Goal, goals, leg_scale, root_goal
from retarget.kinematics import Tree, on_body, poses, tree_of
from retarget.model import load_model
from retarget.rest import Rest, rest_of
from retarget.rig import MOUNTS, Mount, Rig
from retarget.table import RigError
from retarget.timeline import Timeline, ease, normalised, plan, shifted, smoothed, stretch
from retarget.trajectory import Trajectory
from retarget.whole import solve


def retarget(motion: Motion, rig: Rig, *, mount: Mount | None = None, fps: float = 50.0) -> Trajectory:
    """`rig` doing what `motion` shows, at `fps` frames a second, from its nominal pose and back to it.

    It starts over the origin and faces +x. `mount` (the rig's own where None): on a `stand` the root stands still, the
    soles `rig.stand_clearance` above the floor, and legs move in the air; else the root goes along the human path,
    scaled by the length of the legs, planted feet stay where they are and the lowest sole is never below the floor.
    Joint limits and velocities hold in every frame; what is out of their reach is missed, not an error.

    Raises RigError where the rig's files are wrong or it has no feet to stand on, ValueError for an unknown mount or an
    fps not above 0.
    """
    mount = checked_mount(rig, mount)
    motion = _without_corners(motion.resampled(fps))
    model = load_model(rig)
    rest = rest_of(rig, model)
    nominal = nominal_qpos(rig, mount)
    if mount == "stand":
        stance = {foot.human: np.zeros(len(motion), bool) for foot in rig.feet}
        body = _on_stand(motion, rig, model, rest, nominal)
    else:
        stance = planted(motion)
        carried = floor_goals(motion, rig, rest, stance)
        body = solve(rig, model, carried, nominal, fps, fixed_root=False, planted=stance)
        body[:, :2] -= body[0, :2]

    velocity = np.array([joint.velocity for joint in rig.joints])
    timeline = plan(body[0, 7:], body[-1, 7:], nominal[7:], velocity, len(body), fps)
    qpos = _eased(body, nominal, timeline)
    contacts = {foot.name: _shown(stance[foot.human], timeline) for foot in rig.feet}
    if mount != "stand":
        qpos[:, 2] += _lift(qpos, _shown(supported(motion), timeline), timeline, rig, model)
    _verify(qpos, rig, fps)
    labels = shifted(motion.labels, timeline, fps)
    return Trajectory(qpos, fps, rig.name, rig.joint_names(), contacts, labels, motion.source)


def checked_mount(rig: Rig, mount: Mount | None) -> Mount:
    """`mount`, or the rig's own where that is None.

    Raises ValueError where it is unknown, RigError where the rig has no feet to stand on and is not on a stand.
    """
    mount = rig.mount if mount is None else mount
    if mount not in MOUNTS:
        raise ValueError(f"unknown mount {mount!r}; known are {', '.join(MOUNTS)}")
    follows = {follow.human for follow in rig.follow}
    if mount != "stand" and not (rig.feet and follows >= {foot.human for foot in rig.feet}):
        raise RigError(f"rig {rig.name!r}: without feet that follow an ankle it can only be mounted on a stand")
    return mount


def nominal_qpos(rig: Rig, mount: Mount) -> Array:
    """(7 + nj,) the nominal pose over the origin, facing +x; on a stand, at its height."""
    height = rig.nominal.height + (rig.stand_clearance if mount == "stand" else 0.0)
    return np.array([0, 0, height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)], float)


def _without_corners(motion: Motion) -> Motion:
    """The motion smoothed: resampling leaves a corner at every frame of the original."""
    count, joints, _ = motion.joint_quat.shape
    quat = smoothed(quat_continuous(motion.joint_quat).reshape(count, -1)).reshape(count, joints, 4)
    return replace(motion, root_pos=smoothed(motion.root_pos), joint_quat=quat_normalize(quat))


def _on_stand(motion: Motion, rig: Rig, model: mujoco.MjModel, rest: Rest, nominal: Array) -> Array:
    """(T, 7 + nj) with the root where `nominal` (7 + nj,) has it."""
    root_pos, root_quat = (np.tile(part, (len(motion), 1)) for part in (nominal[:3], nominal[3:7]))
    carried = goals(motion, rig, rest, root_pos, root_quat)
    return solve(rig, model, carried, nominal, motion.fps, fixed_root=True, planted={})


def floor_goals(motion: Motion, rig: Rig, rest: Rest, stance: dict[str, Flags]) -> dict[str, Goal]:
    """Goals for a rig that goes about: the root along the human path, planted feet (`stance`) where they stand."""
    root_pos, root_quat = root_goal(motion, rest, motion)
    carried = flattened(goals(motion, rig, rest, root_pos, root_quat), rest, stance)
    height = leg_scale(motion, rest) * pelvis_height(motion)
    rise = riding_height(carried, rest, height, supported(motion))
    for name, goal in carried.items():
        if not goal.base:
            carried[name] = replace(goal, pos=goal.pos + rise[:, None] * [0.0, 0.0, 1.0])
    carried = pinned(carried, rest, stance, motion.fps, rig.nominal.height)
    root_pos = root_pos + rise[:, None] * [0.0, 0.0, 1.0]
    for follow in rig.follow:
        if follow.human == ROOT:
            carried[ROOT] = Goal(follow, "", root_pos, root_quat, np.ones(len(motion)))
    return carried


def _eased(body: Array, nominal: Array, timeline: Timeline) -> Array:
    """The solved motion (T, 7 + nj) from rest to rest, led in from the nominal pose and out to it."""
    shown = normalised(stretch(normalised(body), timeline))
    lead = ease(_below(nominal, shown[0]), shown[0], timeline.lead)
    tail = ease(_below(nominal, shown[-1]), shown[-1], timeline.tail)
    return normalised(np.concatenate([lead, shown, tail[::-1]]))


def _below(nominal: Array, frame: Array) -> Array:
    """The nominal pose standing where `frame` is, facing as it does."""
    out = nominal.copy()
    out[:2] = frame[:2]
    out[3:7] = yaw_quat(yaw_of_quat(frame[3:7]))
    return out


def _shown(flags: Flags, timeline: Timeline) -> Flags:
    """Flags of the solved motion at the frames of the trajectory: where both frames shown have it; not in easing."""
    out = np.zeros(timeline.lead + len(timeline.at) + timeline.tail, bool)
    both = flags[np.floor(timeline.at).astype(int)] & flags[np.ceil(timeline.at).astype(int)]
    out[timeline.lead : timeline.lead + len(timeline.at)] = both
    return out


def _lift(qpos: Array, down: Flags, timeline: Timeline, rig: Rig, model: mujoco.MjModel) -> Array:
    """(T,) metres by which the root must rise: the lowest sole touches where somebody stands (`down`) or the rig eases,
    and neither it nor any body is ever below the floor.
    """
    low = lowest(qpos, rig, tree_of(model))
    down = down.copy()
    down[: timeline.lead] = down[len(qpos) - timeline.tail :] = True
    return np.where(down, -low, np.maximum(-low, 0.0))


def lowest(qpos: Array, rig: Rig, tree: Tree) -> Array:
    """(T,) metres of the lowest sole point, or body origin where one is lower, over the floor."""
    at = poses(tree, qpos)
    sites = [tree.model.site(site) for foot in rig.feet for site in foot.sites]
    soles = on_body(at, np.array([s.bodyid[0] for s in sites]), np.array([s.pos for s in sites]))
    return np.minimum(soles[..., 2].min(1), at.place[:, 1:, 2].min(1))


def _verify(qpos: Array, rig: Rig, fps: float) -> None:
    """Raises RuntimeError naming the joint where a limit or a velocity is exceeded by more than rounding."""
    angles = qpos[:, 7:]
    for i, joint in enumerate(rig.joints):
        speed = float(np.abs(np.diff(angles[:, i])).max(initial=0.0)) * fps
        if angles[:, i].min() < joint.lower - 1e-6 or angles[:, i].max() > joint.upper + 1e-6:
            raise RuntimeError(f"rig {rig.name!r}: {joint.name} left its limits {joint.lower} to {joint.upper} rad")
        if speed > joint.velocity + 1e-5:
            raise RuntimeError(f"rig {rig.name!r}: {joint.name} moves at {speed:.4g} rad/s, over {joint.velocity:.4g}")
