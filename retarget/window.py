"""Inverse kinematics of the frames of a window at once: what it weighs, and Gauss-Newton on it.

What is minimised is the squared error of every follower, the second differences of the configuration (so that the
motion is as smooth as tracking allows: a low-pass without lag), and a little distance from the nominal pose. Planted
feet, soles above the floor, bodies that keep apart and what joints may do are springs far stiffer than what pulls at
them. Each step is Gauss-Newton with Levenberg's damping on equations whose band is two
frames wide, so that cost grows linearly with length.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from motiongen.rotation import Array
from retarget import loops
from retarget.banded import SECOND, Equations
from retarget.kinematics import ROOT_DOFS, Meetings, Poses, Tree, meetings, on_body, poses, tree_of
from retarget.loops import Flags, Indices, differences, moved
from retarget.paces import Paces, paces_of
from retarget.rig import Rig
from retarget.springs import Springs
from retarget.tracking import Places, Turns, angles, pulls, reached

LEAST_SMOOTH = 0.5  # frames, where they are far apart
POSTURE = 0.03  # weight of the nominal pose, which settles what the goals leave open
GAP = 0.01  # of the root height: how far apart bodies stay that are not nearer in the nominal pose
NOTICE = 1.2  # times as far apart they are noticed
SLACK = 1e-4  # of the root height: how far a sole may be below the floor
STIFF = 1e3  # of the springs that hold soles above the floor and bodies apart, in units of the nominal root height
AIM = 0.97  # of a joint's speed and acceleration: what goes slightly beyond still keeps to them
FIRM = 100.0  # times its weight, a planted foot's goal
ENOUGH = 0.3  # promised by a step that is the last; a planted foot that is a millimetre off costs more
GAIN = 0.2  # a step that promises to gain a smaller share of the cost is the last
PATIENCE = 3  # steps that may lead uphill, or gain less
HELD = 1e9  # takes an unknown out of equations where other weights are below 1e6
LEAP = 0.7  # rad (or root heights) that one step may move a frame
DAMPING = 3e-3
KEPT = 0.25, 0.5  # of what a step promised: below it the next is damped ten times as much, above it a tenth
LEAST_SHARE = 1e-3  # of a step
ROUNDS = 3  # in which to find the springs that push after a step, at most
SLIGHT = 0.1  # of a gap, or of a speed: springs that are out by less are not asked again
SHORT = 0.2  # rad (or root heights): on a shorter way bodies go on to meet where they did


@dataclass(frozen=True)
class Problem:
    """What a rig brings to every window. `wary` is the model with bodies that notice each other. `nominal` (nj,) rad;
    `even` (nv,) brings second differences of metres and radians to one scale; of the joints, `reach` (2, nj) rad and
    `speed` (nj,) rad/s, `surge` (nj,) rad/s². `soles`: body (s,) and point (s, 3), kept above the floor. `gaps` (nbody, nbody) are the metres
    that two bodies stay apart. `size` is the nominal root height in metres.
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
    follower of weight 1 does faster than 1 / (2π · `smooth`) Hz is smoothed away (`smooth` in s). Bodies are looked at in
    one of `look` frames, and taken to meet alike in those after it; in none where it is 0.
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


def solved(problem: Problem, window: Window, qpos: Array, steps: int) -> Array:
    """(T, nq) after at most `steps` Gauss-Newton steps from `qpos` (T, nq).

    A long step along stiff springs leads uphill at first, and the next one down: so steps may. How much of what one
    promised it has kept says how far the next is to be damped (Levenberg). One that promises to gain little is taken,
    and is the last; PATIENCE steps that do not gain are the last too.
    """
    damping, waited = DAMPING, 0
    state = best = _state(problem, window, qpos)
    for _ in range(steps):
        stepped, promised, longest = _stepped(problem, window, state, damping)
        if promised < min(GAIN * state.cost, ENOUGH) and longest.max() < SHORT:
            return stepped
        before, state = state.cost, _state(problem, window, stepped, state, longest)
        kept = (before - state.cost) / promised if promised > 0 else 0.0
        if kept < KEPT[0]:
            damping *= 10
        elif kept > KEPT[1] and state.cost < best.cost:
            damping = max(damping / 10, DAMPING)
        waited = 0 if state.cost < (1 - GAIN) * before else waited + 1
        best = min(state, best, key=lambda s: s.cost)
        if waited == PATIENCE:
            break
    return best.qpos


def followed(problem: Problem, window: Window, qpos: Array, steps: int) -> Array:
    """(T, nq) after `steps` Gauss-Newton steps from `qpos` (T, nq), which is near, whether or not they lead downhill:
    along stiff springs every long one leads uphill at first.
    """
    state = _state(problem, window, qpos)
    for _ in range(steps - 1):
        stepped, _, longest = _stepped(problem, window, state, DAMPING)
        state = _state(problem, window, stepped, state, longest)
    return _stepped(problem, window, state, DAMPING)[0]


def _stepped(problem: Problem, window: Window, state: State, damping: float) -> tuple[Array, float, Array]:
    """The configurations a step on, how much less that costs if all is as linear as here, and how far the step goes at
    most (rad, or root heights).

    Springs that only push make the cost of a step convex, but not quadratic. So it is found in ROUNDS, by Newton's
    method: each solves for those that push now, and goes that way as far as that costs less.
    """
    held = np.full((len(state.qpos), state.bend.shape[1]), damping)
    held[:, :ROOT_DOFS] = HELD if problem.fixed_root else damping
    curvature, gradient = _pull(problem, window, state)
    springs, paces, bend = _springs(problem, state), state.paces, state.bend
    step, promised = np.zeros_like(gradient), 0.0
    stiff, smooth = STIFF / problem.size**2, _smooth(problem, window)
    for _ in range(ROUNDS):
        pushing, hasty = springs.room < 0, paces.hasty()
        equations = Equations(*springs.added(curvature, gradient, pushing, stiff))
        equations.add_differences(SECOND, smooth, bend)
        paces.hold(equations, hasty)
        more = equations.solved(window.known, held)
        more[:, :ROOT_DOFS] *= not problem.fixed_root
        gain, share = float((equations.downhill * more).sum()), 1.0
        then, pace = springs.after(more), paces.after(more)
        wrong = then.room[(then.room < 0) != pushing]
        amiss = (np.abs(wrong) > SLIGHT * GAP * problem.size).any() or pace.amiss(hasty, SLIGHT)
        if amiss:
            before, (gain, share) = gain, (-1.0, 2.0)
            while share > LEAST_SHARE:  # what it costs is convex: halve the way until that costs more
                now, pace = springs.after(share / 2 * more), paces.after(share / 2 * more)
                gains = before * share / 2 * (2 - share / 2) + pace.strain(hasty) - pace.strain(pace.hasty())
                gains += stiff * float((now.room[pushing] ** 2).sum() - (now.room[now.room < 0] ** 2).sum())
                if 0 < gain > gains:
                    break
                gain, share, then = gains, share / 2, now
            pace = paces.after(share * more)
            more = share * more
        step += more
        promised += gain
        longest = np.abs(step).max(1, keepdims=True)
        if not amiss or longest.max() > LEAP:
            break
        springs, paces, bend = then, pace, bend + np.diff(more, n=2, axis=0)
        gradient = gradient + loops.times(curvature, more) + held * more
    step *= LEAP / np.maximum(longest, LEAP)
    return moved(state.qpos, step), promised, longest[:, 0]


def _smooth(problem: Problem, window: Window) -> Array:
    """(nv,) weights of squared second differences."""
    return problem.even * max(window.smooth / window.step, LEAST_SMOOTH) ** 4


def _state(problem: Problem, window: Window, qpos: Array, last: State | None = None, longest: Array | None = None) -> State:
    """The state at `qpos` (T, nq). Bodies meet where they did in the `last` one, or else are looked at."""
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
        + (_smooth(problem, window) * bend**2).sum()
        + POSTURE**2 * ((qpos[:, 7:] - problem.nominal) ** 2).sum()
        + paces.strain(paces.hasty())
        + STIFF / problem.size**2 * ((np.minimum(over, 0.0) ** 2).sum() + (np.minimum(room, 0.0) ** 2).sum())
    )
    return State(qpos, at, met, points, off, turned, bend, paces, soles, over, room, float(cost), since)


def _met(
    problem: Problem, window: Window, qpos: Array, at: Poses, last: State | None, longest: Array | None
) -> tuple[Meetings, Array]:
    """Where bodies meet at `qpos` (T, nq), and how far each frame has gone since it was looked at (T,): it is not looked
    at again before that is SHORT.
    """
    if window.look == 0:
        return meetings(problem.wary, qpos[:0]), np.zeros(len(qpos))
    if last is None or longest is None:
        met = found = meetings(problem.wary, qpos, np.arange(window.known, len(qpos), window.look))
        for later in range(1, window.look):
            met = met.and_those(found.of(found.frame + later < len(qpos)).carried(at, at, later))
        return met, np.zeros(len(qpos))
    since = last.since + longest
    far = since >= SHORT
    met = last.met.of(~far[last.met.frame]).carried(last.at, at)
    if far.any():
        met = met.and_those(meetings(problem.wary, qpos, np.flatnonzero(far)))
    return met, np.where(far, 0.0, since)


def _pull(problem: Problem, window: Window, state: State) -> tuple[Array, Array]:
    """Half the squares of what pulls at each frame of `state`: curvature (T, nv, nv), its lower half, and gradient
    (T, nv).
    """
    at = state.at, state.points, state.off, state.turned
    curvature, gradient = pulls(problem.tree, window.places, window.turns, *at)
    np.einsum("tii->ti", curvature)[:, ROOT_DOFS:] += POSTURE**2
    gradient[:, ROOT_DOFS:] += POSTURE**2 * (state.qpos[:, 7:] - problem.nominal)
    return curvature, gradient


def _springs(problem: Problem, state: State) -> Springs:
    """Those of soles that are near the floor and of bodies that are near each other."""
    carries, met, at = problem.tree.carries, state.met, state.at
    frame, sole = np.nonzero(state.over < 2 * GAP * problem.size)
    up, point = np.tile([0.0, 0.0, 1.0], (len(frame), 1)), state.soles[frame, sole]
    rows = loops.along(at.axis, at.anchor, frame, point, up, carries[problem.soles[0][sole]])
    soles = Springs(frame, rows, state.over[frame, sole])
    carried = carries[met.bodies[:, 1]] - carries[met.bodies[:, 0]]
    rows = loops.along(at.axis, at.anchor, met.frame, met.place, met.normal, carried)
    return soles.and_those(Springs(met.frame, rows, state.room))
