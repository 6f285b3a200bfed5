"""Feet on the floor: planted feet are held still and flat, the others stay above it, and the root rides on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from motiongen.rotation import (
    Array,
    quat_conj,
    quat_mul,
    quat_rotate,
    quat_to_rotvec,
    rotvec_to_quat,
    yaw_of_quat,
    yaw_quat,
)
from retarget.contacts import Flags, runs
from retarget.goals import Goal
from retarget.rest import Rest


def flattened(goals: dict[str, Goal], rest: Rest, planted: dict[str, Flags]) -> dict[str, Goal]:
    """The goals with the soles of planted feet level, facing where they faced on average; blended in between."""
    out = dict(goals)
    for foot in _grounded(goals, rest):
        raw = quat_mul(goals[foot].quat, quat_conj(rest.turn[foot]))  # of the sole: identity is flat, facing +x
        yaw = np.unwrap(yaw_of_quat(raw))
        level = [yaw_quat(np.full(end - start, yaw[start:end].mean())) for start, end in runs(planted[foot])]
        fix = [
            quat_to_rotvec(quat_mul(flat, quat_conj(raw[start:end])))
            for flat, (start, end) in zip(level, runs(planted[foot]), strict=True)
        ]
        turn = rotvec_to_quat(_blended(fix, planted[foot]))
        out[foot] = replace(goals[foot], quat=quat_mul(quat_mul(turn, raw), rest.turn[foot]))
    return out


def riding_height(goals: dict[str, Goal], rest: Rest, clearance: Array) -> Array:
    """(T,) metres by which everything must rise for the lowest sole to be `clearance` (T,) above the floor."""
    lows = [_lowest(goals[foot].pos, goals[foot].quat, rest.soles[foot]) for foot in _grounded(goals, rest)]
    return clearance - np.min(lows, axis=0) if lows else clearance


def pinned(goals: dict[str, Goal], rest: Rest, planted: dict[str, Flags]) -> dict[str, Goal]:
    """The goals with planted feet held where they are on average, sole on the floor; blended in between."""
    out = dict(goals)
    for foot in _grounded(goals, rest):
        pos, quat = goals[foot].pos, goals[foot].quat
        fix = []
        for start, end in runs(planted[foot]):
            spot = pos[start:end].mean(0)
            spot = np.broadcast_to(spot, (end - start, 3)).copy()
            spot[:, 2] -= _lowest(spot, quat[start:end], rest.soles[foot])
            fix.append(spot - pos[start:end])
        pos = pos + _blended(fix, planted[foot])
        sunk = np.minimum(_lowest(pos, quat, rest.soles[foot]), 0.0)
        pos[:, 2] -= sunk
        out[foot] = replace(goals[foot], pos=pos)
    return out


def _grounded(goals: dict[str, Goal], rest: Rest) -> list[str]:
    return [foot for foot in rest.soles if foot in goals]


def _lowest(pos: Array, quat: Array, soles: Array) -> Array:
    points = pos[:, None] + quat_rotate(quat[:, None], soles[None])
    return points[..., 2].min(1)


def _blended(pieces: list[Array], planted: Flags) -> Array:
    """(T, 3) correction: each piece over its own stretch of `planted`, smoothly from one to the next in between.

    Before the first and after the last it stays as it is there; without any it is zero.
    """
    out = np.zeros((len(planted), 3))
    spans = runs(planted)
    if not spans:
        return out
    for piece, (start, end) in zip(pieces, spans, strict=True):
        out[start:end] = piece
    out[: spans[0][0]] = pieces[0][0]
    out[spans[-1][1] :] = pieces[-1][-1]
    for before, after, (_, end), (start, _) in zip(pieces, pieces[1:], spans, spans[1:], strict=False):
        u = np.arange(1, start - end + 1)[:, None] / (start - end + 1)
        out[end:start] = before[-1] + u * u * (3 - 2 * u) * (after[0] - before[-1])
    return out
