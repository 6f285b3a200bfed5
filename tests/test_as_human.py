"""A rig's pose as a person's, against the person that it followed, and there and back."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from motions import motion

from motiongen.motion import Motion
from motiongen.rotation import Array, axis_angle_to_quat, quat_conj, quat_mul, quat_rotate
from retarget.as_human import as_human, body_of
from retarget.model import load_model
from retarget.rest import is_site
from retarget.retarget import retarget
from retarget.rig import load_rig
from retarget.trajectory import Trajectory

FORWARD, LEFT, UP = np.eye(3)
BONES = (
    ("right_shoulder", "right_elbow", "spine3"),
    ("right_elbow", "right_wrist", "spine3"),
    ("left_shoulder", "left_elbow", "spine3"),
    ("left_hip", "left_knee", "pelvis"),
    ("left_knee", "left_ankle", "pelvis"),
)


def posed() -> Motion:
    """The right arm is held forward and a little up, the forearm upright, the head turned; for three seconds."""
    still = np.zeros(91)
    ahead = quat_mul(axis_angle_to_quat(UP, still + 1.3), axis_angle_to_quat(FORWARD, still + 1.2))
    turns = {
        "right_shoulder": ahead,
        "right_elbow": axis_angle_to_quat(UP, still + 0.9),
        "head": axis_angle_to_quat(UP, still + 0.4),
    }
    return motion(3.0, 30.0, turns, "point")


def directions(clip: Motion, frame: int) -> Array:
    """Of the bones, each in the frame of what they are compared in."""
    at, turn, index = clip.positions()[frame], clip.global_quat()[frame], clip.skeleton.index
    bones = [quat_rotate(quat_conj(turn[index(base)]), at[index(b)] - at[index(a)]) for a, b, base in BONES]
    return np.array([bone / np.linalg.norm(bone) for bone in bones])


def followed(name: str) -> tuple[Motion, Trajectory, Motion]:
    """A person, a rig that follows, and the person whom the rig shows."""
    rig, clip = load_rig(name), posed()
    trajectory = retarget(clip, rig, mount="stand")
    return clip, trajectory, as_human(body_of(rig), trajectory.qpos, trajectory.fps)


def test_limbs_point_as_those_of_whom_it_followed() -> None:
    clip, trajectory, shown = followed("humanoid")
    assert (shown.fps, len(shown)) == (trajectory.fps, len(trajectory))
    apart = np.degrees(np.arccos((directions(clip, 45) * directions(shown, len(shown) // 2)).sum(1).clip(-1, 1)))
    assert apart.max() < 3


@pytest.mark.parametrize("name", ["humanoid", "puppet"])
def test_limbs_point_as_those_of_the_rig(name: str) -> None:
    rig, (_, trajectory, shown) = load_rig(name), followed(name)
    middle = len(shown) // 2
    model = load_model(rig)
    data = mujoco.MjData(model)
    data.qpos[:] = trajectory.qpos[middle]
    mujoco.mj_kinematics(model, data)
    places = {f.human: (data.site if is_site(model, f.body) else data.body)(f.body).xpos for f in rig.follow}
    index, at = shown.skeleton.index, shown.positions()[middle]
    for above, below, _ in BONES:
        asked, found = places[below] - places[above], at[index(below)] - at[index(above)]
        np.testing.assert_allclose(found / np.linalg.norm(found), asked / np.linalg.norm(asked), atol=1e-6)


def test_who_follows_the_person_shown_does_the_same() -> None:
    _, trajectory, shown = followed("humanoid")
    again = retarget(shown, load_rig("humanoid"), mount="stand")
    middle = len(trajectory) // 2
    np.testing.assert_allclose(again.qpos[middle, 7:], trajectory.qpos[middle, 7:], atol=0.06)


def test_a_rig_at_rest_is_a_person_of_a_person_s_height() -> None:
    rig = load_rig("puppet")
    qpos = np.concatenate([[0.3, 0.1, rig.nominal.height, 1, 0, 0, 0], rig.pose_vector(rig.nominal)])
    body = body_of(rig)
    shown = as_human(body, qpos[None], 50.0)
    np.testing.assert_allclose(shown.root_pos[0], body.scale * qpos[:3], atol=1e-9)
    assert 0.7 < shown.root_pos[0, 2] < 1.2
    np.testing.assert_allclose(shown.joint_quat[0, 0], [1, 0, 0, 0], atol=1e-9)
