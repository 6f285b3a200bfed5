"""Loops over springs and over the equations of a step, which are sparse, compiled by Numba as those of `loops.py`.

A curvature (T, nv, nv) is the lower half of a symmetric matrix for each frame; `across` (T, 1 + REACH, nv) is what ties
each unknown to itself in that frame and in those after it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.rotation import Array
from retarget.contacts import Flags
from retarget.kinematics import ROOT_DOFS, Indices
from retarget.loops import compiled

Ways = NDArray[np.int8]

ROOT = ROOT_DOFS


@compiled
def add_springs(
    curvature: Array, gradient: Array, frame: Indices, rows: Array, room: Array, pushing: Flags, stiff: float
) -> None:
    """Add ½ `stiff` (row · x + room)² of those that are `pushing` (n,), of n springs with `rows` (n, nv) and `room`
    (n,), to the lower half of the curvature (T, nv, nv) and to the gradient (T, nv) of its `frame` (n,).
    """
    for n in range(len(frame)):
        if not pushing[n]:
            continue
        t = frame[n]
        for d in range(rows.shape[1]):
            if rows[n, d] != 0:
                pull = stiff * rows[n, d]
                gradient[t, d] += pull * room[n]
                for e in range(d + 1):
                    curvature[t, d, e] += pull * rows[n, e]


@compiled
def after(frame: Indices, rows: Array, room: Array, step: Array) -> Array:
    """(n,) `room` (n,) after `step` (T, nv): `rows` (n, nv) more for each unit of it at `frame` (n,)."""
    out = room.copy()
    for n in range(len(frame)):
        for d in range(rows.shape[1]):
            out[n] += rows[n, d] * step[frame[n], d]
    return out


@compiled
def paced(values: Array, step: Array) -> Array:
    """`values` (3, T, nj) after `step` (T, nj): of it, and of its first and second differences from each frame on."""
    out = values.copy()
    frames = len(step)
    for t in range(frames):
        for j in range(step.shape[1]):
            out[0, t, j] += step[t, j]
            if t + 1 < frames:
                out[1, t, j] += step[t + 1, j] - step[t, j]
            if t + 2 < frames:
                out[2, t, j] += step[t + 2, j] - 2 * step[t + 1, j] + step[t, j]
    return out


@compiled
def hasty(values: Array, most: Array) -> Ways:
    """(3, T, nj): 1 where one of `values` (3, T, nj) is above `most` (3, nj), −1 where it is below the opposite."""
    out = np.zeros(values.shape, np.int8)
    for n in range(3):
        for t in range(values.shape[1]):
            for j in range(values.shape[2]):
                out[n, t, j] = (values[n, t, j] > most[n, j]) - (values[n, t, j] < -most[n, j])
    return out


@compiled
def amiss(values: Array, most: Array, ways: Ways, share: float) -> bool:
    """Whether one of `values` is beyond `most` by more than a `share` of it and `ways` does not say so, or does, and it
    is within by more.
    """
    for n in range(3):
        for t in range(values.shape[1]):
            for j in range(values.shape[2]):
                value, limit, way = values[n, t, j], most[n, j], ways[n, t, j]
                if way == 0 and abs(value) > (1 + share) * limit:
                    return True
                if way != 0 and way * value < (1 - share) * limit:
                    return True
    return False


@compiled
def strain(values: Array, most: Array, ways: Ways, stiff: Array) -> float:
    """The sum of squares of what `values` are beyond `most` the way that `ways` says, times `stiff` (3,)."""
    out = 0.0
    for n in range(3):
        for t in range(values.shape[1]):
            for j in range(values.shape[2]):
                if ways[n, t, j] != 0:
                    out += stiff[n] * (ways[n, t, j] * values[n, t, j] - most[n, j]) ** 2
    return out


@compiled
def hold(across: Array, downhill: Array, values: Array, most: Array, ways: Ways, stiff: Array) -> None:
    """Add half of `strain` to what ties unknowns to themselves, `across` (T, 1 + REACH, nv), and `downhill` (T, nv)."""
    stencils = ((1.0, 0.0, 0.0), (-1.0, 1.0, 0.0), (1.0, -2.0, 1.0))
    for n in range(3):
        stencil = stencils[n]
        for t in range(values.shape[1]):
            for j in range(values.shape[2]):
                way = ways[n, t, j]
                if way == 0:
                    continue
                push = stiff[n] * (values[n, t, j] - way * most[n, j])
                for i in range(n + 1):
                    downhill[t + i, ROOT + j] -= stencil[i] * push
                    for k in range(i + 1):
                        across[t + k, i - k, ROOT + j] += stiff[n] * stencil[i] * stencil[k]


@compiled
def times(curvature: Array, step: Array) -> Array:
    """(T, nv) the symmetric matrices, of which `curvature` (T, nv, nv) has the lower halves, times `step` (T, nv)."""
    out = np.zeros_like(step)
    for t in range(len(step)):
        for d in range(step.shape[1]):
            for e in range(d):
                out[t, d] += curvature[t, d, e] * step[t, e]
                out[t, e] += curvature[t, d, e] * step[t, d]
            out[t, d] += curvature[t, d, d] * step[t, d]
    return out


@compiled
def parts(curvature: Array) -> Indices:
    """(nv,) the first of the unknowns that each is tied to by the lower half of `curvature` (T, nv, nv) in any frame,
    directly or by way of others.
    """
    size = curvature.shape[1]
    tied, out = np.zeros((size, size), np.bool_), np.arange(size)
    for t in range(len(curvature)):
        for d in range(size):
            for e in range(d):
                tied[d, e] |= curvature[t, d, e] != 0
    for d in range(size):
        for e in range(d):
            if tied[d, e] and out[e] != out[d]:
                one, other = min(out[d], out[e]), max(out[d], out[e])
                for i in range(size):
                    if out[i] == other:
                        out[i] = one
    return out


@compiled
def add_differences(across: Array, downhill: Array, stencil: Array, weight: Array, value: Array) -> None:
    """Add ½ `weight` (D x + `value`)² to what ties unknowns to themselves, `across` (T, 1 + REACH, n), and to
    `downhill` (T, n): D is `stencil` (k,) over neighbouring frames, `value` (T − k + 1, n), and `weight` as that or of
    one frame.
    """
    for t in range(len(value)):
        for d in range(value.shape[1]):
            w = weight[t if len(weight) > 1 else 0, d]
            if w == 0:
                continue
            for i in range(len(stencil)):
                pull = stencil[i] * w
                downhill[t + i, d] -= pull * value[t, d]
                for j in range(i + 1):
                    across[t + j, i - j, d] += pull * stencil[j]


@compiled
def band_of(curvature: Array, across: Array, damping: Array, known: int, part: Indices) -> Array:
    """LAPACK's lower band (k · frames, REACH · k + 1) of the unknowns `part` (k,) from the frame `known` on.

    `across` (T, 1 + REACH, nv) ties each unknown to itself in the frames after, `damping` (T, nv) is added to the
    diagonal.
    """
    frames, size, reach = len(curvature) - known, len(part), across.shape[1] - 1
    band = np.zeros((frames * size, reach * size + 1))
    for t in range(frames):
        for j in range(size):
            row, d = band[t * size + j], part[j]
            for i in range(j, size):
                row[i - j] = curvature[known + t, part[i], d]
            row[0] += damping[known + t, d]
            for way in range(reach + 1):
                row[way * size] += across[known + t, way, d]
    return band
