"""Springs that hold joints back, against differences taken plainly; and steps along springs that only push."""

from __future__ import annotations

import numpy as np
import pytest

from motiongen.rotation import Array
from retarget.banded import Equations
from retarget.paces import STIFF, Paces, paces_of
from retarget.springs import Pushes, Springs

FRAMES, ROOT = 12, 6


def paces(seed: int = 0) -> tuple[Paces, Array]:
    rng = np.random.default_rng(seed)
    joints = rng.normal(size=(FRAMES, 2))
    return paces_of(joints, np.array([[0.5, 0.8], [0.7, 0.4], [1.0, 0.6]])), joints


def beyond(joints: Array, most: Array) -> list[Array]:
    """By how much joints and their differences are beyond what they may, with the sign of the way."""
    values = [np.diff(joints, n=n, axis=0) for n in range(3)]
    return [v - np.clip(v, -m, m) for v, m in zip(values, most, strict=True)]


def test_they_push_where_a_joint_goes_too_far_or_too_fast() -> None:
    held, joints = paces()
    excess = beyond(joints, held.most)
    for n, e in enumerate(excess):
        assert (held.hasty()[n, : len(e)] == np.sign(e)).all()
        assert not held.hasty()[n, len(e) :].any()
    assert held.strain(held.hasty()) == pytest.approx(sum(s * (e**2).sum() for s, e in zip(STIFF, excess, strict=True)))
    assert any(e.any() for e in excess)


def test_after_a_step_they_are_those_of_the_joints_there() -> None:
    held, joints = paces()
    step = np.random.default_rng(1).normal(size=(FRAMES, ROOT + 2))
    assert held.after(step).values == pytest.approx(paces_of(joints + step[:, ROOT:], held.most).values)


def test_what_they_add_to_the_equations_is_the_slope_of_what_they_cost() -> None:
    held, _ = paces()
    equations = Equations(np.zeros((FRAMES, ROOT + 2, ROOT + 2)), np.zeros((FRAMES, ROOT + 2)))
    held.hold(equations, held.hasty())
    for t, d in np.ndindex(FRAMES, 2):
        nudge = np.zeros((FRAMES, ROOT + 2))
        nudge[t, ROOT + d] = 1e-6
        up, down = (held.after(way * nudge).strain(held.hasty()) for way in (1, -1))
        assert equations.downhill[t, ROOT + d] == pytest.approx(-(up - down) / 4e-6, rel=1e-5, abs=1e-3)
    assert not equations.downhill[:, :ROOT].any()


def test_equations_bring_joints_to_their_limits() -> None:
    """With little else to pull at them, and all springs known that push at the end."""
    held, _ = paces()
    for _ in range(30):
        equations = Equations(np.tile(1e-6 * np.eye(ROOT + 2), (FRAMES, 1, 1)), np.zeros((FRAMES, ROOT + 2)))
        held.hold(equations, held.hasty())
        held = held.after(equations.solved(0, np.full((FRAMES, ROOT + 2), 1e-9)))
    assert max(np.abs(e).max() for e in beyond(held.values[0], held.most)) < 1e-3


def test_a_push_is_amiss_where_it_would_have_to_pull() -> None:
    held, _ = paces()
    still = Paces(np.zeros_like(held.values), held.most)
    room = np.array([0.1, -0.1])
    springs = Springs(np.zeros(2, int), np.ones((2, ROOT + 2)), room, 2.0, 0.05)
    pushes = Pushes(springs, still)
    assert not pushes.amiss(pushes.pushing())
    assert pushes.amiss((np.array([True, True]), still.hasty()))
    assert pushes.amiss((np.array([False, False]), still.hasty()))
    assert pushes.strain(pushes.pushing()) == pytest.approx(2.0 * 0.1**2)
    assert Pushes(springs, held).amiss((springs.room < 0, still.hasty()))
    assert not Pushes(springs, held).amiss((springs.room < 0, held.hasty()))
