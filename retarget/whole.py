"""Inverse kinematics of a whole trajectory: all frames in one sparse least-squares problem, not one after the other.

What is minimised is the squared error of every follower, the second differences of the configuration (so that the
motion is as smooth as tracking allows: a low-pass without lag), and a little distance from the nominal pose. Planted
feet, soles above the floor, bodies that keep apart and joint speeds are springs far stiffer than what pulls at them;
joint ranges are kept by projection. Each step is Gauss-Newton with Levenberg's damping on equations whose band is two
frames wide, so that cost grows linearly with length. A coarse solution, of every few frames, comes first.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from motiongen.rotation import Array, quat_conj, quat_continuous, quat_mul, quat_normalize, quat_to_rotvec
from retarget.banded import FIRST, REACH, SECOND, Equations
from retarget.contacts import Flags
from retarget.goals import ROOT, Goal
from retarget.kinematics import ROOT_DOFS, Indices, Poses, Tree, moved, on_body, poses, tree_of, velocities
from retarget.limits import within
from retarget.rig import Rig
from retarget.tracking import (
    Places,
    Turns,
    add_springs,
    angles,
    linearised,
    reached,
    targets_of,
)

SMOOTH = 0.025  # s: wiggles of a weight-1 follower faster than 1 / (2π · SMOOTH) Hz are smoothed away
LEAST_SMOOTH = 0.5  # frames, where they are far apart
POSTURE = 0.03  # weight of the nominal pose, which settles what the goals leave open
GAP = 0.01  # of the root height: how far apart bodies stay that are not nearer in the nominal pose
SLACK = 1e-4  # of the root height: how far a sole may be below the floor
STIFF = 1e3  # of the springs that hold soles above the floor and bodies apart, in units of the nominal root height
SPEEDING = 100.0  # 1/rad², of the springs that hold speeds; what is left `within` cuts off
FIRM = 100.0  # times its weight, a planted foot's goal
COARSE = 0.1  # s between the frames of the first, coarse solution, which finds the way
COARSE_STEPS, FINE_STEPS = 30, 6  # at most
GAIN = 0.02  # a step that gains a smaller share of the cost is the last
HELD = 1e9  # takes an unknown out of equations where other weights are below 1e6
LEAP = 0.7  # rad (or root heights) that one step may move a frame
DAMPING = 1e-4
WINDOW, OVERLAP = 20.0, 1.0  # s solved at once, which bounds the memory, and thrown away where the next one takes over


@dataclass(frozen=True)
class Problem:
    """One window: `places` and `turns` over its T frames, of which the first `known` are solved and stay.

    `smooth` (nv,) weighs squared second differences, `reach` (2, nj) are the joints' ranges in rad, `stride` (nj,) rad
    is what they may move in a frame. `soles`: body (s,) and point (s, 3), kept above the floor. `gaps` (nbody, nbody)
    are the metres that two bodies stay apart. `size` is the nominal root height in metres.
    """

    tree: Tree
    places: Places
    turns: Turns
    known: int
    nominal: Array
    smooth: Array
    reach: Array
    stride: Array
    soles: tuple[Indices, Array]
    gaps: Array
    size: float
    fixed_root: bool


@dataclass(frozen=True)
class State:
    """Configurations `qpos` (T, nq) and what is amiss there; `cost` sums it up by weight.

    `points` and `off` are what `reached` gives and `turned` what `angles` gives, `bend` (T − 2, nv) the second
    differences, `fast` (T − 1, nj) rad above the speeds, `soles` (T, s, 3) where they are, `under` (T, s) and `near`
    (n,) metres too low and too near (below 0).
    """

    qpos: Array
    at: Poses
    points: Array
    off: Array
    turned: Array
    bend: Array
    fast: Array
    soles: Array
    under: Array
    near: Array
    cost: float


def solve(
    rig: Rig,
    model: mujoco.MjModel,
    goals: dict[str, Goal],
    start: Array,
    fps: float,
    *,
    fixed_root: bool,
    planted: dict[str, Flags],
) -> Array:
    """(T, nq) configurations of `model` at `fps` frames a second.

    `start` (nq,) has the joints that the search starts from and that the goals leave open; the root stays there where
    `fixed_root`. `planted` (T,), by human joint, is where a goal is held rather than tracked; with it, soles stay above
    the floor. Joint angles keep within `rig`'s ranges and velocities; a goal out of reach is missed.
    """
    firm = {
        name: replace(g, firm=np.where(planted[name], FIRM, 1.0) * g.firm) if name in planted else g
        for name, g in goals.items()
    }
    count = len(next(iter(goals.values())).pos)
    guess = np.tile(start, (count, 1))
    if not fixed_root and ROOT in goals:
        guess[:, :3], guess[:, 3:7] = goals[ROOT].pos, goals[ROOT].quat
    problem = _problem(rig, model, list(firm.values()), start, fixed_root, grounded=bool(planted))

    window, overlap = round(WINDOW * fps), round(OVERLAP * fps)
    out = np.empty((0, model.nq))
    while len(out) < count:
        end = min(len(out) + window + overlap, count)
        solved = _window(problem, guess, out, end, fps)
        out = np.concatenate([out, solved if end == count else solved[:window]])
    out[:, 7:] = within(out[:, 7:], problem.reach, np.array([j.velocity for j in rig.joints]) / fps)
    return out


def _problem(
    rig: Rig, model: mujoco.MjModel, goals: list[Goal], start: Array, fixed_root: bool, *, grounded: bool
) -> Problem:
    places, turns = targets_of(goals, rig, model)
    sites = [model.site(site) for foot in rig.feet for site in foot.sites] if grounded else []
    size = np.ones(model.nv)
    size[:3] = 1 / rig.nominal.height**2
    tree = _wary(rig, model)
    return Problem(
        tree=tree,
        places=places,
        turns=turns,
        known=0,
        nominal=start[7:],
        smooth=size,
        reach=np.array([[j.lower for j in rig.joints], [j.upper for j in rig.joints]]),
        stride=np.array([j.velocity for j in rig.joints]),
        soles=(np.array([s.bodyid[0] for s in sites], int), np.array([s.pos for s in sites]).reshape(-1, 3)),
        gaps=_gaps(tree, start, GAP * rig.nominal.height),
        size=rig.nominal.height,
        fixed_root=fixed_root,
    )


def _wary(rig: Rig, model: mujoco.MjModel) -> Tree:
    """The tree of a copy of `model` whose geoms notice each other from the gap on."""
    model = copy(model)
    model.geom_margin[:] = GAP * rig.nominal.height
    return tree_of(model)


def _gaps(tree: Tree, start: Array, usual: float) -> Array:
    """(nbody, nbody) metres that two bodies are to stay apart: `usual`, or what they are in the configuration `start`
    (nq,) where that is less."""
    out = np.full((len(tree.carries), len(tree.carries)), usual)
    met = poses(tree, start[None]).meetings
    for bodies in (met.bodies, met.bodies[:, ::-1]):
        np.minimum.at(out, tuple(bodies.T), met.apart)
    return out


def _window(problem: Problem, guess: Array, before: Array, end: int, fps: float) -> Array:
    """Frames len(before) … end, first every COARSE seconds, then all of them from there."""
    start, qpos = len(before), guess[len(before) : end]
    for every, steps in ((max(1, round(COARSE * fps)), COARSE_STEPS), (1, FINE_STEPS)):
        past = before[::-1][every - 1 :: every][:REACH][::-1]
        first = start - len(past) * every
        frames = slice(first, end, every)
        part = replace(
            problem,
            places=problem.places.at(frames),
            turns=problem.turns.at(frames),
            known=len(past),
            smooth=problem.smooth * max(SMOOTH * fps / every, LEAST_SMOOTH) ** 4,
            stride=problem.stride * every / fps,
        )
        solved = _solved(part, np.concatenate([past, qpos[::every]]), steps)[len(past) :]
        qpos = _spread(solved, every, end - start)
    return qpos


def _solved(problem: Problem, qpos: Array, steps: int) -> Array:
    """At most `steps` Gauss-Newton steps from `qpos`.

    Ranges are kept by projection (Bertsekas 1982): what is at its end and would go further sits out a step, and what
    arrives there stops.
    """
    damping = DAMPING
    state = _state(problem, np.concatenate([qpos[:, :7], np.clip(qpos[:, 7:], *problem.reach)], axis=1))
    for _ in range(steps):
        equations = _equations(problem, state)
        frozen = _frozen(problem, state.qpos, equations.downhill)
        step = np.where(frozen, 0.0, equations.solved(problem.known, np.where(frozen, HELD, damping)))
        qpos = moved(state.qpos, step * (LEAP / np.maximum(np.abs(step).max(1, keepdims=True), LEAP)))
        qpos[:, 7:] = np.clip(qpos[:, 7:], *problem.reach)
        tried = _state(problem, qpos)
        if tried.cost > state.cost:
            damping *= 30
            continue
        gain, state, damping = state.cost - tried.cost, tried, max(damping / 10, DAMPING)
        if gain < GAIN * state.cost:
            break
    return state.qpos


def _frozen(problem: Problem, qpos: Array, downhill: Array) -> Flags:
    """(T, nv): at the end of its range with `downhill` (T, nv) beyond it; and a fixed root."""
    out = np.zeros(downhill.shape, bool)
    out[:, :ROOT_DOFS] = problem.fixed_root
    low, high = problem.reach
    angles, way = qpos[:, 7:], downhill[:, ROOT_DOFS:]
    out[:, ROOT_DOFS:] = ((angles <= low) & (way < 0)) | ((angles >= high) & (way > 0))
    return out


def _state(problem: Problem, qpos: Array) -> State:
    at = poses(problem.tree, qpos)
    points, off = reached(problem.places, at)
    turned = angles(problem.turns, at)
    rate = _differences(qpos)
    bend = np.diff(rate, axis=0)
    fast = rate[:, ROOT_DOFS:] - np.clip(rate[:, ROOT_DOFS:], -problem.stride, problem.stride)
    soles = on_body(at, *problem.soles)
    under = np.minimum(soles[..., 2] + SLACK * problem.size, 0.0)
    near = np.minimum(at.meetings.apart - problem.gaps[*at.meetings.bodies.T], 0.0)
    cost = (
        (problem.places.weight * (off**2).sum(-1)).sum()
        + (problem.turns.weight * (turned**2).sum(-1)).sum()
        + (problem.smooth * bend**2).sum()
        + POSTURE**2 * ((qpos[:, 7:] - problem.nominal) ** 2).sum()
        + SPEEDING * (fast**2).sum()
        + STIFF / problem.size**2 * ((under**2).sum() + (near**2).sum())
    )
    return State(qpos, at, points, off, turned, bend, fast, soles, under, near, float(cost))


def _equations(problem: Problem, state: State) -> Equations:
    """Half the squares of `state`, each linear in the step of the configurations."""
    tree, at = problem.tree, state.at
    rows, value = linearised(tree, problem.places, problem.turns, at, state.points, state.off, state.turned)
    curvature, gradient = rows @ rows.swapaxes(1, 2), (rows @ value[..., None])[..., 0]
    joints = np.arange(ROOT_DOFS, tree.model.nv)
    curvature[:, joints, joints] += POSTURE**2
    gradient[:, joints] += POSTURE**2 * (state.qpos[:, 7:] - problem.nominal)

    stiff, every = STIFF / problem.size**2, np.arange(tree.model.nv)
    frame, sole = np.nonzero(state.under)
    if len(frame):
        rows = velocities(at, every, state.soles[frame, sole][:, None], frame)[..., 2]
        rows *= tree.carries[problem.soles[0][sole]]
        add_springs(curvature, gradient, frame, rows, state.under[frame, sole], stiff)
    if state.near.any():
        met = at.meetings.of(np.flatnonzero(state.near))
        rows = (velocities(at, every, met.place[:, None], met.frame) @ met.normal[..., None])[..., 0]
        rows *= tree.carries[met.bodies[:, 1]] - tree.carries[met.bodies[:, 0]]
        add_springs(curvature, gradient, met.frame, rows, state.near[state.near < 0], stiff)

    out = Equations(curvature, gradient)
    out.add_differences(SECOND, problem.smooth, state.bend)
    fast = np.concatenate([np.zeros((len(state.fast), ROOT_DOFS)), state.fast], axis=1)
    out.add_differences(FIRST, SPEEDING * (fast != 0), fast)
    return out


def _differences(qpos: Array) -> Array:
    """(T − 1, nv) from one frame to the next: what mj_differentiatePos does for a step of 1 s."""
    turn = quat_to_rotvec(quat_mul(quat_conj(qpos[:-1, 3:7]), qpos[1:, 3:7]))
    return np.concatenate([np.diff(qpos[:, :3], axis=0), turn, np.diff(qpos[:, 7:], axis=0)], axis=1)


def _spread(qpos: Array, every: int, count: int) -> Array:
    """`qpos` of every `every`-th frame at all `count`, by cubic Hermite splines; the last is held."""
    qpos = np.concatenate([qpos[:, :3], quat_continuous(qpos[:, 3:7]), qpos[:, 7:]], axis=1)
    if every == 1 or len(qpos) < 2:
        return np.repeat(qpos, every, axis=0)[:count]
    at = np.minimum(np.arange(count) / every, len(qpos) - 1)
    left = np.minimum(at.astype(int), len(qpos) - 2)
    u, slope = (at - left)[:, None], np.gradient(qpos, axis=0)
    out = (1 + 2 * u) * (1 - u) ** 2 * qpos[left] + u**2 * (3 - 2 * u) * qpos[left + 1]
    out += u * (1 - u) ** 2 * slope[left] - u**2 * (1 - u) * slope[left + 1]
    out[:, 3:7] = quat_normalize(out[:, 3:7])
    return out
