"""BVH that is written: by a reader of its own, after the format's definition, with rotation matrices."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from motions import a_motion

from motiongen.formats.bvh import read_bvh
from motiongen.formats.bvh_write import write_bvh
from motiongen.motion import SMPL_JOINTS, Motion


def rotation(axis: str, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return {
        "X": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "Y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "Z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def world_positions(path: Path) -> tuple[list[dict[str, np.ndarray]], float]:
    """Joint positions by name for every frame, in the file's axes and unit, and the frame time."""
    words = path.read_text().split()
    at = words.index("MOTION")
    tree, stack, i = [], [], 1
    while i < at:
        if words[i] in ("ROOT", "JOINT", "End"):
            parent = stack[-1] if stack else None
            name = words[i + 1] if words[i] != "End" else f"end of {stack[-1]['name']}"
            stack.append({"name": name, "parent": parent, "channels": []})
            tree.append(stack[-1])
            i += 3
        elif words[i] == "OFFSET":
            stack[-1]["offset"] = np.array(words[i + 1 : i + 4], float)
            i += 4
        elif words[i] == "CHANNELS":
            count = int(words[i + 1])
            stack[-1]["channels"] = words[i + 2 : i + 2 + count]
            i += 2 + count
        else:
            assert words[i] == "}", words[i]
            stack.pop()
            i += 1
    assert words[at + 1] == "Frames:"
    assert words[at + 3 : at + 5] == ["Frame", "Time:"]
    rows = np.array(words[at + 6 :], float).reshape(int(words[at + 2]), -1)
    frames = []
    for row in rows:
        values, found = iter(row), {}
        for joint in tree:
            place, turn = joint["offset"].copy(), np.eye(3)
            for channel in joint["channels"]:
                if channel.endswith("position"):
                    place["XYZ".index(channel[0])] += next(values)
                else:
                    turn = turn @ rotation(channel[0], next(values))
            if joint["parent"] is not None:
                base, frame = found[joint["parent"]["name"]]
                place, turn = base + frame @ place, frame @ turn
            found[joint["name"]] = (place, turn)
        assert next(values, None) is None
        frames.append({name: where for name, (where, _) in found.items()})
    return frames, float(words[at + 5])


def test_an_independent_reader_finds_the_same_joints(tmp_path: Path) -> None:
    motion = a_motion()
    write_bvh(motion, tmp_path / "m.bvh")
    frames, frame_time = world_positions(tmp_path / "m.bvh")
    assert frame_time == pytest.approx(1 / 30, abs=1e-9)
    want = motion.positions()
    for k, frame in enumerate(frames):
        for j, name in enumerate(SMPL_JOINTS):
            x, y, z = frame[name] / 100  # the file's x is left, y is up, z is front
            np.testing.assert_allclose([z, x, y], want[k, j], atol=1e-6)


def test_bvh_comes_back_through_our_own_reader(tmp_path: Path) -> None:
    motion = a_motion()
    write_bvh(motion, tmp_path / "m.bvh")
    back = read_bvh(tmp_path / "m.bvh")
    assert back.skeleton.names == SMPL_JOINTS
    assert back.fps == pytest.approx(30, abs=1e-6)
    np.testing.assert_allclose(back.positions(), motion.positions(), atol=1e-6)
    np.testing.assert_allclose(
        back.global_quat() * np.sign(back.global_quat()[..., :1]),
        motion.global_quat() * np.sign(motion.global_quat()[..., :1]),
        atol=1e-6,
    )


def test_bvh_angles_do_not_jump_by_a_turn(tmp_path: Path) -> None:
    frames = 120
    angle = np.linspace(0, 4 * np.pi, frames)  # two turns about the vertical
    quat = np.zeros((frames, 22, 4))
    quat[..., 0] = 1
    quat[:, 0] = np.stack([np.cos(angle / 2), 0 * angle, 0 * angle, np.sin(angle / 2)], axis=1)
    write_bvh(Motion(np.zeros((frames, 3)), quat, 30.0, a_motion().skeleton), tmp_path / "m.bvh")
    rows = np.loadtxt(tmp_path / "m.bvh", skiprows=(tmp_path / "m.bvh").read_text().split("\n").index("MOTION") + 3)
    np.testing.assert_allclose(rows[:, 5], np.degrees(angle), atol=1e-5)  # Z X Y: the last of the root is its yaw
