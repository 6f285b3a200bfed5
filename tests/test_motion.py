"""The type of human motion: kinematics on hand-worked poses, resampling, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from motions import skeleton, wave

from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion, Skeleton
from motiongen.rotation import axis_angle_to_quat, yaw_quat


def still(frames: int = 3) -> Motion:
    quat = np.tile([1.0, 0, 0, 0], (frames, len(SMPL_JOINTS), 1))
    return Motion(np.tile([0.0, 0, 0.9], (frames, 1)), quat, 30.0, skeleton())


def test_turned_elbow_swings_the_wrist() -> None:
    motion = still()
    quat = motion.joint_quat.copy()
    elbow, wrist = SMPL_JOINTS.index("left_elbow"), SMPL_JOINTS.index("left_wrist")
    quat[:, elbow] = axis_angle_to_quat([0, 0, 1], -np.pi / 2)  # left forearm, from pointing left to pointing forward
    bent = replace(motion, joint_quat=quat).positions()[0]
    reach = np.linalg.norm(motion.skeleton.offsets[wrist])
    assert np.allclose(bent[wrist] - bent[elbow], [reach, 0, 0], atol=1e-9)
    assert np.allclose(bent[elbow], motion.positions()[0][elbow])


def test_root_yaw_turns_everything_about_the_pelvis() -> None:
    motion = still(1)
    quat = motion.joint_quat.copy()
    quat[:, 0] = yaw_quat(np.pi / 2)
    turned = replace(motion, joint_quat=quat).positions()[0] - [0, 0, 0.9]
    rest = motion.positions()[0] - [0, 0, 0.9]
    assert np.allclose(turned, np.stack([-rest[:, 1], rest[:, 0], rest[:, 2]], axis=-1))


def test_resampling_keeps_duration_and_shared_frames() -> None:
    motion = wave(seconds=2.0, fps=30)
    double = motion.resampled(60)
    assert double.duration == pytest.approx(motion.duration)
    assert np.allclose(double.positions()[::2], motion.positions(), atol=1e-9)
    assert motion.resampled(30).positions() == pytest.approx(motion.positions())


def test_resampling_a_single_frame() -> None:
    assert len(still(1).resampled(50)) == 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"fps": 0.0}, "fps"),
        ({"fps": float("nan")}, "fps"),
        ({"root_pos": np.zeros((2, 3))}, "do not fit"),
        ({"root_pos": np.zeros((0, 3)), "joint_quat": np.zeros((0, 22, 4))}, "zero frames"),
        ({"root_pos": np.array([[0, 0, 0], [0, np.nan, 0], [0, 0, 0]])}, "frame 1 is not finite"),
        ({"joint_quat": np.full((3, 22, 4), 0.7)}, "length"),
        ({"contacts": np.zeros((3, 2), bool)}, "contacts"),
    ],
)
def test_bad_motion_is_refused(change: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        replace(still(), **change)


def test_bad_skeletons_are_refused() -> None:
    with pytest.raises(ValueError, match="parent must come before"):
        Skeleton(("a", "b"), (-1, 1), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="names"):
        Skeleton(("a", "a"), (-1, 0), np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"no joint 'tail'.*pelvis"):
        Skeleton(SMPL_JOINTS, SMPL_PARENTS, np.zeros((22, 3))).index("tail")
