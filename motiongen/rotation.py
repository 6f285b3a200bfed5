"""Rotations over numpy arrays: unit quaternions `w x y z`, matrices, axis-angle and the 6-d form.

Every function works on the last axis (or last two, for matrices) and broadcasts over the rest. Quaternions rotate
vectors from the child frame into the parent frame. scipy has the same formulas, but importing it costs more than all
of this project's other light imports together, and every stage needs a few of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

SMALL = 1000  # numbers, below which the calls of numpy cost more than what they compute
# What each pair of parts adds to the parts of the product: the rules i² = j² = k² = ijk = −1, and those of cross.
_TIMES: Array = np.zeros((4, 4, 4))
_CROSS: Array = np.zeros((3, 3, 3))
_TIMES[0, range(4), range(4)] = _TIMES[range(4), 0, range(4)] = 1.0
_TIMES[range(1, 4), range(1, 4), 0] = -1.0
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_i, _j, _k], _CROSS[_j, _i, _k] = 1.0, -1.0
_TIMES[1:, 1:, 1:] = _CROSS
_TIMES, _CROSS = _TIMES.reshape(16, 4), _CROSS.reshape(9, 3)


def quat_mul(a: ArrayLike, b: ArrayLike) -> Array:
    """Hamilton product `a ⊗ b` of quaternions (..., 4): first `b`, then `a`."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    if max(a.size, b.size) < SMALL:
        pairs = a[..., :, None] * b[..., None, :]
        return pairs.reshape(*pairs.shape[:-2], 16) @ _TIMES
    aw, ax, ay, az = (a[..., i] for i in range(4))
    bw, bx, by, bz = (b[..., i] for i in range(4))
    first = aw * bw - ax * bx - ay * by - az * bz
    out = np.empty((*first.shape, 4))
    out[..., 0] = first
    out[..., 1] = aw * bx + ax * bw + ay * bz - az * by
    out[..., 2] = aw * by - ax * bz + ay * bw + az * bx
    out[..., 3] = aw * bz + ax * by - ay * bx + az * bw
    return out


def quat_conj(q: ArrayLike) -> Array:
    """Conjugate (the inverse, for unit quaternions) of (..., 4)."""
    return np.asarray(q, float) * np.array([1.0, -1.0, -1.0, -1.0])


def quat_rotate(q: ArrayLike, v: ArrayLike) -> Array:
    """Rotate vectors (..., 3) by unit quaternions (..., 4)."""
    q, v = np.asarray(q, float), np.asarray(v, float)
    u, w = q[..., 1:], q[..., :1]
    t = 2.0 * cross(u, v)
    return v + w * t + cross(u, t)


def cross(a: Array, b: Array) -> Array:
    """What np.cross does with (..., 3), several times as fast."""
    if max(a.size, b.size) < SMALL:
        pairs = a[..., :, None] * b[..., None, :]
        return pairs.reshape(*pairs.shape[:-2], 9) @ _CROSS
    ax, ay, az = (a[..., i] for i in range(3))
    bx, by, bz = (b[..., i] for i in range(3))
    first = ay * bz - az * by
    out = np.empty((*first.shape, 3))
    out[..., 0] = first
    out[..., 1] = az * bx - ax * bz
    out[..., 2] = ax * by - ay * bx
    return out


def quat_normalize(q: ArrayLike) -> Array:
    """Scale (..., 4) to unit length; raises ValueError where the length is under 1e-8."""
    q = np.asarray(q, float)
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    if np.any(norm < 1e-8):
        raise ValueError("a quaternion has length 0: it says no rotation")
    return q / norm


def quat_continuous(q: ArrayLike) -> Array:
    """Flip signs along axis 0 of (T, ..., 4) so that neighbours lie on the same half-sphere."""
    q = np.array(q, float)
    flip = np.sum(q[1:] * q[:-1], axis=-1) < 0
    sign = np.where(np.cumsum(flip, axis=0) % 2 == 1, -1.0, 1.0)
    q[1:] *= sign[..., None]
    return q


def axis_angle_to_quat(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Rotation by `angle` (...,) in radians about the unit `axis` (..., 3)."""
    axis, half = np.asarray(axis, float), 0.5 * np.asarray(angle, float)[..., None]
    out = np.empty((*np.broadcast_shapes(axis.shape[:-1], half.shape[:-1]), 4))
    out[..., :1] = np.cos(half)
    out[..., 1:] = np.sin(half) * axis
    return out


def quat_to_rotvec(q: ArrayLike) -> Array:
    """Axis times angle (..., 3) in radians, angle in [0, π], of unit quaternions (..., 4)."""
    q = np.asarray(q, float)
    q = np.where(q[..., :1] < 0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    return q[..., 1:] * np.where(sine < 1e-9, 2.0, angle / np.maximum(sine, 1e-9))


def rotvec_to_quat(v: ArrayLike) -> Array:
    """Unit quaternions (..., 4) of axis times angle (..., 3) in radians."""
    v = np.asarray(v, float)
    angle = np.linalg.norm(v, axis=-1)
    return axis_angle_to_quat(v / np.maximum(angle, 1e-12)[..., None], angle)


def quat_to_matrix(q: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(q, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(r, axis=-1) for r in rows], axis=-2)


def matrix_to_quat(m: ArrayLike) -> Array:
    """Unit quaternions (..., 4), w ≥ 0, of rotation matrices (..., 3, 3).

    Of the four forms of the conversion the one with the largest divisor is taken (Shepperd 1978).
    """
    m = np.asarray(m, float)
    d = np.diagonal(m, axis1=-2, axis2=-1)
    trace = d.sum(-1)
    a, b, c = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 0, 1] + m[..., 1, 0], m[..., 0, 2] + m[..., 2, 0], m[..., 1, 2] + m[..., 2, 1]
    x2, y2, z2 = 2 * d[..., 0] - trace, 2 * d[..., 1] - trace, 2 * d[..., 2] - trace
    forms = np.stack(
        [
            np.stack([1 + trace, a, b, c], axis=-1),
            np.stack([a, 1 + x2, xy, xz], axis=-1),
            np.stack([b, xy, 1 + y2, yz], axis=-1),
            np.stack([c, xz, yz, 1 + z2], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(np.stack([trace, x2, y2, z2], axis=-1), axis=-1)
    q = np.take_along_axis(forms, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def matrix_to_6d(m: ArrayLike) -> Array:
    """First two columns of (..., 3, 3), one after the other: (..., 6) (Zhou et al. 2019)."""
    m = np.asarray(m, float)
    return np.concatenate([m[..., 0], m[..., 1]], axis=-1)


def matrix_from_6d(d: ArrayLike) -> Array:
    """Rotation matrices (..., 3, 3) of (..., 6) by Gram-Schmidt; any non-degenerate 6 numbers will do."""
    d = np.asarray(d, float)
    x = d[..., :3] / np.linalg.norm(d[..., :3], axis=-1, keepdims=True)
    y = d[..., 3:] - np.sum(x * d[..., 3:], axis=-1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def yaw_of_quat(q: ArrayLike) -> Array:
    """Angle (...,) about world z of the direction in which the frame's y axis (left) points, less a right angle.

    Taken from the left axis, so that pitching the frame forward, as in a bow, does not turn it.
    """
    left = quat_rotate(q, [0.0, 1.0, 0.0])
    return np.arctan2(-left[..., 0], left[..., 1])


def yaw_quat(yaw: ArrayLike) -> Array:
    """Rotation (..., 4) about world z by `yaw` (...,) radians."""
    return axis_angle_to_quat([0.0, 0.0, 1.0], yaw)


def slerp(a: ArrayLike, b: ArrayLike, u: ArrayLike) -> Array:
    """Shortest-arc interpolation from unit quaternions `a` to `b` (..., 4) at `u` (...,) in [0, 1]."""
    a = np.asarray(a, float)
    step = quat_to_rotvec(quat_mul(quat_conj(a), b))
    return quat_mul(a, rotvec_to_quat(step * np.asarray(u, float)[..., None]))


def shortest_arc(a: ArrayLike, b: ArrayLike) -> Array:
    """Rotation (..., 4) that takes unit vectors `a` to `b` (..., 3); opposite ones turn about any axis across `a`."""
    a, b = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float))
    q = np.concatenate([1 + np.sum(a * b, axis=-1, keepdims=True), np.cross(a, b)], axis=-1)
    opposite = q[..., 0] < 1e-9
    if opposite.any():
        across = np.eye(3)[np.abs(a[opposite]).argmin(-1)]
        q[opposite] = np.concatenate([np.zeros((opposite.sum(), 1)), np.cross(a[opposite], across)], axis=1)
    return quat_normalize(q)
