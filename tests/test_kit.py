"""KIT-ML files: positions through features and back, told left from right, against MMM's own rest pose."""

from __future__ import annotations

from pathlib import Path

import motions
import numpy as np
import pytest

from motiongen.files import FileError
from motiongen.formats.humanml import KIT_ML, positions_to_features
from motiongen.formats.humanml_npy import read_humanml, write_kit
from motiongen.formats.kit import JOINTS, METRES, kit_positions
from motiongen.motion import SMPL_JOINTS

SHARED = [SMPL_JOINTS.index(name) for name in JOINTS if name]
# MMM's bones in millimetres of a body 1 m tall, x left-to-right, y up, z front, as language2pose's skeleton file has
# them: joint, the joint before it, where it lies from there. Its left is at -x.
MMM = [
    (1, 0, (0, 40, 0)), (2, 1, (0, 60, 0)), (3, 2, (0, 22, 0)), (4, 3, (0, 30, 0)),
    (5, 3, (-23, 0, 0)), (6, 5, (0, -188, 0)), (7, 6, (0, -145, 0)),
    (8, 3, (23, 0, 0)), (9, 8, (0, -188, 0)), (10, 9, (0, -145, 0)),
    (11, 0, (-52, 0, 0)), (12, 11, (0, -245, 0)), (13, 12, (0, -246, 0)), (14, 13, (0.6, -18.7, 23.8)),
    (15, 14, (-8.8, -14.4, 53.7)),
    (16, 0, (52, 0, 0)), (17, 16, (0, -245, 0)), (18, 17, (0, -246, 0)), (19, 18, (-0.6, -18.7, 23.8)),
    (20, 19, (8.8, -14.4, 53.7)),
]  # fmt: skip


def test_a_motion_goes_out_and_comes_back(tmp_path: Path) -> None:
    walk = motions.turned(motions.walk(seconds=4), 1.1, np.array([3.0, -2.0, 0.0]))
    write_kit(walk, tmp_path / "w.npy")
    features = np.load(tmp_path / "w.npy")
    assert features.dtype == np.float32
    assert features.shape == (50, 251)
    back = read_humanml(tmp_path / "w.npy")
    assert back.fps == 12.5
    want = motions.walk(seconds=4).resampled(12.5).positions()[:-1]
    want[..., 2] -= want[..., 2].min()
    assert np.abs(back.positions() - want)[:, SHARED].max() < 1e-5
    assert back.root_pos[-1, 0] > 3  # forward is +x
    # spine2 and the collars are not in the file: half-way along the bones that skip them.
    at = dict(zip(SMPL_JOINTS, np.moveaxis(back.positions(), 1, 0), strict=True))
    np.testing.assert_allclose(at["left_collar"], (at["spine3"] + at["left_shoulder"]) / 2, atol=1e-9)


def test_left_stays_left(tmp_path: Path) -> None:
    write_kit(motions.wave("left"), tmp_path / "w.npy")
    middle = dict(zip(SMPL_JOINTS, np.moveaxis(read_humanml(tmp_path / "w.npy").positions(), 1, 0)[:, 25], strict=True))
    assert middle["left_wrist"][2] > middle["left_shoulder"][2] > middle["right_wrist"][2]
    assert middle["left_wrist"][1] > 0


def test_mmms_own_body_stands_facing_forward_with_its_left_on_the_left(tmp_path: Path) -> None:
    body = np.zeros((21, 3))
    for joint, before, offset in MMM:
        body[joint] = body[before] + offset
    body[:, 1] -= body[:, 1].min()
    where = np.tile(body, (10, 1, 1)) + np.linspace(0, 1, 10)[:, None, None]
    np.save(tmp_path / "features.npy", positions_to_features(where - where[0, 0] * [1, 0, 1], KIT_ML))
    np.save(tmp_path / "joints.npy", where)
    np.save(tmp_path / "unmirrored.npy", where * [-1, 1, 1])
    for name in ("features.npy", "joints.npy", "unmirrored.npy"):
        motion = read_humanml(tmp_path / name)
        at = dict(zip(SMPL_JOINTS, motion.positions()[0], strict=True))
        assert at["left_hip"][1] > at["right_hip"][1]
        assert at["left_foot"][0] > at["left_ankle"][0]
        assert at["left_hip"][2] - at["left_ankle"][2] == pytest.approx(491 * METRES, abs=1e-6)
        # Upright, facing +x, but for 8° of pitch: MMM's hips lie level with its root, SMPL's below and behind.
        assert np.abs(motion.global_quat()[:, 0] - [1, 0, 0, 0]).max() < 0.1


def test_the_middle_of_the_foot_is_where_mmm_has_it() -> None:
    where = kit_positions(motions.stand())
    share = np.linalg.norm(where[0, 14] - where[0, 13]) / np.linalg.norm(where[0, 15] - where[0, 13])
    ankle, middle, toes = np.zeros(3), np.array(MMM[13][2]), np.array(MMM[13][2]) + MMM[14][2]
    assert share == pytest.approx(middle @ (toes - ankle) / (toes @ toes), abs=0.01)


def test_a_body_of_another_unit_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "metres.npy", kit_positions(motions.stand()) * METRES)
    with pytest.raises(FileError, match=r"metres\.npy: a leg of 0\.00\d+ m in KIT-ML's unit, expected 0\.5 to 1\.2 m"):
        read_humanml(tmp_path / "metres.npy")
