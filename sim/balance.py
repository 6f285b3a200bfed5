"""How a motion balances over its own feet, frame by frame, before any servo moves."""

from __future__ import annotations

from dataclasses import dataclass

from retarget.trajectory import Trajectory
from sim.dynamics import Array, Dynamics, dynamics
from sim.scene import Scene
from sim.support import Support, margin, residual_wrench, support


@dataclass(frozen=True)
class Balance:
    """T frames of a motion on a rig that nothing holds.

    `zmp_margin` and `com_margin` (T,) m: how far the zero-moment point and the centre of mass are inside the support
    polygon, negative outside, NaN in flight. `residual` (T, 6) N and N·m about the centre of mass: the help from
    outside that the motion needs.
    """

    moves: Dynamics
    ground: Support
    zmp_margin: Array
    com_margin: Array
    residual: Array


def balance(scene: Scene, trajectory: Trajectory) -> Balance:
    """The balance of `trajectory` on `scene`. Raises ValueError on a stand, see `dynamics`."""
    moves = dynamics(scene, trajectory.qpos, trajectory.fps)
    ground = support(scene, moves, trajectory.contacts)
    return Balance(
        moves=moves,
        ground=ground,
        zmp_margin=margin(moves.zmp, ground),
        com_margin=margin(moves.com[:, :2], ground),
        residual=residual_wrench(scene, moves, ground),
    )
