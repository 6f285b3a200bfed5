"""What is mended on every mount, before balance: parts that overlap, and joints that jerk."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retarget.kinematics import ROOT_DOFS, tree_of
from retarget.model import load_model
from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from sim.mending.apart import pushed_apart
from sim.mending.smooth import smoothed
from sim.report import Change
from sim.thresholds import limit_for

SHORTEST = 20  # frames: what is shorter is a pose


@dataclass(frozen=True)
class Mended:
    """A mended `trajectory`, and in `changes` what was done to it, each with its size and in a sentence."""

    trajectory: Trajectory
    changes: tuple[Change, ...]


def tidy(trajectory: Trajectory, rig: Rig, mount: Mount) -> Mended:
    """`trajectory` without parts that overlap and joints that jerk. Where feet stand, legs stay as they are."""
    if len(trajectory) < SHORTEST:
        return Mended(trajectory, ())
    legs = np.zeros(len(rig.joints), bool) if mount == "stand" else leg_joints(rig)
    apart = pushed_apart(rig, trajectory.qpos, trajectory.fps, ~legs)
    angles, cut = smoothed(apart.qpos[:, 7:], trajectory.fps, limit_for("jerk", rig))
    angles[:, legs] = apart.qpos[:, 7:][:, legs]
    moved = float(np.abs(apart.qpos - trajectory.qpos).max())
    changes = []
    if moved:
        found = f"{apart.before * 1000:.0f} mm, now {apart.after * 1000:.0f} mm"
        changes.append(
            Change("apart", moved, "rad", f"Joints move up to {moved:.2f} rad, as parts would overlap by {found}.")
        )
    if np.isfinite(cut[~legs]).any():
        worst = int(np.argmin(np.where(legs, np.inf, cut)))
        said = f"{int(np.isfinite(cut[~legs]).sum())} joints were smoothed, {rig.joints[worst].name} most"
        changes.append(Change("smooth", float(cut[worst]), "Hz", f"{said}, of all above {cut[worst]:.1f} Hz."))
    if not changes:
        return Mended(trajectory, ())
    aim = None if trajectory.aim is None else trajectory.aim + angles - trajectory.joint_pos
    return Mended(replace(trajectory, qpos=np.hstack([trajectory.qpos[:, :7], angles]), aim=aim), tuple(changes))


def leg_joints(rig: Rig) -> NDArray[np.bool_]:
    """(nj,) joints between the root and a foot."""
    tree = tree_of(load_model(rig))
    feet = [tree.model.body(foot.body).id for foot in rig.feet]
    return np.asarray(tree.carries[feet][:, ROOT_DOFS:].any(0)) if feet else np.zeros(len(rig.joints), bool)
