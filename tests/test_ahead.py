"""The gate of a motion still being made: the same physics as of a whole trajectory, and a way to rest that holds."""

from __future__ import annotations

import numpy as np
import pytest

from retarget.rig import Rig, load_rig
from retarget.trajectory import Trajectory
from sim.ahead import CALM, HELD, SEEN, Gate, way_to_rest
from sim.scene import build_scene
from sim.simulate import run

FPS = 50.0
REACH = np.array([[-1.5, -1.5], [1.5, 1.5]])
SPEED = np.array([2.0, 4.0])


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("puppet")


@pytest.fixture(scope="module")
def rest(rig: Rig) -> np.ndarray:
    out = np.zeros(7 + len(rig.joints))
    out[2], out[3] = rig.nominal.height + rig.stand_clearance, 1.0
    out[7:] = rig.pose_vector(rig.nominal)
    return out


def raised(rig: Rig, rest: np.ndarray, angle: float, frames: int) -> np.ndarray:
    """One arm goes by `angle` rad and stays."""
    u = np.clip(np.arange(1, frames + 1) / (frames / 2), 0, 1)
    out = np.tile(rest, (frames, 1))
    out[:, 7 + rig.joint_names().index("right_elbow")] += angle * u * u * (3 - 2 * u)
    return out


def row(*joints: float) -> np.ndarray:
    return np.array([0, 0, 1, 1, 0, 0, 0, *joints])


@pytest.mark.parametrize(
    ("at", "rate"), [((1.0, -0.5), (0.0, 0.0)), ((1.4, 0.2), (1.5, -3.0)), ((0.0, 0.0), (-1.9, 2))]
)
def test_way_goes_on_from_the_speed_there_is_and_ends_at_rest(
    at: tuple[float, float], rate: tuple[float, float]
) -> None:
    asked = np.stack([row(*(np.array(at) - np.array(rate) / FPS)), row(*at)])
    way = way_to_rest(asked, row(0.1, 0.2), SPEED, REACH, FPS)
    speeds = np.diff(np.concatenate([asked[1:], way])[:, 7:], axis=0) * FPS
    assert np.abs(speeds[0] - rate).max() < 0.5
    assert (np.abs(speeds) <= np.maximum(CALM * SPEED, np.abs(rate)) + 1e-6).all()
    still = way[-round(HELD * FPS) :]
    assert np.allclose(still, row(0.1, 0.2))
    assert (way[:, 7:] >= REACH[0]).all()
    assert (way[:, 7:] <= REACH[1]).all()
    assert np.array_equal(way[:, :7], np.tile(row(0, 0)[:7], (len(way), 1)))


def test_stretches_one_by_one_are_the_whole(rig: Rig, rest: np.ndarray) -> None:
    whole = raised(rig, rest, 0.8, 40)
    gate = Gate(rig, rest, FPS)
    moment = gate.begin()
    for part in (whole[:7], whole[7:25], whole[25:]):
        verdict = gate.judge(moment, part)
        assert verdict.ok, verdict.failures
        moment = verdict.after
    rollout = run(
        build_scene(rig, "stand", rest),
        Trajectory(np.concatenate([rest[None], whole]), FPS, rig.name, rig.joint_names()),
    )
    scene = build_scene(rig, "stand", rest)
    reached = scene.rows(moment.physics[None, 1 : 1 + scene.model.nq])[0]
    assert np.abs(reached - rollout.qpos[-1 - SEEN])[7:].max() < 2e-3
    assert np.array_equal(moment.asked, whole[-SEEN:])


def test_too_fast_is_refused_and_changes_nothing(rig: Rig, rest: np.ndarray) -> None:
    gate = Gate(rig, rest, FPS)
    moment = gate.begin()
    slow = raised(rig, rest, 0.5, 30)
    first = gate.judge(moment, slow)
    refused = gate.judge(moment, raised(rig, rest, 1.9, 4))
    assert first.ok
    assert not refused.ok
    assert refused.failures
    again = gate.judge(moment, slow)
    assert again.ok
    assert np.array_equal(again.after.physics, first.after.physics)


def test_way_passes_as_a_stretch_of_its_own(rig: Rig, rest: np.ndarray) -> None:
    gate = Gate(rig, rest, FPS)
    verdict = gate.judge(gate.begin(), raised(rig, rest, 0.5, 24)[:8])  # in the middle of the move
    assert verdict.ok, verdict.failures
    after = gate.judge(verdict.after, verdict.way)
    assert after.ok, after.failures
    assert np.abs(after.after.physics - verdict.rested.physics)[1:].max() < 1e-6


def test_only_on_a_stand(rig: Rig, rest: np.ndarray) -> None:
    with pytest.raises(ValueError, match="live motion is for rigs on a stand, not free; --mount stand"):
        Gate(rig, rest, FPS, "free")
