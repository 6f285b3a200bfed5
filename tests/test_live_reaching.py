"""Wrists led to a place: against forward kinematics of the whole body."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from motiongen.features import FPS, features_to_motion, motion_to_features
from motiongen.generator import load_generator
from motiongen.gestures.body import BODY
from motiongen.live.reaching import ARMS, Hands, reached
from motiongen.live.steering import REACH_S, WRISTS
from motiongen.motion import SMPL_JOINTS

PLACES = ((0.3, -0.2, 1.3), (0.1, -0.35, 1.5), (0.25, 0.1, 1.1))
DONE = round(REACH_S * FPS)


@pytest.fixture(scope="module")
def features() -> np.ndarray:
    """Somebody who waves, turning on the spot: neither place nor heading are the world's."""
    rows = motion_to_features(load_generator("gestures").generate("wave with the left hand", seconds=3.0))
    rows[:, 0], rows[:, 1] = 0.8, 0.5
    return rows.astype(float)


def at(features: np.ndarray) -> np.ndarray:
    """Joints (T, 22, 3) in the heading frame, from below the pelvis."""
    still = np.array(features)
    still[:, :3] = 0.0
    return features_to_motion(still, BODY).positions()


@pytest.mark.parametrize("place", PLACES)
def test_wrist_gets_there_in_time_and_stays_and_nothing_else_moves(
    features: np.ndarray, place: tuple[float, float, float]
) -> None:
    before, after = at(features), at(reached(features, BODY, Hands(right=place)))
    assert np.linalg.norm(after[DONE:, WRISTS[1]] - place, axis=1).max() < 1e-6
    assert np.abs(after[0] - before[0]).max() < 0.01
    fastest = np.linalg.norm(np.diff(after[:, WRISTS[1]], axis=0), axis=1).max() * FPS
    assert fastest < 2.0 * np.linalg.norm(before[0, WRISTS[1]] - place) / REACH_S  # a minimum jerk's peak is 15/8
    others = [j for j in range(len(SMPL_JOINTS)) if j not in ARMS[1][1:]]
    assert np.abs(after[:, others] - before[:, others]).max() < 1e-9


def test_arm_is_as_long_as_it_was_and_a_later_chunk_goes_on(features: np.ndarray) -> None:
    place = PLACES[0]
    whole = reached(features, BODY, Hands(right=place))
    parts = [
        reached(features[:7], BODY, Hands(right=place)),
        reached(features[7:], BODY, Hands(right=place, since=7)),
    ]
    assert np.concatenate(parts) == pytest.approx(whole, abs=1e-9)
    for a, b in pairwise(ARMS[1]):
        lengths = np.linalg.norm(at(whole)[:, a] - at(whole)[:, b], axis=1)
        assert lengths == pytest.approx(np.linalg.norm(BODY.offsets[b]))


def test_what_is_out_of_reach_is_pointed_at(features: np.ndarray) -> None:
    far = np.array([0.8, -0.2, 1.6])
    shoulder, elbow, wrist = (at(reached(features, BODY, Hands(left=tuple(far), since=DONE)))[:, j] for j in ARMS[0])
    for a, b in ((shoulder, elbow), (elbow, wrist)):
        way = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
        aim = (far - shoulder) / np.linalg.norm(far - shoulder, axis=1, keepdims=True)
        assert (way * aim).sum(1).min() > 0.98


def test_without_places_all_stays(features: np.ndarray) -> None:
    assert reached(features, BODY, Hands()) is features
