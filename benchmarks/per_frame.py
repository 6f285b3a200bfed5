"""The method that people use, written plainly on mink: every frame for itself, from the one before, in two passes.

As GMR has it: first orientations and the root, then positions too; damping 0.5, at most ten iterations a pass, stopped
when the error gains less than 0.001; joint ranges as the only limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import mink
import mujoco
import numpy as np

from motiongen.rotation import Array
from retarget.goals import ROOT, Goal
from retarget.rest import is_site
from retarget.rig import Rig

DAMPING, ITERATIONS, GAIN = 0.5, 10, 1e-3
STEP = 0.02  # s; cancels out, since mink hands back a velocity


@dataclass(frozen=True)
class Solved:
    """`qpos` (T, nq), and how many times `mink.solve_ik` was called."""

    qpos: Array
    calls: int


def per_frame(rig: Rig, model: mujoco.MjModel, goals: dict[str, Goal], start: Array) -> Solved:
    """`goals` by the per-frame method, from `start` (nq,) with its root put where the root's goal begins."""
    wanted = {name: g for name, g in goals.items() if g.follow.position or g.follow.rotation}
    tasks = {name: _task(g, rig, model) for name, g in wanted.items()}
    first = [tasks[name] for name, g in wanted.items() if name == ROOT or g.follow.rotation]
    configuration = mink.Configuration(model, _placed(start, goals))
    limits = [mink.ConfigurationLimit(model)]
    out, calls = np.empty((len(goals[ROOT].pos), model.nq)), 0
    for frame in range(len(out)):
        for name, g in wanted.items():
            tasks[name].set_target(mink.SE3(np.concatenate([g.quat[frame], g.pos[frame]])))
        for passed in (first, list(tasks.values())):
            error = _error(passed, configuration)
            for _ in range(ITERATIONS):
                velocity = mink.solve_ik(configuration, passed, STEP, "daqp", damping=DAMPING, limits=limits)
                configuration.integrate_inplace(velocity, STEP)
                before, error, calls = error, _error(passed, configuration), calls + 1
                if before - error < GAIN:
                    break
        out[frame] = configuration.q
    return Solved(out, calls)


def _placed(start: Array, goals: dict[str, Goal]) -> Array:
    return np.concatenate([goals[ROOT].pos[0], goals[ROOT].quat[0], start[7:]])


def _error(tasks: list[mink.FrameTask | mink.RelativeFrameTask], configuration: mink.Configuration) -> float:
    return float(np.linalg.norm(np.concatenate([task.compute_error(configuration) for task in tasks])))


def _task(goal: Goal, rig: Rig, model: mujoco.MjModel) -> mink.FrameTask | mink.RelativeFrameTask:
    follow, kind = goal.follow, _kind(model, goal.follow.body)
    place = follow.position / rig.nominal.height
    if not goal.base:
        return mink.FrameTask(follow.body, kind, place, follow.rotation)
    base = next((f.body for f in rig.follow if f.human == goal.base), rig.root)
    return mink.RelativeFrameTask(follow.body, kind, base, _kind(model, base), place, follow.rotation)


def _kind(model: mujoco.MjModel, name: str) -> str:
    return "site" if is_site(model, name) else "body"
