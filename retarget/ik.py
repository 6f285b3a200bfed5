"""Inverse kinematics with mink: joint angles that bring the followers of a rig to their goals, within its limits.

Each frame is a damped Gauss-Newton step or two from the frame before, a quadratic program with the joint ranges and
speeds as hard limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mink import (
    SE3,
    CollisionAvoidanceLimit,
    Configuration,
    ConfigurationLimit,
    DofFreezingTask,
    FrameTask,
    Limit,
    PostureTask,
    RelativeFrameTask,
    VelocityLimit,
    solve_ik,
)

from motiongen.rotation import Array
from retarget.collisions import collision_pairs
from retarget.goals import Goal
from retarget.rest import is_site
from retarget.rig import Rig

STEPS = 2  # per frame; each may use half of a frame's share of the joint speed
START_STEPS = 120  # at most, for the first frame; done when no joint moves by more than SETTLED
SETTLED = 1e-4  # rad a step
POSTURE = 0.03  # weight of the nominal pose, which settles what the goals leave open
GAP, SIGHT = 0.02, 0.1  # of the root height: how far apart bodies stay, and from where on they mind each other
APPROACH = 0.5  # share of the distance to the gap that one step may close
DAMPING = 1e-3  # keeps a stretched limb, whose Jacobian is singular, from whipping


@dataclass(frozen=True)
class _Tracked:
    """A goal's task, its targets (T, 7) as mink has them, quaternion w x y z and position, and its cost (T, 6)."""

    task: FrameTask | RelativeFrameTask
    targets: Array
    cost: Array


def solve(
    rig: Rig, model: mujoco.MjModel, goals: dict[str, Goal], start: Array, fps: float, *, fixed_root: bool
) -> Array:
    """(T, nq) configurations of `model` at `fps` frames a second.

    `start` (nq,) is where the search for the first frame starts, and its joints are what the goals leave open. The root
    stays there where `fixed_root`. Joint angles keep within the ranges of `model` and between frames within `rig`'s
    velocities; a goal out of reach is missed by as little as its weight against the others' allows.

    Raises mink.NoSolutionFound where the solver fails, which within box limits it does not.
    """
    body = Configuration(model, start)
    tracked = [_tracked(g, rig, model) for g in goals.values() if g.follow.position or g.follow.rotation]
    posture = PostureTask(model, cost=POSTURE)
    posture.set_target(start)
    tasks = [*(t.task for t in tracked), posture]
    freeze = [DofFreezingTask(model, dof_indices=list(range(6)))] if fixed_root else None
    dt = 1 / (fps * STEPS)
    limits: list[Limit] = [
        ConfigurationLimit(model, gain=1.0),
        VelocityLimit(model, {j.name: j.velocity for j in rig.joints}),
        _apart(model, rig.nominal.height, dt),
    ]
    out = np.empty((len(tracked[0].targets), model.nq))
    for frame in range(len(out)):
        for goal in tracked:
            goal.task.set_target(SE3(wxyz_xyz=goal.targets[frame]))
            goal.task.cost[:] = goal.cost[frame]
        for _ in range(STEPS if frame else START_STEPS):
            velocity = solve_ik(body, tasks, dt, "daqp", damping=DAMPING, limits=limits, constraints=freeze)
            body.integrate_inplace(velocity, dt)
            if not frame and np.abs(velocity).max() * dt < SETTLED:
                break
        out[frame] = body.q
    return out


def _apart(model: mujoco.MjModel, size: float, dt: float) -> Limit:
    """Whatever physics would let collide stays `GAP` apart.

    mink bounds the approach in one step by gain · distance / dt; a gain that has dt in it makes that a share of the
    distance, so that nothing can pass through in a step.
    """
    return CollisionAvoidanceLimit(
        model,
        [([a], [b]) for a, b in collision_pairs(model)],
        gain=APPROACH * dt,
        minimum_distance_from_collisions=GAP * size,
        collision_detection_distance=SIGHT * size,
    )


def _tracked(goal: Goal, rig: Rig, model: mujoco.MjModel) -> _Tracked:
    """Position errors count in units of the rig's nominal root height, so that weights mean the same on every size."""
    follow = goal.follow
    weights = np.repeat([follow.position / rig.nominal.height, follow.rotation], 3)
    kind = _kind(model, follow.body)
    task: FrameTask | RelativeFrameTask
    if goal.base:
        base = next((f.body for f in rig.follow if f.human == goal.base), rig.root)
        task = RelativeFrameTask(follow.body, kind, base, _kind(model, base), weights[:3], weights[3:])
    else:
        task = FrameTask(follow.body, kind, weights[:3], weights[3:])
    return _Tracked(task, np.concatenate([goal.quat, goal.pos], axis=1), goal.firm[:, None] * weights)


def _kind(model: mujoco.MjModel, name: str) -> str:
    return "site" if is_site(model, name) else "body"
