"""A person's bones as VMC: in the world of Unity, against python-osc, and told back."""

from __future__ import annotations

import numpy as np
import pytest
from motions import motion, skeleton
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_message_builder import OscMessageBuilder

from drivers.osc import Message, messages_in
from drivers.vmc import BONE, BONES, NEEDED, ROOT, Performer, VmcError, datagrams
from motiongen.motion import SMPL_JOINTS, Motion
from motiongen.rotation import axis_angle_to_quat, yaw_quat
from motiongen.smpl import SMPL_SKELETON

UP, LEFT = np.array([0.0, 0, 1]), np.array([0.0, 1, 0])
STILL = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
S = float(np.sin(np.pi / 4))


def turning() -> Motion:
    """Arms that swing, a head that nods and a body that walks a circle."""
    t = np.arange(11) / 10
    turns = {
        "head": axis_angle_to_quat(LEFT, 0.5 * t),
        "right_elbow": axis_angle_to_quat(UP, 1.2 * t),
        "pelvis": yaw_quat(t),
    }
    root = np.stack([np.sin(t), 1 - np.cos(t), np.zeros(11)], axis=1)
    return motion(1.0, 10.0, turns, "turn", root)


def spoken(bone: str, *numbers: float) -> bytes:
    """A bone as python-osc says it."""
    builder = OscMessageBuilder(BONE if bone in BONES else ROOT)
    builder.add_arg(bone)
    for number in numbers:
        builder.add_arg(number, "f")
    return builder.build().dgram


def test_others_read_bones_in_the_world_of_unity() -> None:
    quat = np.tile([1.0, 0, 0, 0], (1, 22, 1))
    quat[0, SMPL_JOINTS.index("head")] = axis_angle_to_quat(UP, np.pi / 2)  # looks to the left
    quat[0, SMPL_JOINTS.index("left_elbow")] = axis_angle_to_quat(LEFT, np.pi / 2)
    body = Motion(np.array([[2.0, 0.5, 0.9]]), quat, 50.0, SMPL_SKELETON)
    data = datagrams(body, 0, 1.5)
    assert max(map(len, data)) <= 1472  # one Ethernet frame
    heard = {(m.address, m.params[0]): m.params for each in data for m in OscBundle(each)}
    assert heard["/VMC/Ext/OK", 1] == [1]
    assert heard["/VMC/Ext/T", 1.5] == [1.5]
    assert heard["/VMC/Ext/Root/Pos", "root"] == ["root", *STILL]
    bones = {bone: params[1:] for (address, bone), params in heard.items() if address == "/VMC/Ext/Bone/Pos"}
    assert bones.keys() == BONES.keys()
    np.testing.assert_allclose(bones["Hips"], [-0.5, 0.9, 2.0, 0, 0, 0, 1], atol=1e-6)  # left is -x, ahead is z
    np.testing.assert_allclose(bones["Head"][3:], [0, -S, 0, S], atol=1e-6)  # Unity turns clockwise, seen from above
    np.testing.assert_allclose(bones["LeftLowerArm"][:3], [-0.26, 0, 0], atol=1e-6)
    np.testing.assert_allclose(bones["LeftLowerArm"][3:], [S, 0, 0, S], atol=1e-6)  # about its x, clockwise the same


def test_what_was_told_comes_back() -> None:
    clip, performer = turning(), Performer()
    for k in range(len(clip)):
        people = [performer.take(messages_in(data), k) for data in datagrams(clip, k, 0.1 * k)]
        assert people[:-1] == [None]
        np.testing.assert_allclose(people[-1].pos, clip.root_pos[k], atol=1e-6)
        sign = np.sign((people[-1].turns * clip.joint_quat[k]).sum(-1, keepdims=True))
        np.testing.assert_allclose(sign * people[-1].turns, clip.joint_quat[k], atol=1e-6)
    assert performer.missing == ()
    np.testing.assert_allclose(performer.skeleton().offsets, skeleton().offsets, atol=1e-6)


def test_a_pose_is_whole_once_all_that_is_needed_has_come_one_by_one() -> None:
    performer = Performer()
    for _ in range(2):
        for bone in NEEDED:
            person = performer.take(messages_in(spoken(bone, *STILL)), 0)
            assert (person is not None) == (bone == NEEDED[-1])
    assert performer.skeleton() is SMPL_SKELETON  # nobody said how long the bones are


def test_bones_that_are_missing_are_named() -> None:
    performer = Performer()
    for bone in NEEDED:
        if bone not in ("LeftHand", "Spine"):
            assert performer.take(messages_in(spoken(bone, *STILL)), 0) is None
    assert performer.missing == ("Spine", "LeftHand")


def test_the_root_carries_the_hips() -> None:
    performer = Performer()
    performer.take(
        messages_in(spoken("root", 1.0, 0.0, 0.0, 0.0, S, 0.0, S)), 0
    )  # a quarter to the right, 1 m to the right
    for bone in NEEDED:
        person = performer.take(messages_in(spoken(bone, 0.0, 1.0 if bone == "Hips" else 0.0, 0.5, 0, 0, 0, 1)), 0)
    np.testing.assert_allclose(person.pos, [0, -1.5, 1.0], atol=1e-6)  # 0.5 m ahead of a root that looks right
    np.testing.assert_allclose(person.turns[0], [S, 0, 0, -S], atol=1e-6)


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ((), "7 floats"),
        (("Hips", 0.0, 0.0), "'Hips' must come with 7 floats"),
        ((3, *STILL), "'3' must come"),
        (("Hips", *STILL[:6], 1), "7 floats"),
        (("Hips", 0.0, 1e9, *STILL[2:]), r"'Hips' is at 0 1e\+09 0 m"),
        (("Hips", float("nan"), *STILL[1:]), "'Hips' is at nan"),
        (("Hips", *STILL[:6], 0.0), "quaternion of 'Hips' has length 0, not 1"),
        (("Hips", *STILL[:6], float("inf")), "length inf"),
        (("Hips", *STILL[:6], float("nan")), "length nan"),
    ],
)
def test_a_senseless_bone_is_one_clear_line_and_nothing_of_it_counts(args: tuple, words: str) -> None:
    performer = Performer()
    with pytest.raises(VmcError, match=words) as caught:
        performer.take([Message(BONE, ("Spine", *STILL)), Message(BONE, args)], 0)
    assert "\n" not in str(caught.value)
    assert performer.missing == NEEDED


def test_bones_in_centimetres_are_refused() -> None:
    performer = Performer()
    for bone in NEEDED:
        performer.take([Message(BONE, (bone, 0.0, -40.0, 0.0, 0.0, 0.0, 0.0, 1.0))], 0)
    with pytest.raises(VmcError, match="40 m long; VMC is in metres"):
        performer.skeleton()
