"""Inverse kinematics of the frames of a window at once: what it weighs.

What is minimised is the squared error of every follower, the second differences of the configuration (so that the
motion is as smooth as tracking allows: a low-pass without lag), and a little distance from the nominal pose. Planted
feet, soles above the floor, bodies that keep apart and what joints may do are springs far stiffer than what pulls at
them.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from motiongen.rotation import Array
from retarget import loops
from retarget.contacts import Flags
from retarget.kinematics import ROOT_DOFS, Indices, Meetings, Poses, Tree, meetings, on_body, poses, tree_of
from retarget.loops import differences
from retarget.paces import Paces, paces_of
from retarget.rig import Rig
from retarget.springs import SLIGHT, Springs
from retarget.tracking import Places, Turns, angles, pulls, reached

LEAST_SMOOTH = 0.5  # frames, where they are far apart
POSTURE = 0.03  # weight of the nominal pose, which settles what the goals leave open
GAP = 0.01  # of the root height: how far apart bodies stay that are not nearer in the nominal pose
NOTICE = 1.2  # times as far apart they are noticed
SLACK = 1e-4  # of the root height: how far a sole may be below the floor
STIFF = 1e3  # of the springs that hold soles above the floor and bodies apart, in units of the nominal root height
AIM = 0.97  # of a joint's speed and acceleration: what goes slightly beyond still keeps to them
FIRM = 100.0  # times its weight, a planted foot's goal
SHORT = 0.2  # rad (or root heights): on a shorter way bodies go on to meet where they did, and a step may be the last …
TOUCHING = 0.02  # … or on one as short as this, in frames in which they are too near


@dataclass(frozen=True)
class Problem:
    """What a rig brings to every window. `wary` is the model with bodies that notice each other. `nominal` (nj,) rad;
    `even` (nv,) brings second differences of metres and radians to one scale; of the joints, `reach` (2, nj) rad,
    `speed` (nj,) rad/s and `surge` (nj,) rad/s². `soles`: body (s,) and point (s, 3), kept above the floor. `gaps`
    (nbody, nbody) are the metres that two bodies stay apart. `size` is the nominal root height in metres.
    """

    tree: Tree
    wary: mujoco.MjModel
    nominal: Array
    even: Array
    reach: Array
    speed: Array
    surge: Array
    soles: tuple[Indices, Array]
    gaps: Array
    size: float
    fixed_root: bool


@dataclass(frozen=True)
class Window:
    """`places` and `turns` over T frames `step` s apart, of which the first `known` are solved and stay. What a
    follower of weight 1 does faster than 1 / (2π · `smooth`) Hz is smoothed away (`smooth` in s). Bodies are looked at
    in one of `look` frames, and taken to meet alike in those after it; in none where it is 0.
    """

    places: Places
    turns: Turns
    known: int
    step: float
    smooth: float
    look: int


@dataclass(frozen=True)
class State:
    """Configurations `qpos` (T, nq) and what is amiss there; `cost` sums it up by weight.

    `points` and `off` are what `reached` gives and `turned` what `angles` gives, `bend` (T − 2, nv) the second
    differences, `paces` those of joints. `soles` (T, s, 3) are where they are, `over` (T, s) metres over the
    lowest they may be, `room` (n,) what bodies that meet (`met`) have beyond their gap; `since` (T,) is how far each
    frame has gone since it was looked at for them.
    """

    qpos: Array
    at: Poses
    met: Meetings
    points: Array
    off: Array
    turned: Array
    bend: Array
    paces: Paces
    soles: Array
    over: Array
    room: Array
    cost: float
    since: Array

    def short(self, touching: Flags) -> Array:
        """(T,) how far a frame may go on which bodies still meet where they do: SHORT, or TOUCHING where they are
        `touching` (n,).
        """
        out = np.full(len(self.qpos), SHORT)
        out[self.met.frame[touching]] = TOUCHING
        return out


def problem_of(rig: Rig, model: mujoco.MjModel, start: Array, *, fixed_root: bool, grounded: bool) -> Problem:
    """What `rig` brings; `start` (nq,) has its nominal joints. Soles stay above the floor where it is `grounded`."""
    sites = [model.site(site) for foot in rig.feet for site in foot.sites] if grounded else []
    even = np.ones(model.nv)
    even[:3] = 1 / rig.nominal.height**2
    gap = GAP * rig.nominal.height
    wary = _wary(model, gap)
    return Problem(
        tree=tree_of(model),
        wary=wary,
        nominal=start[7:],
        even=even,
        reach=np.array([[j.lower for j in rig.joints], [j.upper for j in rig.joints]]),
        speed=np.array([j.velocity for j in rig.joints]),
        surge=np.array([j.acceleration for j in rig.joints]),
        soles=(np.array([s.bodyid[0] for s in sites], int), np.array([s.pos for s in sites]).reshape(-1, 3)),
        gaps=_gaps(wary, start, gap),
        size=rig.nominal.height,
        fixed_root=fixed_root,
    )


@lru_cache(maxsize=8)
def _wary(model: mujoco.MjModel, gap: float) -> mujoco.MjModel:
    """A copy of `model` (which takes as long as to solve a second) whose geoms notice each other from NOTICE times
    the `gap` on; MuJoCo adds the margins of both. Of what touches over an area one point is enough.
    """
    model = copy(model)
    model.geom_margin[:] = NOTICE / 2 * gap
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD
    return model


def _gaps(wary: mujoco.MjModel, start: Array, usual: float) -> Array:
    """(nbody, nbody) metres that two bodies are to stay apart: `usual`, or what they are in the configuration `start`
    (nq,) where that is less."""
    out = np.full((wary.nbody, wary.nbody), usual)
    met = meetings(wary, start[None])
    for bodies in (met.bodies, met.bodies[:, ::-1]):
        np.minimum.at(out, tuple(bodies.T), met.apart)
    return out


def smoothness(problem: Problem, window: Window) -> Array:
    """(nv,) weights of squared second differences."""
    return problem.even * max(window.smooth / window.step, LEAST_SMOOTH) ** 4


def state_of(
    problem: Problem, window: Window, qpos: Array, last: State | None = None, longest: Array | None = None
) -> State:
    """The state at `qpos` (T, nq): the first, or `longest` (T,) from the `last` one."""
    at = poses(problem.tree, qpos)
    met, since = _met(problem, window, qpos, at, last, longest)
    points, off = reached(window.places, at)
    turned = angles(window.turns, at)
    bend = np.diff(differences(qpos), axis=0)
    low, high = problem.reach
    speed, surge = AIM * problem.speed * window.step, AIM * problem.surge * window.step**2
    paces = paces_of(qpos[:, 7:] - (low + high) / 2, np.array([(high - low) / 2, speed, surge]))
    soles = on_body(at, *problem.soles)
    over = soles[..., 2] + SLACK * problem.size
    room = met.apart - problem.gaps[*met.bodies.T]
    cost = (
        (window.places.weight * (off**2).sum(-1)).sum()
        + (window.turns.weight * (turned**2).sum(-1)).sum()
        + (smoothness(problem, window) * bend**2).sum()
        + POSTURE**2 * ((qpos[:, 7:] - problem.nominal) ** 2).sum()
        + paces.strain(paces.hasty())
        + STIFF / problem.size**2 * ((np.minimum(over, 0.0) ** 2).sum() + (np.minimum(room, 0.0) ** 2).sum())
    )
    return State(qpos, at, met, points, off, turned, bend, paces, soles, over, room, float(cost), since)


def _met(
    problem: Problem, window: Window, qpos: Array, at: Poses, last: State | None, longest: Array | None
) -> tuple[Meetings, Array]:
    """Where bodies meet at `qpos` (T, nq), and how far each frame has gone since it was looked at (T,): it is not
    looked at again before that is as long as the `last` state says.
    """
    if window.look == 0:
        return meetings(problem.wary, qpos[:0]), np.zeros(len(qpos))
    if last is None or longest is None:
        met = found = meetings(problem.wary, qpos, np.arange(window.known, len(qpos), window.look))
        for later in range(1, window.look):
            met = met.and_those(found.of(found.frame + later < len(qpos)).carried(at, at, later))
        return met, np.zeros(len(qpos))
    since = last.since + longest
    far = since >= last.short(last.room < np.inf)
    met = last.met.of(~far[last.met.frame]).carried(last.at, at)
    if far.any():
        met = met.and_those(meetings(problem.wary, qpos, np.flatnonzero(far)))
    return met, np.where(far, 0.0, since)


def pulls_of(problem: Problem, window: Window, state: State) -> tuple[Array, Array]:
    """Half the squares of what pulls at each frame of `state`: curvature (T, nv, nv), its lower half, and gradient
    (T, nv).
    """
    at = state.at, state.points, state.off, state.turned
    curvature, gradient = pulls(problem.tree, window.places, window.turns, *at)
    np.einsum("tii->ti", curvature)[:, ROOT_DOFS:] += POSTURE**2
    gradient[:, ROOT_DOFS:] += POSTURE**2 * (state.qpos[:, 7:] - problem.nominal)
    return curvature, gradient


def springs_of(problem: Problem, state: State) -> Springs:
    """Those of soles that are near the floor and of bodies that are near each other."""
    carries, met, at = problem.tree.carries, state.met, state.at
    frame, sole = np.nonzero(state.over < 2 * GAP * problem.size)
    up, point = np.tile([0.0, 0.0, 1.0], (len(frame), 1)), state.soles[frame, sole]
    rows = loops.along(at.axis, at.anchor, frame, point, up, carries[problem.soles[0][sole]])
    stiff, slight = STIFF / problem.size**2, SLIGHT * GAP * problem.size
    soles = Springs(frame, rows, state.over[frame, sole], stiff, slight)
    carried = carries[met.bodies[:, 1]] - carries[met.bodies[:, 0]]
    rows = loops.along(at.axis, at.anchor, met.frame, met.place, met.normal, carried)
    return soles.and_those(Springs(met.frame, rows, state.room, stiff, slight))
