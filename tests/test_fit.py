"""Rotations fitted to positions, against the motions that the positions came from."""

from __future__ import annotations

import motions
import numpy as np
import pytest

from motiongen.formats.fit import motion_from_positions
from motiongen.motion import SMPL_JOINTS, Motion, Source
from motiongen.rotation import quat_conj, quat_mul, quat_to_rotvec

CLIPS = {"stand": motions.stand(), "wave": motions.wave(), "squat": motions.squat(), "walk": motions.walk()}


def angles(a: Motion, b: Motion) -> np.ndarray:
    """Largest angle (22,) in degrees between the joints' world orientations."""
    between = quat_mul(quat_conj(a.global_quat()), b.global_quat())
    return np.degrees(np.linalg.norm(quat_to_rotvec(between), axis=-1)).max(0)


@pytest.mark.parametrize("name", CLIPS)
@pytest.mark.parametrize("known", [True, False])
def test_joints_pass_through_the_positions(name: str, known: bool) -> None:
    clip = CLIPS[name]
    fitted = motion_from_positions(clip.positions(), clip.fps, Source("x"), clip.skeleton if known else None)
    np.testing.assert_allclose(fitted.positions(), clip.positions(), atol=1e-9)


@pytest.mark.parametrize("name", CLIPS)
def test_trunk_and_legs_are_found_again(name: str) -> None:
    clip = CLIPS[name]
    fitted = motion_from_positions(clip.positions(), clip.fps, Source("x"), clip.skeleton)
    seen = [j for j, n in enumerate(SMPL_JOINTS) if not n.endswith(("shoulder", "elbow", "wrist"))]
    assert angles(fitted, clip)[seen].max() < 2


def test_an_elbow_bends_about_its_hinge() -> None:
    """Left forearm swung forward about the upper arm's z: what the fit must find, for its twist is seen in the bend."""
    t = np.linspace(1.0, 1.5, 20)
    bend = np.stack([np.cos(t / 2), 0 * t, 0 * t, -np.sin(t / 2)], axis=1)
    quat = np.zeros((20, 22, 4))
    quat[..., 0] = 1
    quat[:, SMPL_JOINTS.index("left_elbow")] = bend
    twist = [np.cos(0.4), 0, np.sin(0.4), 0]  # the whole arm turned about its own length
    quat[:, SMPL_JOINTS.index("left_shoulder")] = twist
    clip = Motion(np.zeros((20, 3)), quat, 30.0, motions.skeleton())
    fitted = motion_from_positions(clip.positions(), 30.0, Source("x"), clip.skeleton)
    assert angles(fitted, clip)[SMPL_JOINTS.index("left_elbow")] < 10  # of 46


def test_turning_the_clip_turns_the_fit() -> None:
    walk = motions.walk()
    there = motions.turned(walk, 2.0, np.array([1.0, 2.0, 0.5]))
    a = motion_from_positions(walk.positions(), walk.fps, Source("x"), walk.skeleton)
    b = motion_from_positions(there.positions(), walk.fps, Source("x"), walk.skeleton)
    assert angles(motions.turned(a, 2.0, np.array([1.0, 2.0, 0.5])), b).max() < 1e-4


@pytest.mark.parametrize(
    ("positions", "said"),
    [
        (np.zeros((3, 21, 3)), "expected"),
        (np.zeros((0, 22, 3)), "expected"),
        (np.full((3, 22, 3), np.inf), "frame 0 holds NaN or infinity"),
        (np.zeros((3, 22, 3)), "left_hip has no length"),
    ],
)
def test_bad_positions_are_named(positions: np.ndarray, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        motion_from_positions(positions, 30.0, Source("x"))
