"""The loops over frames, bodies and degrees of freedom in which solving spends its time, compiled by Numba. (Those over
springs and equations are in `sparse.py`.)

Compiled when first called, which takes seconds, and kept on disk from then on. `place` (T, nbody, 3), `turn` (T, nbody,
4), `matrix` (T, nbody, 3, 3), `axis` and `anchor` (T, nv, 3) are as `kinematics.Poses` has them. A degree of freedom
that turns about `axis` through `anchor` moves a point by axis × (point − anchor); the first three slide along theirs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit

from motiongen.rotation import Array
from retarget.kinematics import ROOT_DOFS, SLIDES, Bones, Indices

F = TypeVar("F", bound=Callable[..., Any])

ROOT = ROOT_DOFS
TINY = 1e-9  # the sine of half an angle that has no direction


def compiled(function: F) -> F:
    """`function` as machine code, kept on disk where there is a place for it."""
    try:
        return cast(F, njit(cache=True, nogil=True)(function))
    except RuntimeError:  # no folder that may be written to
        return cast(F, njit(nogil=True)(function))


def kept() -> bool:
    """Whether there is machine code on disk, so that nothing waits for it to be compiled."""
    return any(Path(differences.stats.cache_path).glob("loops.differences-*.nbc"))  # type: ignore[attr-defined]


@compiled
def _times(a: Array, b: Array) -> tuple[float, float, float, float]:
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@compiled
def _normalise(q: Array) -> None:
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for k in range(4):
        q[k] /= length


@compiled
def _fill_matrix(q: Array, out: Array) -> None:
    w, x, y, z = q[0], q[1], q[2], q[3]
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@compiled
def _rotated(m: Array, v: Array) -> tuple[float, float, float]:
    return (
        m[0, 0] * v[0] + m[0, 1] * v[1] + m[0, 2] * v[2],
        m[1, 0] * v[0] + m[1, 1] * v[1] + m[1, 2] * v[2],
        m[2, 0] * v[0] + m[2, 1] * v[1] + m[2, 2] * v[2],
    )


@compiled
def _fill_rotvec(w: float, x: float, y: float, z: float, out: Array) -> None:
    """Axis times angle, the short way, of a unit quaternion."""
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine < TINY else 2 * math.atan2(sine, abs(w)) / sine
    if w < 0:
        scale = -scale
    out[0], out[1], out[2] = scale * x, scale * y, scale * z


@compiled
def forward(bones: Bones, qpos: Array) -> tuple[Array, Array, Array, Array, Array]:
    """`place`, `turn`, `matrix`, `axis` and `anchor` of the configurations `qpos` (T, nq): what mj_kinematics does."""
    frames, bodies, dofs = len(qpos), len(bones.parent), len(bones.rest)
    place, turn = np.zeros((frames, bodies, 3)), np.zeros((frames, bodies, 4))
    matrix = np.zeros((frames, bodies, 3, 3))
    axis, anchor = np.zeros((frames, dofs, 3)), np.zeros((frames, dofs, 3))
    hinge = np.empty(4)
    for t in range(frames):
        turn[t, 0, 0] = 1.0
        _fill_matrix(turn[t, 0], matrix[t, 0])
        for b in range(1, bodies):
            above, first, count = bones.parent[b], bones.first[b], bones.many[b]
            p, q, m = place[t, b], turn[t, b], matrix[t, b]
            if count == ROOT:
                for k in range(3):
                    p[k] = qpos[t, k]
                for k in range(4):
                    q[k] = qpos[t, 3 + k]
                _normalise(q)
                _fill_matrix(q, m)
                for k in range(3):
                    axis[t, k, k] = 1.0
                    for i in range(3):
                        axis[t, SLIDES + k, i] = m[i, k]
                        anchor[t, k, i] = anchor[t, SLIDES + k, i] = p[i]
                continue
            x, y, z = _rotated(matrix[t, above], bones.offset[b])
            p[0], p[1], p[2] = place[t, above, 0] + x, place[t, above, 1] + y, place[t, above, 2] + z
            q[0], q[1], q[2], q[3] = _times(turn[t, above], bones.turn[b])
            _fill_matrix(q, m)
            for d in range(first, first + count):
                x, y, z = _rotated(m, bones.anchor[d])
                a = anchor[t, d]
                a[0], a[1], a[2] = p[0] + x, p[1] + y, p[2] + z
                axis[t, d, 0], axis[t, d, 1], axis[t, d, 2] = _rotated(m, bones.axis[d])
                half = 0.5 * (qpos[t, d + 1] - bones.rest[d])
                hinge[0], sine = math.cos(half), math.sin(half)
                for k in range(3):
                    hinge[1 + k] = sine * bones.axis[d, k]
                q[0], q[1], q[2], q[3] = _times(q, hinge)
                _fill_matrix(q, m)
                x, y, z = _rotated(m, bones.anchor[d])
                p[0], p[1], p[2] = a[0] - x, a[1] - y, a[2] - z
    return place, turn, matrix, axis, anchor


@compiled
def points_on(place: Array, matrix: Array, body: Indices, spot: Array) -> Array:
    """(T, k, 3) where the points `spot` (1 or T, k, 3) of the bodies `body` (k,) are in the world."""
    out = np.empty((len(place), len(body), 3))
    for t in range(len(place)):
        of = t if len(spot) > 1 else 0
        for k in range(len(body)):
            b = body[k]
            x, y, z = _rotated(matrix[t, b], spot[of, k])
            out[t, k, 0], out[t, k, 1], out[t, k, 2] = place[t, b, 0] + x, place[t, b, 1] + y, place[t, b, 2] + z
    return out


@compiled
def turns_off(turn: Array, body: Indices, base: Indices, wanted: Array) -> Array:
    """(T, k, 3) rotation vectors in the world from `wanted` (T, k, 4), as seen from `base` (k,), to the turn of `body`
    (k,).
    """
    out, back = np.empty((len(turn), len(body), 3)), np.empty(4)
    for t in range(len(turn)):
        for k in range(len(body)):
            w, x, y, z = _times(turn[t, base[k]], wanted[t, k])
            back[0], back[1], back[2], back[3] = w, -x, -y, -z
            w, x, y, z = _times(turn[t, body[k]], back)
            _fill_rotvec(w, x, y, z, out[t, k])
    return out


@compiled
def _carrying(carried: Array) -> tuple[Indices, Indices]:
    """Which degrees of freedom carry each of k things, `carried` (k, nv): (k, nv), the first `many` (k,) of them."""
    which, many = np.zeros(carried.shape, np.intp), np.zeros(len(carried), np.intp)
    for k in range(len(carried)):
        for d in range(carried.shape[1]):
            if carried[k, d] != 0:
                which[k, many[k]] = d
                many[k] += 1
    return which, many


@compiled
def _fill_velocity(axis: Array, anchor: Array, d: int, point: Array, out: Array) -> None:
    if d < SLIDES:
        out[0], out[1], out[2] = axis[d, 0], axis[d, 1], axis[d, 2]
        return
    x, y, z = point[0] - anchor[d, 0], point[1] - anchor[d, 1], point[2] - anchor[d, 2]
    out[0] = axis[d, 1] * z - axis[d, 2] * y
    out[1] = axis[d, 2] * x - axis[d, 0] * z
    out[2] = axis[d, 0] * y - axis[d, 1] * x


@compiled
def add_pulls(
    axis: Array,
    anchor: Array,
    carried: Array,
    points: Array,
    off: Array,
    weight: Array,
    curvature: Array,
    gradient: Array,
) -> None:
    """Add ½ `weight` (T, k) |`off` (T, k, 3)|² of k things, which each degree of freedom carries by `carried` (k, nv),
    to the lower half of `curvature` (T, nv, nv) and to `gradient` (T, nv).

    They move as the `points` (T, k, 3) do; without any (0 frames) they turn.
    """
    which, many = _carrying(carried)
    rows = np.empty((axis.shape[1], 3))
    for t in range(len(off)):
        for k in range(len(carried)):
            w = weight[t, k]
            for i in range(many[k]):
                d = which[k, i]
                if len(points):
                    _fill_velocity(axis[t], anchor[t], d, points[t, k], rows[i])
                for c in range(3):
                    if not len(points):
                        rows[i, c] = 0.0 if d < SLIDES else axis[t, d, c]
                    rows[i, c] *= carried[k, d]
                x, y, z = w * rows[i, 0], w * rows[i, 1], w * rows[i, 2]
                gradient[t, d] += x * off[t, k, 0] + y * off[t, k, 1] + z * off[t, k, 2]
                for j in range(i + 1):
                    curvature[t, d, which[k, j]] += x * rows[j, 0] + y * rows[j, 1] + z * rows[j, 2]


@compiled
def along(axis: Array, anchor: Array, frame: Indices, point: Array, way: Array, carried: Array) -> Array:
    """(n, nv) velocities of `point` (n, 3) along `way` (n, 3) at `frame` (n,) for a unit rate of each degree of
    freedom, times `carried` (n, nv).
    """
    out, rate = np.zeros(carried.shape), np.empty(3)
    for n in range(len(frame)):
        t = frame[n]
        for d in range(carried.shape[1]):
            if carried[n, d] != 0:
                _fill_velocity(axis[t], anchor[t], d, point[n], rate)
                out[n, d] = carried[n, d] * (rate[0] * way[n, 0] + rate[1] * way[n, 1] + rate[2] * way[n, 2])
    return out


@compiled
def moved(qpos: Array, step: Array) -> Array:
    """`qpos` (T, 7 + nj) after `step` (T, nv): what mj_integratePos does, over all frames."""
    out, spin = np.empty_like(qpos), np.empty(4)
    for t in range(len(qpos)):
        for k in range(3):
            out[t, k] = qpos[t, k] + step[t, k]
        for d in range(ROOT, step.shape[1]):
            out[t, d + 1] = qpos[t, d + 1] + step[t, d]
        x, y, z = step[t, 3], step[t, 4], step[t, 5]
        angle = math.sqrt(x * x + y * y + z * z)
        share = 0.5 if angle < TINY else math.sin(0.5 * angle) / angle
        spin[0], spin[1], spin[2], spin[3] = math.cos(0.5 * angle), share * x, share * y, share * z
        q = out[t, 3:7]
        q[0], q[1], q[2], q[3] = _times(qpos[t, 3:7], spin)
        _normalise(q)
    return out


@compiled
def differences(qpos: Array) -> Array:
    """(T − 1, nv) from one frame to the next: what mj_differentiatePos does for a step of 1 s."""
    out, back = np.empty((max(len(qpos) - 1, 0), qpos.shape[1] - 1)), np.empty(4)
    for t in range(len(out)):
        for k in range(3):
            out[t, k] = qpos[t + 1, k] - qpos[t, k]
            back[1 + k] = -qpos[t, 4 + k]
        for d in range(ROOT, out.shape[1]):
            out[t, d] = qpos[t + 1, d + 1] - qpos[t, d + 1]
        back[0] = qpos[t, 3]
        w, x, y, z = _times(back, qpos[t + 1, 3:7])
        _fill_rotvec(w, x, y, z, out[t, SLIDES:ROOT])
    return out
