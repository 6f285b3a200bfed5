"""Inverse kinematics of a whole trajectory: all frames in one sparse least-squares problem, not one after the other.

A long one is cut into windows that overlap. In each a coarse solution, of every few frames, finds the way first.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from motiongen.rotation import Array, quat_continuous, quat_normalize
from retarget.banded import REACH
from retarget.contacts import Flags
from retarget.descent import solved
from retarget.goals import ROOT, Goal
from retarget.limits import limits_of, within
from retarget.rig import Rig
from retarget.tracking import Places, Turns, targets_of
from retarget.window import FIRM, Problem, Window, problem_of

SMOOTH = 0.025  # s
# Seconds between the frames that are solved, coarse ones first, which find the way; of how many of them one is looked
# at for bodies that meet (0: none, they pass through each other), and steps at most.
STAGES = ((0.4, 0, 30), (0.1, 1, 30), (0.0, 3, 12))
WINDOW, OVERLAP = 20.0, 1.0  # s solved at once, which bounds the memory, and thrown away where the next one takes over


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
    count = len(next(iter(goals.values())).pos)
    guess = np.tile(start, (count, 1))
    if not fixed_root and ROOT in goals:
        guess[:, :3], guess[:, 3:7] = goals[ROOT].pos, goals[ROOT].quat
    problem = problem_of(rig, model, start, fixed_root=fixed_root, grounded=bool(planted))
    places, turns = targets_of(firmed(goals, planted), rig, model)

    window, overlap = round(WINDOW * fps), round(OVERLAP * fps)
    out = np.empty((0, model.nq))
    while len(out) < count:
        end = min(len(out) + window + overlap, count)
        found = _window(problem, places, turns, guess, out, end, fps)
        out = np.concatenate([out, found if end == count else found[:window]])
    out[:, 7:] = within(out[:, 7:], limits_of(rig, fps))
    return out


def firmed(goals: dict[str, Goal], planted: dict[str, Flags]) -> list[Goal]:
    """The goals, those of human joints FIRM times as firm where they are `planted` (T,)."""
    return [
        replace(g, firm=np.where(planted[name], FIRM, 1.0) * g.firm) if name in planted else g
        for name, g in goals.items()
    ]


def _window(problem: Problem, places: Places, turns: Turns, guess: Array, before: Array, end: int, fps: float) -> Array:
    """Frames len(before) … end, in STAGES, each from the one before."""
    start, qpos = len(before), guess[len(before) : end]
    for apart, look, steps in STAGES:
        every = max(1, round(apart * fps))
        past = before[::-1][every - 1 :: every][:REACH][::-1]
        frames = slice(start - len(past) * every, end, every)
        part = Window(places.at(frames), turns.at(frames), len(past), every / fps, SMOOTH, look)
        found = solved(problem, part, np.concatenate([past, qpos[::every]]), steps)[len(past) :]
        qpos = _spread(found, every, end - start)
    return qpos


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
