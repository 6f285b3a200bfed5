"""Rotations against scipy's, which nothing at run time uses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motiongen import rotation as r


@pytest.fixture
def turns() -> Rotation:
    return Rotation.random(500, rng=np.random.default_rng(0))


def wxyz(turns: Rotation) -> np.ndarray:
    return turns.as_quat(scalar_first=True)


def same(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Whether quaternions say the same rotation, whatever their sign."""
    return np.abs(np.abs(np.sum(a * b, axis=-1)) - 1) < 1e-12


def test_product_and_rotation(turns: Rotation) -> None:
    q = wxyz(turns)
    v = np.random.default_rng(1).normal(size=(500, 3))
    assert same(r.quat_mul(q[:250], q[250:]), wxyz(turns[:250] * turns[250:])).all()
    assert np.allclose(r.quat_rotate(q, v), turns.apply(v), atol=1e-12)
    assert (r.cross(q[:, None, 1:], v) == np.cross(q[:, None, 1:], v)).all()
    assert same(r.quat_conj(q), wxyz(turns.inv())).all()


def test_matrices_and_6d(turns: Rotation) -> None:
    q, m = wxyz(turns), turns.as_matrix()
    assert np.allclose(r.quat_to_matrix(q), m, atol=1e-12)
    assert same(r.matrix_to_quat(m), q).all()
    assert np.allclose(r.matrix_from_6d(r.matrix_to_6d(m) * 3.0), m, atol=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_half_turns_have_a_quaternion(axis: int) -> None:
    """The trace is −1 there: the form of the conversion that divides by it would fail."""
    m = -np.eye(3)
    m[axis, axis] = 1.0
    assert np.allclose(np.abs(r.matrix_to_quat(m)), np.eye(4)[axis + 1])


def test_rotation_vectors(turns: Rotation) -> None:
    assert np.allclose(r.quat_to_rotvec(wxyz(turns)), turns.as_rotvec(), atol=1e-10)
    assert same(r.rotvec_to_quat(turns.as_rotvec()), wxyz(turns)).all()
    assert np.allclose(r.rotvec_to_quat(np.zeros(3)), [1, 0, 0, 0])


def test_slerp_is_half_way() -> None:
    a, b = r.yaw_quat(0.2), r.yaw_quat(1.0)
    assert same(r.slerp(a, -b, 0.5), r.yaw_quat(0.6))


def test_yaw_ignores_pitch() -> None:
    pitched = r.quat_mul(r.yaw_quat(0.7), r.axis_angle_to_quat([0, 1, 0], 1.2))
    assert r.yaw_of_quat(pitched) == pytest.approx(0.7)


def test_signs_become_continuous() -> None:
    q = r.yaw_quat(np.linspace(0, 3, 20))
    flipped = q * np.where(np.arange(20) % 3 == 0, -1.0, 1.0)[:, None]
    out = r.quat_continuous(flipped)
    assert (np.sum(out[1:] * out[:-1], axis=-1) > 0).all()


def test_zero_quaternion_is_refused() -> None:
    with pytest.raises(ValueError, match="length 0"):
        r.quat_normalize([0, 0, 0, 0])
