"""Features: there and back, mirrored, and meaning what their table says."""

from dataclasses import replace

import numpy as np
import pytest
from motions import skeleton, walk, wave

from motiongen.features import (
    CONTACTS,
    HEIGHT,
    PLANAR,
    YAW,
    features_to_motion,
    find_contacts,
    mirror,
    motion_to_features,
)
from motiongen.motion import SMPL_JOINTS, Motion
from motiongen.rotation import quat_mul, quat_rotate, yaw_quat


def placed(motion: Motion, yaw: float, where: tuple[float, float]) -> Motion:
    """The motion somewhere else in the world, facing elsewhere."""
    turn = yaw_quat(yaw)
    quat = motion.joint_quat.copy()
    quat[:, 0] = quat_mul(turn, quat[:, 0])
    return replace(motion, root_pos=quat_rotate(turn, motion.root_pos) + np.array([*where, 0.0]), joint_quat=quat)


def circling() -> Motion:
    """Somebody who walks one metre a second and turns half a radian a second, in closed form."""
    base = walk(seconds=3.0)
    t = np.arange(len(base)) / base.fps
    quat = base.joint_quat.copy()
    quat[:, 0] = quat_mul(yaw_quat(0.5 * t), np.tile([1.0, 0, 0, 0], (len(t), 1)))
    path = np.stack([np.sin(0.5 * t) / 0.5, (1 - np.cos(0.5 * t)) / 0.5, np.full(len(t), 0.9)], axis=1)
    return replace(base, root_pos=path, joint_quat=quat)


def test_there_and_back() -> None:
    motion = circling()
    back = features_to_motion(motion_to_features(motion), motion.skeleton)
    assert np.abs(back.positions() - motion.positions()).max() < 1e-4


def test_yaw_rate_and_speed_are_what_was_walked() -> None:
    features = motion_to_features(circling())
    assert features[:, YAW] == pytest.approx(0.5, abs=1e-5)
    assert features[:, PLANAR][:, 0] == pytest.approx(1.0, abs=1e-3)
    assert features[:, HEIGHT] == pytest.approx(0.9)


def test_where_somebody_stands_and_faces_does_not_matter() -> None:
    motion = wave(seconds=2.0)
    moved = placed(motion, 2.0, (3.0, -1.0))
    assert np.abs(motion_to_features(moved) - motion_to_features(motion)).max() < 1e-4


def test_mirror_reflects_the_joints() -> None:
    features = motion_to_features(circling())
    assert (mirror(mirror(features)) == features).all()
    motion, other = features_to_motion(features, skeleton()), features_to_motion(mirror(features), skeleton())
    swapped = [n.replace("left", "?").replace("right", "left").replace("?", "right") for n in SMPL_JOINTS]
    order = [SMPL_JOINTS.index(n) for n in swapped]
    reflected = motion.positions()[:, order] * [1, -1, 1]
    assert np.abs(other.positions() - reflected).max() < 2e-3  # the test skeleton is symmetric


def test_contacts_of_a_foot_that_slides_or_lifts() -> None:
    motion = wave(seconds=2.0)
    assert find_contacts(motion).all()
    t = np.arange(len(motion)) / motion.fps
    slid = replace(motion, root_pos=motion.root_pos + np.outer(t, [0.3, 0, 0]))
    assert not find_contacts(slid).any()
    slow = replace(motion, root_pos=motion.root_pos + np.outer(t, [0.1, 0, 0]))
    assert find_contacts(slow).all()
    lifted = replace(motion, root_pos=motion.root_pos + np.array([0, 0, 0.15]))
    assert not find_contacts(lifted).any()
    assert motion_to_features(motion)[:, CONTACTS].all()


def test_another_skeleton_is_refused() -> None:
    from motiongen.motion import Skeleton

    one = Motion(np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1, 1)), 30.0, Skeleton(("x",), (-1,), np.zeros((1, 3))))
    with pytest.raises(ValueError, match="22 joints"):
        motion_to_features(one)
