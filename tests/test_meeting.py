"""Turns of joints, mixed: an even way from one to the other, whatever the six numbers would do."""

import numpy as np
import pytest

from motiongen.diffusion.meeting import meetings, mixed_turns
from motiongen.diffusion.mixing import Span, shares
from motiongen.features import TURNS, WIDTH
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS
from motiongen.rotation import (
    axis_angle_to_quat,
    matrix_from_6d,
    matrix_to_6d,
    matrix_to_quat,
    quat_conj,
    quat_mul,
    quat_rotate,
    quat_to_matrix,
    quat_to_rotvec,
)

FRAMES = 31
SHOULDER, ELBOW, WRIST = (SMPL_JOINTS.index(f"right_{name}") for name in ("shoulder", "elbow", "wrist"))


def said(bends: dict[int, float]) -> np.ndarray:
    """Features (T, 132) of a still body whose joints are turned on their parents about x by degrees."""
    turn = np.zeros((len(SMPL_JOINTS), 4))
    for joint, parent in enumerate(SMPL_PARENTS):
        local = axis_angle_to_quat([1.0, 0.0, 0.0], np.radians(bends.get(joint, 0.0)))
        turn[joint] = local if parent < 0 else quat_mul(turn[parent], local)
    return np.tile(matrix_to_6d(quat_to_matrix(turn)).reshape(-1), (FRAMES, 1))


def turns(six: np.ndarray) -> np.ndarray:
    return matrix_to_quat(matrix_from_6d(six.reshape(len(six), -1, 6)))


def fading() -> np.ndarray:
    second = np.tile(np.linspace(0, 1, FRAMES)[:, None], (1, len(SMPL_JOINTS)))
    return np.stack([1 - second, second])


@pytest.mark.parametrize("degrees", [90.0, 170.0, -179.0])
def test_an_arm_goes_up_evenly(degrees: float) -> None:
    out = turns(mixed_turns([said({}), said({SHOULDER: degrees})], fading()))[:, SHOULDER]
    way = np.degrees(np.linalg.norm(quat_to_rotvec(quat_mul(quat_conj(out[:1]), out)), axis=-1))
    share = np.linspace(0, 1, FRAMES)
    half = np.radians(degrees) / 2  # of two unit vectors that far apart, by the law of sines
    ideal = 2 * np.degrees(np.arctan2(share * np.sin(abs(half)), 1 - share + share * np.cos(half)))
    assert np.abs(way - ideal).max() < 1e-3
    assert np.abs(np.diff(way)).max() < 25


def test_a_forearm_follows_its_arm_the_same_way_round() -> None:
    out = turns(mixed_turns([said({}), said({SHOULDER: 120.0, ELBOW: 100.0, WRIST: 30.0})], fading()))
    fingers = quat_rotate(out[:, WRIST], [0.0, 1.0, 0.0])
    angle = np.degrees(np.unwrap(np.arctan2(fingers[:, 2], fingers[:, 1])))
    assert angle[-1] - angle[0] == pytest.approx(250.0)  # and not 110 the other way
    assert (np.diff(angle) > 0).all()


def test_who_speaks_alone_is_repeated_as_surely_as_it_was_said() -> None:
    random = np.random.default_rng(0)
    one, other = random.normal(size=(2, FRAMES, 132))
    share = np.zeros((2, FRAMES, len(SMPL_JOINTS)))
    share[0] = 1
    out = mixed_turns([one, other], share)
    assert np.abs(turns(out) - turns(one)).max() < 1e-5
    assert np.allclose(np.linalg.norm(out.reshape(-1, 6), axis=1), np.linalg.norm(one.reshape(-1, 6), axis=1))


def test_where_spans_meet() -> None:
    every, arm = np.ones(WIDTH, bool), np.zeros(WIDTH, bool)
    arm[TURNS.start + 6 * SHOULDER :][:6] = True
    spans = [Span(0, 60, every), Span(40, 100, every), Span(10, 30, arm)]
    share = shares(spans, 20)
    first, second = meetings(spans, share)
    # The arm's own span fades in over what the body's says of the arm, and out again.
    assert ((first.start, first.stop), first.voices) == ((10, 30), (0, 2))
    assert ((second.start, second.stop), second.voices) == ((40, 60), (0, 1))
    assert np.allclose(second.share.sum(0), 1)
    assert np.allclose(second.share[0], share[0][40:, TURNS][:, ::6])
