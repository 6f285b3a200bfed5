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
from retarget.treads import kept_apart

# A foot in the air counts for this share of a planted one, so that a high kick does not pull the pelvis after it; in
# between its weight changes over FIRMING seconds, all of them outside the contact.
SWING = 0.2
FIRMING = 0.1
# People swing their toes some 2 cm above the floor, bent up; a rig's sole is stiff and would scuff where theirs clears.
CLEARANCE = 0.025  # of the root's height, reached FIRMING seconds from the contact …
PASSING = 0.4  # … and where the foot is this many m/s faster than the other
BESIDE = 0.012  # of the root's height, at least, between two feet that stand: a rig's may be wide for its legs


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


def riding_height(goals: dict[str, Goal], rest: Rest, height: Array, supported: Flags) -> Array:
    """(T,) metres by which everything must rise: the lowest sole lies on the floor while `supported` (T,).

    In the air the root follows `height` (T,), the scaled height of the human pelvis, corrected from one support to the
    next; so a jump keeps its arc whatever the feet do.
    """
    lows = [_lowest(goals[foot].pos, goals[foot].quat, rest.soles[foot]) for foot in _grounded(goals, rest)]
    low = np.min(lows, axis=0)
    pieces = [(-low - height)[start:end, None] for start, end in runs(supported)]
    return height + _blended(pieces, supported)[:, 0]


def pinned(goals: dict[str, Goal], rest: Rest, planted: dict[str, Flags], fps: float, height: float) -> dict[str, Goal]:
    """The goals with planted feet held where they are on average, beside each other and sole on the floor; blended in
    between.

    A foot that passes a slower one keeps clear of the floor, in proportion to the rig's nominal root `height` (m).
    """
    out = dict(goals)
    feet = _grounded(goals, rest)
    spots = _spots({foot: goals[foot] for foot in feet}, rest, planted, BESIDE * height)
    speed = {foot: np.linalg.norm(_rate(goals[foot].pos[:, :2], fps), axis=1) for foot in feet}
    for foot in feet:
        pos, quat = goals[foot].pos, goals[foot].quat
        fix = []
        for start, end in runs(planted[foot]):
            spot = np.tile([*spots[foot, start][:2], pos[start:end, 2].mean()], (end - start, 1))
            spot[:, 2] -= _lowest(spot, quat[start:end], rest.soles[foot])
            fix.append(spot - pos[start:end])
        pos = pos + _blended(fix, planted[foot])
        swing = np.minimum(_away(planted[foot]) / (FIRMING * fps), 1.0)
        slowest = np.min([speed[other] for other in feet if other != foot], axis=0, initial=np.inf)
        passing = np.clip((speed[foot] - slowest) / PASSING, 0.0, 1.0)
        clear = CLEARANCE * height * swing * passing
        pos[:, 2] += np.maximum(clear - _lowest(pos, quat, rest.soles[foot]), 0.0)
        out[foot] = replace(goals[foot], pos=pos, firm=1 - (1 - SWING) * swing)
    return out


def _spots(goals: dict[str, Goal], rest: Rest, planted: dict[str, Flags], gap: float) -> dict[tuple[str, int], Array]:
    """Where each foot stands, (x, y, yaw), by its name and the frame from which it does: where its goal is on average,
    or as near as that is not on the other one. Of two the later gives way, and both where they are set down at once.
    """
    stands = sorted((start, end, foot) for foot in goals for start, end in runs(planted[foot]))
    spots: dict[tuple[str, int], Array] = {}
    for start, end, foot in stands:
        goal = goals[foot]
        x, y = goal.pos[start:end, :2].mean(0)
        spot = spots[foot, start] = np.array(
            [x, y, yaw_of_quat(quat_mul(goal.quat[start], quat_conj(rest.turn[foot])))]
        )
        for begun, ended, other in stands:
            if other != foot and (other, begun) in spots and ended > start:
                its = spots[other, begun]
                way = kept_apart(spot, rest.treads[foot], its, rest.treads[other], gap)
                share = 0.5 if begun == start else 1.0
                spot[:2] += share * way
                its[:2] -= (1 - share) * way
    return spots


def _rate(values: Array, fps: float) -> Array:
    return np.gradient(values, 1 / fps, axis=0) if len(values) > 1 else np.zeros_like(values)


def _away(flags: Flags) -> Array:
    """(T,) frames to the nearest one that is set, 0 where it is itself."""
    frames = np.arange(len(flags))
    away = np.full(len(flags), np.inf)
    for start, end in runs(flags):
        away = np.minimum(away, np.maximum(np.maximum(start - frames, frames - end + 1), 0))
    return away


def _grounded(goals: dict[str, Goal], rest: Rest) -> list[str]:
    return [foot for foot in rest.soles if foot in goals]


def _lowest(pos: Array, quat: Array, soles: Array) -> Array:
    points = pos[:, None] + quat_rotate(quat[:, None], soles[None])
    return points[..., 2].min(1)


def _blended(pieces: list[Array], planted: Flags) -> Array:
    """(T, k) correction: each piece (n, k) over its own stretch of `planted`, smoothly from one to the next in between.

    Before the first and after the last it stays as it is there; without any it is zero.
    """
    spans = runs(planted)
    if not spans:
        return np.zeros((len(planted), 3))
    out = np.zeros((len(planted), pieces[0].shape[1]))
    for piece, (start, end) in zip(pieces, spans, strict=True):
        out[start:end] = piece
    out[: spans[0][0]] = pieces[0][0]
    out[spans[-1][1] :] = pieces[-1][-1]
    for before, after, (_, end), (start, _) in zip(pieces, pieces[1:], spans, spans[1:], strict=False):
        u = np.arange(1, start - end + 1)[:, None] / (start - end + 1)
        out[end:start] = before[-1] + u * u * (3 - 2 * u) * (after[0] - before[-1])
    return out
