"""What a motion asks of the ground, against MuJoCo's own momentum, hand calculation and the cart on a table."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from two_arm_rig import BASE_MASS, GRAVITY, HEIGHT, REACH, TIP_MASS, WEIGHT
from two_arm_rig import two_arm_motion as motion
from two_arm_rig import two_arm_rig as make_rig

from motiongen.rotation import rotvec_to_quat
from retarget.rig import load_rig
from sim.dynamics import dynamics, rates, zero_moment_point
from sim.scene import build_scene

FPS = 200.0
MASS = BASE_MASS + 2 * TIP_MASS
COM_X = 2 * TIP_MASS * REACH / MASS  # both arms reach forward
FORWARD = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])


def smooth(t: np.ndarray, joints: int) -> np.ndarray:
    """A figure that tumbles, drifts and waves all its limbs."""
    k = np.arange(joints)
    place = np.stack([0.3 * np.sin(2 * t), 0.2 * np.cos(3 * t), 1 + 0.2 * np.sin(t)], axis=1)
    turn = rotvec_to_quat(np.stack([0.8 * np.sin(2 * t), 0.5 * np.sin(3 * t + 1), 1.5 * t], axis=1))
    return np.hstack([place, turn, 0.4 * np.sin(np.outer(t, 1 + 0.1 * k) + k)])


def test_needed_force_and_moment_are_the_change_of_momentum():
    rig = load_rig("puppet")
    t = np.arange(200) / FPS
    qpos = smooth(t, len(rig.joints))
    scene = build_scene(rig, "free", qpos[0])
    found = dynamics(scene, qpos, FPS)
    model, data = scene.model, mujoco.MjData(scene.model)
    root = model.body(rig.root).id
    linear, angular, com = np.empty((200, 3)), np.empty((200, 3)), np.empty((200, 3))
    for k in range(1, 199):
        mujoco.mj_differentiatePos(model, data.qvel, 2 / FPS, qpos[k - 1], qpos[k + 1])
        # mj_differentiatePos gives the turn in the frame before; half a step later that has turned by half of it.
        half = rotvec_to_quat(data.qvel[3:6] / FPS)
        turned, local = np.empty(3), data.qvel[3:6].copy()
        mujoco.mju_rotVecQuat(turned, local, half * [1, -1, -1, -1])
        data.qvel[3:6] = turned
        data.qpos[:] = qpos[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_subtreeVel(model, data)
        com[k] = data.subtree_com[root]
        linear[k], angular[k] = scene.mass * data.subtree_linvel[root], data.subtree_angmom[root]
    inner = slice(5, -5)
    force = np.gradient(linear, 1 / FPS, axis=0) + scene.mass * GRAVITY * UP
    moment = np.gradient(angular, 1 / FPS, axis=0) + np.cross(com, force)
    np.testing.assert_allclose(found.com[inner], com[inner], atol=1e-12)
    np.testing.assert_allclose(found.force[inner], force[inner], atol=5e-3 * scene.weight)
    np.testing.assert_allclose(found.moment[inner], moment[inner], atol=5e-3 * scene.weight)


def test_at_rest_the_zero_moment_point_is_below_the_centre_of_mass(tmp_path):
    still = motion()
    found = dynamics(build_scene(make_rig(tmp_path), "free", still.qpos[0]), still.qpos, still.fps)
    np.testing.assert_allclose(found.zmp, np.tile([COM_X, 0], (len(still), 1)), atol=1e-9)
    np.testing.assert_allclose(found.com[:, :2], found.zmp, atol=1e-9)
    np.testing.assert_allclose(found.force, np.tile([0, 0, WEIGHT], (len(still), 1)), atol=1e-9)
    np.testing.assert_array_equal(found.com_speed, 0)


def test_a_cart_on_a_table(tmp_path):
    """Kajita et al. 2003: p = x − ẍ z / g for a mass that is carried level."""
    push = motion(root=lambda t: 0.5 * 1.5 * t[:, None] ** 2 * FORWARD)
    found = dynamics(build_scene(make_rig(tmp_path), "free", push.qpos[0]), push.qpos, push.fps)
    inner = slice(3, -3)
    expected = push.root_pos[inner, 0] + COM_X - 1.5 * HEIGHT / GRAVITY
    np.testing.assert_allclose(found.zmp[inner, 0], expected, atol=1e-6)
    np.testing.assert_allclose(found.force[inner, 0], MASS * 1.5, rtol=1e-6)


def test_in_flight_there_is_no_zero_moment_point(tmp_path):
    fall = motion(root=lambda t: (2 * t - 0.5 * GRAVITY * t**2)[:, None] * UP)
    found = dynamics(build_scene(make_rig(tmp_path), "free", fall.qpos[0]), fall.qpos, fall.fps)
    inner = slice(3, -3)
    np.testing.assert_allclose(found.force[inner], 0, atol=1e-6)
    assert np.isnan(found.zmp[inner]).all()


def test_the_zero_moment_point_of_a_known_force():
    force, at = np.array([[3.0, -2.0, 50.0]]), np.array([[0.2, -0.1, 0.0]])
    np.testing.assert_allclose(zero_moment_point(force, np.cross(at, force), 1.0), at[:, :2])


def test_rates_of_a_steady_turn_and_of_the_shortest_motions():
    t = np.arange(30) / FPS
    turn = rotvec_to_quat(t[:, None] * np.array([0.3, -2.0, 1.0]))
    turn[10:] *= -1  # the same rotations
    velocity, acceleration = rates(np.hstack([np.zeros((30, 3)), turn, 0.5 * t[:, None] ** 2]), FPS)
    np.testing.assert_allclose(velocity[:, 3:6], np.tile([0.3, -2.0, 1.0], (30, 1)), atol=1e-9)
    np.testing.assert_allclose(acceleration[2:-2, 6], 1.0, atol=1e-9)
    np.testing.assert_allclose(acceleration[:, 3:6], 0, atol=1e-6)
    for frames in (1, 2, 3):
        for rate in rates(np.tile([0, 0, 1, 1, 0, 0, 0, 0.2], (frames, 1)).astype(float), FPS):
            np.testing.assert_array_equal(rate, np.zeros((frames, 7)))


def test_a_stand_has_no_balance(tmp_path):
    still = motion()
    with pytest.raises(ValueError, match="a rig on a stand has no balance; use mount free or hung"):
        dynamics(build_scene(make_rig(tmp_path), "stand", still.qpos[0]), still.qpos, still.fps)
