"""Inverse kinematics of a whole trajectory: all frames in one sparse least-squares problem, not one after the other.

What is minimised is the squared error of every follower, the third differences of the configuration (so that the
motion is as smooth as tracking allows: a low-pass without lag), and a little distance from the nominal pose. Joint
ranges and speeds, soles on the floor and planted feet are constraints, held by augmented Lagrangians (Nocedal and
Wright 2006, ch. 17.4): each is a stiff spring whose rest is shifted until it no longer gives. Each step is Gauss-Newton
with Levenberg's damping on equations whose band is three frames wide, so that cost grows linearly with length.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from motiongen.rotation import Array, quat_conj, quat_continuous, quat_mul, quat_normalize, quat_to_rotvec
from retarget.banded import FIRST, REACH, THIRD, Equations
from retarget.contacts import Flags
from retarget.goals import ROOT, Goal
from retarget.kinematics import ROOT_DOFS, Indices, Poses, Tree, moved, on_body, point_jacobian, poses, tree_of
from retarget.limits import within
from retarget.rig import Rig
from retarget.tracking import Targets, add_meetings, add_tracking, errors, targets_of

SMOOTH = 0.03  # s: wiggles of a weight-1 follower faster than 1 / (2π · SMOOTH) Hz are smoothed away
LEAST_SMOOTH = 0.5  # frames, where they are far apart
POSTURE = 0.03  # weight of the nominal pose, which settles what the goals leave open
GAP = 0.02  # of the root height: how far apart bodies stay
STIFF = 1e3  # of the springs that hold soles above the floor and bodies apart, in units of the nominal root height
SPEEDING = 10.0  # 1/rad², of the springs that hold speeds; what is left `within` cuts off
FIRM = 100.0  # times its weight, a planted foot's spring
COARSE = 0.1  # s between the frames of the first, coarse solution, which finds the way
COARSE_STEPS, FINE_STEPS = 30, 8  # at most
GAIN = 1e-2  # a step that gains a smaller share of the cost is the last …
HELD = 1e9  # takes an unknown out of equations where other weights are below 1e6
HOLDS = 3e-4  # … if planted feet and the floor gave no more than this share of the root's height
LEAP = 0.7  # rad (or root heights) that one step may move a frame
DAMPING = 1e-3
WINDOW, OVERLAP = 20.0, 1.0  # s solved at once, which bounds the memory, and thrown away where the next one takes over


@dataclass(frozen=True)
class Problem:
    """One window: `targets` over its T frames, of which the first `known` are solved and stay.

    `smooth` (nv,) weighs squared third differences, `reach` (2, nj) are the joints' ranges in rad, `stride` (nj,) rad
    is what they may move in a frame, `planted` (T, k) where followers are held. `soles`: body (s,) and point (s, 3).
    `size` is the nominal root height in metres.
    """

    tree: Tree
    targets: Targets
    known: int
    nominal: Array
    smooth: Array
    reach: Array
    stride: Array
    planted: Flags
    soles: tuple[Indices, Array]
    size: float
    fixed_root: bool


@dataclass(frozen=True)
class Shifts:
    """How far the rests of the springs are shifted: Lagrange multipliers over stiffness."""

    stride: Array
    floor: Array
    off: Array
    turned: Array


@dataclass(frozen=True)
class State:
    """Configurations `qpos` (T, nq) and what is amiss there; `cost` sums it up by weight."""

    qpos: Array
    at: Poses
    off: Array
    turned: Array
    jerk: Array
    fast: Array
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
    names = [name for name, g in goals.items() if g.follow.position or g.follow.rotation]
    targets = targets_of([goals[name] for name in names], rig, model)
    count = len(targets.place)
    held = np.stack([planted.get(name, np.zeros(count, bool)) for name in names], axis=1)
    stiff = np.where(held, FIRM, 1.0)
    targets = replace(targets, position=targets.position * stiff, rotation=targets.rotation * stiff)
    guess = np.tile(start, (count, 1))
    if not fixed_root and ROOT in goals:
        guess[:, :3], guess[:, 3:7] = goals[ROOT].pos, goals[ROOT].quat
    problem = _problem(rig, _wary(rig, model), targets, held, start, fixed_root, grounded=bool(planted))

    window, overlap = round(WINDOW * fps), round(OVERLAP * fps)
    out = np.empty((0, model.nq))
    while len(out) < count:
        end = min(len(out) + window + overlap, count)
        solved = _window(problem, guess, out, end, fps)
        out = np.concatenate([out, solved if end == count else solved[:window]])
    out[:, 7:] = within(out[:, 7:], problem.reach, np.array([j.velocity for j in rig.joints]) / fps)
    return out


def _problem(
    rig: Rig, tree: Tree, targets: Targets, held: Flags, start: Array, fixed_root: bool, *, grounded: bool
) -> Problem:
    model = tree.model
    sites = [model.site(site) for foot in rig.feet for site in foot.sites] if grounded else []
    size = np.ones(model.nv)
    size[:3] = 1 / rig.nominal.height**2
    return Problem(
        tree=tree,
        targets=targets,
        known=0,
        nominal=start[7:],
        smooth=size,
        reach=np.array([[j.lower for j in rig.joints], [j.upper for j in rig.joints]]),
        stride=np.array([j.velocity for j in rig.joints]),
        planted=held,
        soles=(np.array([s.bodyid[0] for s in sites], int), np.array([s.pos for s in sites]).reshape(-1, 3)),
        size=rig.nominal.height,
        fixed_root=fixed_root,
    )


def _wary(rig: Rig, model: mujoco.MjModel) -> Tree:
    """The tree of a copy of `model` whose geoms notice each other from the gap on."""
    model = copy(model)
    model.geom_margin[:] = GAP * rig.nominal.height
    return tree_of(model)


def _window(problem: Problem, guess: Array, before: Array, end: int, fps: float) -> Array:
    """Frames len(before) … end, first every COARSE seconds, then all of them from there."""
    start, qpos = len(before), guess[len(before) : end]
    for every, steps in ((max(1, round(COARSE * fps)), COARSE_STEPS), (1, FINE_STEPS)):
        past = before[::-1][every - 1 :: every][:REACH][::-1]
        first = start - len(past) * every
        frames = slice(first, end, every)
        part = replace(
            problem,
            targets=problem.targets.at(frames),
            known=len(past),
            smooth=problem.smooth * max(SMOOTH * fps / every, LEAST_SMOOTH) ** 6,
            stride=problem.stride * every / fps,
            planted=problem.planted[frames],
        )
        solved = _solved(part, np.concatenate([past, qpos[::every]]), steps, shifting=every == 1)[len(past) :]
        qpos = _spread(solved, every, end - start)
    return qpos


def _solved(problem: Problem, qpos: Array, steps: int, *, shifting: bool) -> Array:
    """At most `steps` Gauss-Newton steps, after each of which the springs shift where `shifting`.

    Ranges are kept by projection (Bertsekas 1982): what is at its end and would go further sits out a step, and what
    arrives there stops.
    """
    shift, damping = _unshifted(problem), DAMPING
    qpos = np.concatenate([qpos[:, :7], np.clip(qpos[:, 7:], *problem.reach)], axis=1)
    state = _state(problem, shift, qpos, poses(problem.tree, qpos))
    for _ in range(steps):
        equations = _equations(problem, state)
        frozen = _frozen(problem, state.qpos, equations.right)
        step = np.where(frozen, 0.0, equations.solved(problem.known, np.where(frozen, HELD, damping)))
        qpos = moved(state.qpos, step * (LEAP / np.maximum(np.abs(step).max(1, keepdims=True), LEAP)))
        qpos[:, 7:] = np.clip(qpos[:, 7:], *problem.reach)
        tried = _state(problem, shift, qpos, poses(problem.tree, qpos))
        if tried.cost > state.cost:
            damping *= 10
            continue
        gain, state, damping = state.cost - tried.cost, tried, max(damping / 10, DAMPING)
        before, shift = shift, _shifted(problem, state) if shifting else shift
        if gain < GAIN * state.cost and _given(before, shift) < HOLDS * problem.size:
            break
        if shifting:
            state = _state(problem, shift, state.qpos, state.at)
    return state.qpos


def _frozen(problem: Problem, qpos: Array, downhill: Array) -> Flags:
    """(T, nv): at the end of its range with `downhill` (T, nv) beyond it; and a fixed root."""
    out = np.zeros(downhill.shape, bool)
    out[:, :ROOT_DOFS] = problem.fixed_root
    low, high = problem.reach
    angles, way = qpos[:, 7:], downhill[:, ROOT_DOFS:]
    out[:, ROOT_DOFS:] = ((angles <= low) & (way < 0)) | ((angles >= high) & (way > 0))
    return out


def _unshifted(problem: Problem) -> Shifts:
    count, k = problem.planted.shape
    joints = len(problem.stride)
    return Shifts(
        np.zeros((count - 1, joints)),
        np.zeros((count, len(problem.soles[0]))),
        np.zeros((count, k, 3)),
        np.zeros((count, k, 3)),
    )


def _shifted(problem: Problem, state: State) -> Shifts:
    held = problem.planted[..., None]
    return Shifts(state.fast, state.under, state.off * held, state.turned * held)


def _given(before: Shifts, after: Shifts) -> float:
    """Metres by which the springs of the floor and of planted feet still gave."""
    return max(float(np.abs(getattr(after, k) - getattr(before, k)).max(initial=0.0)) for k in ("off", "floor"))


def _state(problem: Problem, shift: Shifts, qpos: Array, at: Poses) -> State:
    targets = problem.targets
    off, turned = errors(targets, at)
    off, turned = off + shift.off, turned + shift.turned
    rate = _differences(qpos)
    jerk = np.diff(rate, n=2, axis=0)
    wanted = rate[:, ROOT_DOFS:] + shift.stride
    fast = wanted - np.clip(wanted, -problem.stride, problem.stride)
    near = np.minimum(at.meetings.apart - GAP * problem.size, 0.0)
    under = np.minimum(on_body(at, *problem.soles)[..., 2] + shift.floor, 0.0)
    cost = (
        (targets.position * (off**2).sum(-1)).sum()
        + (targets.rotation * (turned**2).sum(-1)).sum()
        + (problem.smooth * jerk**2).sum()
        + POSTURE**2 * ((qpos[:, 7:] - problem.nominal) ** 2).sum()
        + SPEEDING * (fast**2).sum()
        + STIFF / problem.size**2 * ((under**2).sum() + (near**2).sum())
    )
    return State(qpos, at, off, turned, jerk, fast, under, near, float(cost))


def _equations(problem: Problem, state: State) -> Equations:
    """The squares of `state`, each linear in the step of the configurations."""
    count, nv = len(state.qpos), problem.tree.model.nv
    out = Equations(count, nv)
    add_tracking(out, problem.tree, problem.targets, state.at, state.off, state.turned)
    out.differences(THIRD, np.tile(problem.smooth, (len(state.jerk), 1)), state.jerk)

    weight, gradient = np.zeros((count, nv)), np.zeros((count, nv))
    weight[:, ROOT_DOFS:] = POSTURE**2
    gradient[:, ROOT_DOFS:] = POSTURE**2 * (state.qpos[:, 7:] - problem.nominal)
    out.diagonal(weight, gradient)
    fast = np.zeros((count - 1, nv))
    fast[:, ROOT_DOFS:] = state.fast
    out.differences(FIRST, SPEEDING * (fast != 0), fast)

    bodies, points = problem.soles
    stiff = STIFF / problem.size**2
    low = np.flatnonzero((state.under < 0).any(0))
    if len(low):
        rows = point_jacobian(state.at, on_body(state.at, bodies, points)[:, low], problem.tree.carries[bodies[low]])
        rows = rows[:, :, 2] * (state.under[:, None, low] < 0)
        out.blocks(stiff * rows @ rows.swapaxes(1, 2))
        out.diagonal(np.zeros((count, nv)), stiff * (rows @ state.under[:, low, None])[..., 0])
    if state.near.any():
        add_meetings(out, problem.tree, state.at, state.near, stiff)
    return out


def _differences(qpos: Array) -> Array:
    """(T − 1, nv) from one frame to the next: what mj_differentiatePos does for a step of 1 s."""
    turn = quat_to_rotvec(quat_mul(quat_conj(qpos[:-1, 3:7]), qpos[1:, 3:7]))
    return np.concatenate([np.diff(qpos[:, :3], axis=0), turn, np.diff(qpos[:, 7:], axis=0)], axis=1)


def _spread(qpos: Array, every: int, count: int) -> Array:
    """`qpos` of every `every`-th frame at all `count`, by cubic splines; the last is held."""
    from scipy.interpolate import CubicSpline

    qpos = np.concatenate([qpos[:, :3], quat_continuous(qpos[:, 3:7]), qpos[:, 7:]], axis=1)
    if every == 1 or len(qpos) < 2:
        return np.repeat(qpos, every, axis=0)[:count]
    at = np.minimum(np.arange(count) / every, len(qpos) - 1)
    out = CubicSpline(np.arange(len(qpos)), qpos)(at)
    out[:, 3:7] = quat_normalize(out[:, 3:7])
    return out
