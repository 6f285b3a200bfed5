"""Gauss-Newton on the frames of a window, all at once: equations whose band is two frames wide, so that cost grows
linearly with length.
"""

from __future__ import annotations

import numpy as np

from motiongen.rotation import Array
from retarget import loops, sparse
from retarget.banded import SECOND, Equations
from retarget.kinematics import ROOT_DOFS
from retarget.springs import Pushes
from retarget.window import Problem, State, Window, pulls_of, smoothness, springs_of, state_of

GAIN = 0.2  # a step that promises to gain a smaller share of the cost is the last
ENOUGH = 0.3  # promised by a step that is the last; a planted foot that is a millimetre off costs more
PATIENCE = 3  # steps that may lead uphill, or gain less
LEAP = 0.7  # rad (or root heights) that one step may move a frame
DAMPING = 3e-3
KEPT = 0.25, 0.5  # of what a step promised: below it the next is damped ten times as much, above it a tenth
HELD = 1e9  # takes an unknown out of equations where other weights are below 1e6
ROUNDS = 3  # in which to find the springs that push after a step, at most
FEW = 1  # of the first step; each after it may take one more
LEAST_SHARE = 1e-3  # of the way that a round would go


def solved(problem: Problem, window: Window, qpos: Array, steps: int) -> Array:
    """(T, nq) after at most `steps` Gauss-Newton steps from `qpos` (T, nq).

    A long step along stiff springs leads uphill at first, and the next one down: so steps may. How much of what one
    promised it has kept says how far the next is to be damped (Levenberg). One that promises to gain little is taken,
    and is the last; PATIENCE steps that do not gain are the last too.
    """
    damping, waited = DAMPING, 0
    state = best = state_of(problem, window, qpos)
    for done in range(steps):
        stepped, promised, longest = _stepped(problem, window, state, damping, FEW + done)
        if promised < min(GAIN * state.cost, ENOUGH) and (longest < state.short(state.room < 0)).all():
            return stepped
        before, state = state.cost, state_of(problem, window, stepped, state, longest)
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
    state = state_of(problem, window, qpos)
    for _ in range(steps - 1):
        stepped, _, longest = _stepped(problem, window, state, DAMPING, ROUNDS)
        state = state_of(problem, window, stepped, state, longest)
    return _stepped(problem, window, state, DAMPING, ROUNDS)[0]


def _stepped(problem: Problem, window: Window, state: State, damping: float, rounds: int) -> tuple[Array, float, Array]:
    """The configurations a step on, how much less that costs if all is as linear as here, and how far the step goes at
    most in each frame (rad, or root heights).

    Springs that only push make the cost of a step convex, but not quadratic. So it is found in `rounds`, by Newton's
    method: each solves for those that push now, and goes that way as far as that costs less.
    """
    curvature, gradient = pulls_of(problem, window, state)
    pushes, bend, smooth = Pushes(springs_of(problem, state), state.paces), state.bend, smoothness(problem, window)
    held = np.full(gradient.shape, damping)
    held[:, :ROOT_DOFS] = HELD if problem.fixed_root else damping
    step, promised = np.zeros_like(gradient), 0.0
    for _ in range(rounds):
        pushing = pushes.pushing()
        equations = Equations(*pushes.springs.added(curvature, gradient, pushing[0]))
        equations.add_differences(SECOND, smooth, bend)
        pushes.paces.hold(equations, pushing[1])
        more = equations.solved(window.known, held)
        more[:, :ROOT_DOFS] *= not problem.fixed_root
        gain, then = float((equations.downhill * more).sum()), pushes.after(more)
        amiss = then.amiss(pushing)
        if amiss:
            share, gain = _share(pushes, more, gain)
            more = share * more
            then = pushes.after(more)
        step += more
        promised += gain
        longest = np.abs(step).max(1)
        if not amiss or longest.max() > LEAP:
            break
        pushes, bend = then, bend + np.diff(more, n=2, axis=0)
        gradient = gradient + sparse.times(curvature, more) + held * more
    step *= (LEAP / np.maximum(longest, LEAP))[:, None]
    return loops.moved(state.qpos, step), promised, longest


def _share(pushes: Pushes, more: Array, gain: float) -> tuple[float, float]:
    """How far to go the way `more` (T, nv), which would gain `gain` if those pushed that push now: halved until that
    costs more, since the cost is convex; and what it gains.
    """
    pushing, share, most = pushes.pushing(), 1.0, -np.inf
    while share > LEAST_SHARE:
        there = pushes.after(share * more)
        gains = gain * share * (2 - share) + there.strain(pushing) - there.strain(there.pushing())
        if 0 < most > gains:
            return 2 * share, most
        share, most = share / 2, gains
    return 2 * share, most
