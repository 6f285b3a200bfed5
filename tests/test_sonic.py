"""Version 1 of SONIC's messages: written, read, and refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from motions import motion
from test_bridge import PLACE_IN_ISAAC, RIG, decoded

from drivers.endpoint import StreamError
from drivers.inbox import Heard
from drivers.sonic import ISAAC_ORDER, ROBOT, SonicError, read_sonic, require_g1, sonic_message
from motiongen.motion import Motion, Skeleton
from motiongen.rotation import axis_angle_to_quat
from retarget.menagerie import menagerie_file
from retarget.retarget import retarget
from retarget.rig import load_rig
from rigcast.performers import OfSonic

MS = 1_000_000
FORWARD = np.array([1.0, 0.0, 0.0])


def published(index: np.ndarray, pos: np.ndarray, quat: np.ndarray, **changes: object) -> bytes:
    """A message made as the controller's documentation has it: topic, header in 1280 bytes, fields in turn."""
    arrays = {
        "joint_pos": pos[:, np.argsort(PLACE_IN_ISAAC)].astype("<f4"),
        "joint_vel": np.zeros(pos.shape, "<f4"),
        "body_quat": quat.astype("<f4"),
        "frame_index": index.astype("<i8"),
    }
    kinds = {"joint_pos": "f32", "joint_vel": "f32", "body_quat": "f32", "frame_index": "i64"}
    fields = [{"name": name, "dtype": kinds[name], "shape": list(a.shape)} for name, a in arrays.items()]
    header = {"v": 1, "endian": "le", "count": len(fields), "fields": fields, **changes}
    return b"pose" + json.dumps(header).encode().ljust(1280, b"\0") + b"".join(a.tobytes() for a in arrays.values())


def some(count: int = 3, first: int = 7) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    return first + np.arange(count), rng.uniform(-1, 1, (count, 29)), np.tile([0.8, 0, 0, 0.6], (count, 1))


def test_a_message_holds_what_its_readers_look_for() -> None:
    rng = np.random.default_rng(1)
    pos, vel, quat = rng.normal(size=(3, 29)), rng.normal(size=(3, 29)), np.tile([1.0, 0, 0, 0], (3, 1))
    found = decoded(sonic_message(70, pos, vel, quat))
    assert list(found) == ["joint_pos", "joint_vel", "body_quat", "frame_index"]
    np.testing.assert_array_equal(found["joint_pos"][:, PLACE_IN_ISAAC], pos.astype(np.float32))
    np.testing.assert_array_equal(found["joint_vel"][:, PLACE_IN_ISAAC], vel.astype(np.float32))
    np.testing.assert_array_equal(found["body_quat"], quat)
    assert found["frame_index"].tolist() == [70, 71, 72]
    assert sorted(ISAAC_ORDER) == list(range(29))


def test_it_is_for_g1() -> None:
    with pytest.raises(StreamError, match="rig 'small' has others"):
        require_g1(RIG)
    with pytest.raises(StreamError, match=r"positions \(1, 3\)"):
        sonic_message(0, np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 4)))


def test_a_message_of_others_is_read_in_our_order() -> None:
    index, pos, quat = some()
    found = read_sonic(published(index, pos, quat))
    np.testing.assert_array_equal(found.index, index)
    np.testing.assert_allclose(found.pos, pos, atol=1e-6)
    np.testing.assert_allclose(found.quat, quat, atol=1e-6)
    ours = read_sonic(sonic_message(7, pos, np.zeros(pos.shape), quat))
    np.testing.assert_array_equal(ours.pos, found.pos)


def spoiled(message: bytes, *what: tuple[str, object]) -> bytes:
    """`message` with its header changed: ("v", 2), or ("fields.0.shape", …)."""
    header = json.loads(message[4:1284].rstrip(b"\0"))
    for path, value in what:
        *way, last = (int(part) if part.isdecimal() else part for part in path.split("."))
        at = header
        for part in way:
            at = at[part]
        at[last] = value
    return b"pose" + json.dumps(header).encode().ljust(1280, b"\0") + message[1284:]


GOOD = published(*some())
NAN = (some()[0], np.full((3, 29), np.nan), some()[2])


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no message of 'pose'"),
        (b"pose" + bytes(100), "104 bytes"),
        (b"pose" + bytes(1280), "header: "),
        (b"pose" + b"{}".ljust(1280, b"\0"), "header: "),
        (spoiled(GOOD, ("v", 2)), "version 2"),
        (spoiled(GOOD, ("endian", "be")), "endian 'be'"),
        (spoiled(GOOD, ("fields.0.name", "joints")), "no field joint_pos"),
        (spoiled(GOOD, ("fields.0.dtype", "object")), "'joint_pos' of object"),
        (spoiled(GOOD, ("fields.0.shape", [3, 1 << 40])), "'joint_pos' of f32"),
        (spoiled(GOOD, ("fields.0.shape", [1024, 1024])), "goes beyond"),
        (spoiled(GOOD, ("fields.0.shape", [29, 3])), r"joint_pos \(29, 3\)"),
        (GOOD[:-8], "goes beyond"),
        (GOOD + bytes(8), "8 bytes are left over"),
        (published(*NAN), "frame 7: a joint beyond 10 rad"),
        (published(some()[0], some()[1], np.zeros((3, 4))), "quaternion not of length 1"),
        (published(np.array([7, 8, 10]), *some()[1:]), "7 to 10 is not one after the other"),
        (published(*some(first=-3)), "-3 to -1"),
    ],
)
def test_what_is_no_such_message_is_one_clear_line(data: bytes, words: str) -> None:
    with pytest.raises(SonicError, match=words) as caught:
        read_sonic(data)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not menagerie_file("unitree_g1/g1.xml").is_absolute(), reason="no robot models: rigcast[robots]")
def test_poses_come_at_the_times_of_their_numbers_and_show_what_the_robot_does() -> None:
    g1 = load_rig(ROBOT)
    up = np.full(61, 1.4)
    arms = {f"{side}_shoulder": axis_angle_to_quat(FORWARD, s * up) for side, s in (("left", 1), ("right", -1))}
    wide = retarget(motion(2.0, 30.0, arms, "arms out"), g1, mount="stand")
    pose = np.tile(wide.qpos[len(wide) // 2], (4, 1))
    telling, people = OfSonic(), []
    for k, late_ms in ((0, 3), (2, 9), (1, 30), (4, 1)):  # two at a time; one is old, one was quicker than the first
        data = published(k + np.arange(2), pose[:2, 7:], pose[:2, 3:7])
        people += telling.hear(Heard((1000 + 20 * k + late_ms) * MS, "g1", data))
    assert [round(p.at_ns / MS) for p in people] == [1003, 1023, 1043, 1063, 1081, 1101]
    body = telling.skeleton()
    arm = _direction(people[0].turns, body, "left_shoulder", "left_elbow")
    assert arm @ [0, 1, 0] > 0.95  # out to the left


def _direction(turns: np.ndarray, body: Skeleton, above: str, below: str) -> np.ndarray:
    places = Motion(np.zeros((1, 3)), turns[None], 50.0, body).positions()[0]
    bone = places[body.index(below)] - places[body.index(above)]
    return bone / np.linalg.norm(bone)
