"""A step along springs that only push, against a minimiser that knows nothing of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize
from two_arm_rig import two_arm_rig
from wandering import FPS, goals_from, nominal

from motiongen.rotation import Array
from retarget.descent import DAMPING, _stepped
from retarget.model import load_model
from retarget.tracking import targets_of
from retarget.window import Window, problem_of, pulls_of, smoothness, state_of


def test_a_step_is_where_its_convex_cost_is_least(tmp_path: Path) -> None:
    """The left arm is asked to jump by 0.5 rad, above its speed and acceleration, and then beyond its range."""
    rig = two_arm_rig(tmp_path)
    model, t = load_model(rig), np.arange(24) / FPS
    start, made = np.tile(nominal(rig), (2, len(t), 1))
    start[:, 7] = np.linspace(1.8, 1.9, len(t))
    made[:, 7] = np.where(t < 0.2, 1.5, 2.3)
    made[:, 8] = 0.3 * np.sin(8 * t)
    goals = goals_from(made, model, {"left_wrist": "left_arm", "right_wrist": "right_arm", "pelvis": "base"})
    problem = problem_of(rig, model, nominal(rig), fixed_root=True, grounded=False)
    window = Window(*targets_of(list(goals.values()), rig, model), 2, 1 / FPS, 0.025, 1)
    state = state_of(problem, window, start)
    lower, gradient = pulls_of(problem, window, state)
    curvature = lower + np.tril(lower, -1).swapaxes(1, 2)
    smooth = smoothness(problem, window)

    def cost(joints: Array) -> float:
        """Of a step of the joints of all frames but the first two: twice what is minimised."""
        x = np.zeros_like(gradient)
        x[2:, 6:] = joints.reshape(-1, 2)
        after = state.paces.after(x)
        pulls = np.einsum("ti,tij,tj->", x, curvature, x) + 2 * (gradient * x).sum() + DAMPING * (x**2).sum()
        bends = (smooth * (state.bend + np.diff(x, n=2, axis=0)) ** 2).sum()
        return float(pulls + bends + after.strain(after.hasty()))

    still = cost(np.zeros(2 * len(t) - 4))
    found, promised, _ = _stepped(problem, window, state, DAMPING, 20)
    step = (found - start)[2:, 7:].ravel()
    assert 0 < np.abs(step).max() < 0.7  # or it would have been shortened
    assert still - cost(step) == pytest.approx(promised, rel=1e-6)
    best = minimize(cost, np.zeros_like(step), method="BFGS", options={"maxiter": 5000, "gtol": 1e-9})
    assert still - cost(step) > 0.95 * (still - best.fun)  # springs that are out by a tenth are not asked again
    one = _stepped(problem, window, state, DAMPING, 1)[0]
    assert still - cost((one - start)[2:, 7:].ravel()) < 0.9 * (still - best.fun)
