"""HumanML3D features against the data set's own, where a sample is at hand, and against motions with known answers."""

from __future__ import annotations

import os
from pathlib import Path

import motions
import numpy as np
import pytest

from motiongen.files import FileError
from motiongen.formats.humanml import HUMANML3D, KIT_ML, Layout, features_to_positions, positions_to_features
from motiongen.formats.humanml_npy import humanml_positions, read_humanml, write_humanml
from motiongen.motion import SMPL_JOINTS

SAMPLE = os.environ.get("RIGCAST_HUMANML3D")
golden = pytest.mark.skipif(SAMPLE is None, reason="RIGCAST_HUMANML3D names no folder with the data set's sample")
ROOT_AND_PLACES, TURNS, SPEEDS, CONTACTS = slice(0, 67), slice(67, 193), slice(193, 259), slice(259, 263)


def sample() -> tuple[np.ndarray, np.ndarray]:
    """Joints (170, 22, 3) and features (170, 263) by the data set's authors."""
    folder = Path(SAMPLE or "")
    joints, features = (np.load(next(folder.glob(f"{kind}-*.npy"))) for kind in ("new_joints", "new_joint_vecs"))
    return joints.astype(float), features.astype(float)


@golden
def test_features_are_the_authors_own() -> None:
    joints, want = sample()
    got = positions_to_features(joints)
    inside = slice(0, len(joints) - 80)  # the heading is smoothed over 80 frames, and the joints lack their last one
    error = np.abs(got - want[: len(got)])
    assert error[inside, ROOT_AND_PLACES].max() < 1e-5
    assert error[inside, TURNS].max() < 1e-4  # shortest arcs magnify what float32 left of the joints
    assert error[inside, SPEEDS].max() < 1e-5
    np.testing.assert_array_equal(got[:, CONTACTS], want[: len(got), CONTACTS])


@golden
def test_positions_are_the_authors_own() -> None:
    joints, features = sample()
    assert np.abs(features_to_positions(features) - joints).max() < 1e-6


@golden
def test_a_file_of_either_kind_gives_the_same_motion(tmp_path: Path) -> None:
    joints, features = sample()
    np.save(tmp_path / "joints.npy", joints.astype(np.float32))
    np.save(tmp_path / "features.npy", features.astype(np.float32))
    by_joints, by_features = (read_humanml(tmp_path / n) for n in ("joints.npy", "features.npy"))
    assert np.abs(by_joints.positions() - by_features.positions()).max() < 1e-5
    assert np.abs(by_joints.positions()[..., [1, 2, 0]] - joints).max() < 1e-5
    assert by_joints.fps == 20


@pytest.mark.parametrize("layout", [HUMANML3D, KIT_ML], ids=lambda layout: layout.name)
def test_round_trip_of_any_joints(layout: Layout) -> None:
    rng = np.random.default_rng(0)
    joints = layout.joints
    body = rng.normal(0, 0.4, (joints, 3)) + np.array([0, 1, 0])
    where = body + np.cumsum(rng.normal(0, 0.01, (120, joints, 3)), axis=0)
    where -= where[0, 0] * [1, 0, 1]
    features = positions_to_features(where, layout)
    assert features.shape == (119, 12 * joints - 1)
    back = features_to_positions(features)
    assert np.abs(back - where[:-1]).max() < 1e-5
    again = positions_to_features(back, layout)
    assert np.abs(again - features[:-1])[:30].max() < 1e-5  # before the smoothing reaches the frame that was lost


def test_a_straight_walk_says_speed_and_height() -> None:
    walk = motions.walk(speed=1.0, seconds=4, fps=20)
    features = positions_to_features(humanml_positions(walk))
    assert features[20:60, 2] == pytest.approx(1.0 / 20, abs=2e-3)  # metres a frame, forward
    assert np.abs(features[:, 0]).max() < 0.02
    assert features[:, 3] == pytest.approx(walk.root_pos[:-1, 2] - walk.positions()[..., 2].min(), abs=1e-9)
    contacts = features[:, CONTACTS]
    planted = np.linalg.norm(np.diff(walk.positions()[:, [7, 10, 8, 11]], axis=0), axis=-1) < np.sqrt(0.002)
    np.testing.assert_array_equal(contacts, planted)


def test_a_steady_turn_is_half_its_angle() -> None:
    frames, rate = 200, 0.02  # radians a frame, about y
    still = humanml_positions(motions.stand(seconds=1, fps=20))[0]
    angle = rate * np.arange(frames)
    x, y, z = still.T
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    where = np.stack([c * x + s * z, np.broadcast_to(y, (frames, len(y))), c * z - s * x], axis=-1)
    features = positions_to_features(where)
    # The data set's frame 0 is the identity; the sign is that of its quaternion, which undoes the turn.
    assert features[90:110, 0] == pytest.approx(-rate / 2, abs=1e-6)


def test_a_motion_goes_out_and_comes_back(tmp_path: Path) -> None:
    walk = motions.turned(motions.walk(seconds=4, fps=20), 1.1, np.array([3.0, -2.0, 0.0]))
    write_humanml(walk, tmp_path / "w.npy")
    assert np.load(tmp_path / "w.npy").dtype == np.float32
    back = read_humanml(tmp_path / "w.npy")
    want = humanml_positions(walk)[:-1][..., [2, 0, 1]]
    assert np.abs(back.positions() - want).max() < 1e-4
    assert want[0, 0, :2] == pytest.approx([0, 0])
    assert back.root_pos[-1, 0] > 3  # it walks forward, which is +x


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (np.zeros((5, 140)), r"an array \(5, 140\)"),
        (np.zeros((5, 251)), "a leg of 0 m in KIT-ML"),
        (np.zeros((0, 263)), "0 frames"),
        (np.full((5, 263), np.nan), "frame 0 holds NaN"),
        (np.zeros((5, 22, 3)), "no length"),
        (np.zeros((5, 22, 2)), "an array"),
        (np.array([{}], object), "plain numbers"),
        (np.array(["a", "b"]), "plain numbers"),
        (np.zeros(()), "plain numbers"),
    ],
)
def test_bad_arrays_are_one_line(tmp_path: Path, array: np.ndarray, said: str) -> None:
    np.save(tmp_path / "bad.npy", array, allow_pickle=True)
    with pytest.raises(FileError, match=said) as caught:
        read_humanml(tmp_path / "bad.npy")
    assert "\n" not in str(caught.value)
    assert "bad.npy" in str(caught.value)


def test_damaged_and_boastful_files_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "m.npy", np.ones((30, len(SMPL_JOINTS), 3)))
    whole = (tmp_path / "m.npy").read_bytes()
    boast = whole.replace(b"(30, 22, 3), }  ", b"(99999999999,22,3)}")[: len(whole)]
    for content in (whole[:-9], whole[:40], b"", b"\x93NUMPY", boast):
        (tmp_path / "bad.npy").write_bytes(content)
        with pytest.raises(FileError, match="damaged"):
            read_humanml(tmp_path / "bad.npy")
    with pytest.raises(FileNotFoundError):
        read_humanml(tmp_path / "none.npy")
