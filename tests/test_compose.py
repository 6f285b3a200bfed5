"""Composition: what is kept exactly, what is carried how, and seams without slide, jumps or spikes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motions import skeleton, squat, stand, turned, walk, wave

from motiongen.compose.leg_ik import with_ankles
from motiongen.compose.motions import clearance, looped, overlay, sequence, sharpest
from motiongen.compose.parts import PARTS, joints_of
from motiongen.compose.seams import find_seam, on_skeleton
from motiongen.gestures.catalogue import perform
from motiongen.measure.clip import measure
from motiongen.motion import SMPL_JOINTS, Motion
from motiongen.rotation import axis_angle_to_quat, quat_conj, quat_mul, quat_rotate, quat_to_rotvec

ANKLES = [SMPL_JOINTS.index("left_ankle"), SMPL_JOINTS.index("right_ankle")]
CHEST = SMPL_JOINTS.index("spine3")
LEFT, UP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def swaying(seconds: float = 6) -> Motion:
    """A walk whose pelvis turns by ±9° and rolls by ±5° with every stride of a second."""
    clip = walk(seconds=seconds)
    phase = np.sin(2 * np.pi * np.arange(len(clip)) / clip.fps)
    quat = clip.joint_quat.copy()
    sway = quat_mul(axis_angle_to_quat(UP, 0.16 * phase), axis_angle_to_quat([1.0, 0, 0], 0.09 * phase))
    quat[:, 0] = quat_mul(sway, quat[:, 0])
    return replace(clip, joint_quat=quat)


def angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(quat_to_rotvec(quat_mul(quat_conj(a), b)), axis=-1)


# ---- Parts


def test_parts_are_the_body_once() -> None:
    for whole, pieces in {
        "whole_body": ("lower_body", "upper_body"),
        "upper_body": ("torso", "head", "arms"),
        "arms": ("left_arm", "right_arm"),
        "legs": ("left_leg", "right_leg"),
    }.items():
        assert sorted(joint for piece in pieces for joint in PARTS[piece]) == list(PARTS[whole])
    assert {SMPL_JOINTS[j] for j in PARTS["right_arm"]} == {
        f"right_{n}" for n in ("collar", "shoulder", "elbow", "wrist")
    }
    assert joints_of(("head", "head")) == PARTS["head"]


# ---- One on another


def test_root_legs_and_the_other_arm_stay_as_they_are() -> None:
    lower, upper = walk(seconds=5), wave("right", seconds=5)
    out = overlay(lower, upper, ("right_arm",))
    others = sorted(set(range(len(SMPL_JOINTS))) - set(PARTS["right_arm"]))
    np.testing.assert_allclose(out.joint_quat[:, others], lower.joint_quat[:, others], atol=1e-12)
    np.testing.assert_array_equal(out.root_pos, lower.root_pos)
    arm = list(PARTS["right_arm"])
    assert angle(out.joint_quat[:, arm], upper.joint_quat[:, arm]).max() < 1e-6
    here, waved = measure(out), measure(upper)
    assert (here.right_waves, here.left_waves, here.steps) == (waved.right_waves, 0, measure(lower).steps)


def test_the_sway_of_the_pelvis_does_not_reach_the_chest() -> None:
    lower, upper = swaying(), wave("right", seconds=6)
    out = overlay(lower, upper, ("upper_body",))
    inside = slice(45, -45)  # the average over strides is cut off at the ends
    assert angle(lower.global_quat()[inside, 0], lower.global_quat()[45, 0]).max() > 0.15
    still = out.global_quat()[inside, CHEST]
    assert angle(still, still[0]).max() < 0.02
    lean = angle(out.joint_quat[:, 3], upper.joint_quat[:, 3])[inside]
    assert lean.max() == pytest.approx(angle(out.joint_quat[:, 6], upper.joint_quat[:, 6])[inside].max(), rel=0.1)


def test_the_chest_goes_around_a_corner_with_the_legs() -> None:
    lower = walk(seconds=6)
    yaw = np.linspace(0, np.pi / 2, len(lower))
    quat = lower.joint_quat.copy()
    quat[:, 0] = quat_mul(axis_angle_to_quat(UP, yaw), quat[:, 0])
    out = overlay(replace(lower, joint_quat=quat), turned(wave(seconds=6), 2.0, np.zeros(3)), ("upper_body",))
    facing = quat_rotate(out.global_quat()[:, CHEST], [1.0, 0, 0])
    np.testing.assert_allclose(np.arctan2(facing[:, 1], facing[:, 0])[45:-45], yaw[45:-45], atol=0.02)


def test_a_shorter_clip_goes_over_smoothly_and_labels_say_when() -> None:
    lower, upper = walk(seconds=6), wave("left", seconds=3)
    out = overlay(lower, upper, ("left_arm",), start_s=1.5)
    arm = SMPL_JOINTS.index("left_shoulder")
    away = angle(out.joint_quat[:, arm], lower.joint_quat[:, arm])
    assert away[: 30 + 1].max() < 1e-6
    assert away[-30:].max() < 1e-6
    assert angle(out.joint_quat[:-1, arm], out.joint_quat[1:, arm]).max() < 0.25
    assert [(x.start_s, x.end_s, x.parts) for x in out.labels] == [(0, 6, ()), (1.5, 4.5, ("left_arm",))]
    assert out.source.generator == "synthetic+synthetic"


def test_the_sharpest_turn_of_a_joint() -> None:
    clip = stand(seconds=3, fps=60)
    t = np.arange(len(clip)) / 60
    quat = clip.joint_quat.copy()
    quat[:, 18] = axis_angle_to_quat(LEFT, 0.5 * np.sin(4 * t))
    assert sharpest(replace(clip, joint_quat=quat)) == pytest.approx(0.5 * 4**2, rel=0.01)


def test_clearance_of_a_t_pose() -> None:
    quat = np.zeros((2, len(SMPL_JOINTS), 4))
    quat[..., 0] = 1
    # Straight out from between chest and neck: collar, shoulder, upper arm, forearm, 0.08 m to the middle of the hand.
    expected = 0.05 + 0.13 + 0.27 + 0.25 + 0.08
    assert clearance(Motion(np.zeros((2, 3)), quat, 30, skeleton())) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("parts", "start_s", "why"),
    [(("legs",), 0.0, "left_hip"), (("wing",), 0.0, "'wing'"), ((), 0.0, "no part"), (("head",), 9.0, "within")],
)
def test_what_cannot_be_laid_over(parts: tuple[str, ...], start_s: float, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        overlay(walk(), wave(), parts, start_s=start_s)


# ---- One after another


def test_a_walk_goes_on_where_it_ended() -> None:
    """Two pieces of the same even walk, the second turned away and elsewhere: the result is that walk, straight on."""
    first, second = walk(seconds=4), turned(walk(seconds=4), 2.0, np.array([3.0, -1.0, 0.0]))
    seam = find_seam(first, second, 0.6)
    out = sequence([first, second])
    whole = walk(seconds=9)
    lost = (len(first) - 1 - seam.end) + seam.start
    assert len(out) == len(first) + len(second) - 1 - lost
    assert lost < 2 * 40
    np.testing.assert_allclose(out.positions(), whole.positions()[: len(out)], atol=0.03)


def test_a_planted_foot_stays_and_the_other_steps_over() -> None:
    first = squat()
    second = stand(seconds=2)
    at = second.positions()[:, ANKLES] + np.array([[0.0, 0.0, 0.0], [-0.1, -0.04, 0.0]])
    second = replace(second, joint_quat=with_ankles(replace(second, root_pos=second.root_pos - [0, 0, 0.03]), at))
    second = replace(second, root_pos=second.root_pos - [0, 0, 0.03])
    out = sequence([first, turned(second, -1.0, np.array([5.0, 5.0, 0.0]))])
    seam = len(first) - 1
    feet = out.positions()[seam : seam + 20, ANKLES]
    moved = np.linalg.norm(feet[:, :, :2] - feet[0, :, :2], axis=-1)
    assert moved[:, 0].max() < 1e-3 or moved[:, 1].max() < 1e-3
    assert moved.max() == pytest.approx(np.hypot(0.1, 0.04), abs=0.01)
    assert 0.01 < np.ptp(feet[..., 2]) < 0.05  # lifted over, not dragged
    assert feet[..., 2].min() > feet[0, :, 2].min() - 1e-6


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_walk_stops_and_starts_without_spikes(order: tuple[int, int]) -> None:
    clips = [walk(seconds=5), perform("bow")]
    first, second = (clips[i] for i in order)
    out = sequence([first, second])
    jump = np.linalg.norm(np.diff(out.root_pos, axis=0), axis=1).max() * out.fps
    assert jump < 1.6  # m/s; the walk has 1.2

    assert sharpest(out) < 1.05 * max(sharpest(first), sharpest(second))
    assert np.diff(out.root_pos[:, 0]).min() * out.fps > -0.25  # nobody coasts on and back
    found = measure(out)
    assert found.bows == 1
    assert found.steps >= 6
    labels = out.labels
    assert [x.text for x in labels] == [first.labels[0].text, second.labels[0].text]
    assert labels[0].end_s == pytest.approx(labels[1].start_s)
    assert labels[1].end_s == pytest.approx(out.duration, abs=1e-6)


def test_a_gesture_is_there_as_a_whole() -> None:
    out = sequence([perform("wave", count=3), perform("bow"), perform("wave", side="left", count=2)])
    found = measure(out)
    assert (found.right_waves, found.left_waves, found.bows, found.steps) == (3, 2, 1, 0)


def test_another_body_stands_on_its_own_soles() -> None:
    out = on_skeleton(perform("squat"), skeleton())
    contact = measure(out)
    assert (contact.squats, contact.steps) == (1, 0)
    feet = out.positions()[:, ANKLES]
    assert np.ptp(feet, axis=0).max() < 1e-6
    np.testing.assert_allclose(feet[..., 2], skeleton().foot_height[0], atol=1e-3)


def test_a_gait_goes_on() -> None:
    out = looped(walk(seconds=4), 10)
    assert out.duration >= 10
    np.testing.assert_allclose(out.positions(), walk(seconds=15).positions()[: len(out)], atol=0.05)
    assert out.labels[0].end_s == out.duration


def test_what_cannot_follow() -> None:
    with pytest.raises(ValueError, match="one motion or more"):
        sequence([])
    with pytest.raises(ValueError, match="blend_s must be above 0, not 0"):
        sequence([walk(), walk()], blend_s=0)
    with pytest.raises(ValueError, match="do not go over"):
        sequence([perform("squat"), replace(walk(), root_pos=walk().root_pos * 3)])


# ---- Ankles


def test_ankles_go_where_they_are_wanted_and_soles_stay_level() -> None:
    clip = walk(seconds=2)
    goal = clip.positions()[:, ANKLES] + np.array([[0.03, 0.02, 0.04], [-0.05, 0.0, 0.03]])
    out = replace(clip, joint_quat=with_ankles(clip, goal))
    np.testing.assert_allclose(out.positions()[:, ANKLES], goal, atol=1e-9)
    assert angle(out.global_quat()[:, ANKLES], clip.global_quat()[:, ANKLES]).max() < 1e-7
    same = with_ankles(clip, clip.positions()[:, ANKLES])
    assert angle(same, clip.joint_quat).max() < 1e-6
    with pytest.raises(ValueError, match=r"the left foot is .* m from its hip"):
        with_ankles(clip, goal - np.array([0.0, 0.0, 0.5]))
