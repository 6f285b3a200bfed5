"""What the models in the tree do when asked, measured on the motion itself, by a majority over seeds."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from motions import stand

from motiongen.diffusion.finish import slip
from motiongen.diffusion.promised import turn_asked
from motiongen.diffusion.weights import FOLDER, WeightsError, load_weights, save_weights
from motiongen.generator import PromptError, check_prompt, load_generator
from motiongen.motion import Motion
from motiongen.rotation import quat_mul, yaw_of_quat, yaw_quat

WEIGHTS = FOLDER / "mdm.safetensors"
SEEDS = range(1, 6)


@pytest.fixture(scope="module", params=["mdm", "motiondiffuse"])
def generator(request: pytest.FixtureRequest):
    return load_generator(request.param)


def height(motion: Motion, joint: str) -> np.ndarray:
    return motion.positions()[:, motion.skeleton.index(joint), 2]


def raised(motion: Motion, side: str) -> bool:
    return bool((height(motion, f"{side}_wrist") > height(motion, f"{side}_shoulder")).mean() > 0.1)


def swings(motion: Motion, side: str) -> int:
    """How often the wrist turns back sideways by more than 3 cm while it is up, seen from the chest."""
    at, up = motion.positions(), height(motion, f"{side}_wrist") > height(motion, f"{side}_shoulder")
    yaw = np.arctan2(*(at[:, motion.skeleton.index("left_hip")] - at[:, motion.skeleton.index("right_hip")])[:, :2].T)
    rel = at[:, motion.skeleton.index(f"{side}_wrist")] - at[:, motion.skeleton.index("spine3")]
    across = (np.sin(yaw) * rel[:, 0] + np.cos(yaw) * rel[:, 1])[up]
    turns, last = 0, across[0] if len(across) else 0.0
    direction = 0.0
    for value in across:
        if abs(value - last) > 0.03:
            turns += bool(direction * (value - last) < 0)
            direction, last = np.sign(value - last), value
        elif direction * (value - last) > 0:
            last = value
    return turns


def turned(motion: Motion) -> float:
    """Degrees, left positive, from the first frame to the last, followed from frame to frame."""
    return float(np.degrees(np.sum(np.diff(np.unwrap(yaw_of_quat(motion.joint_quat[:, 0]))))))


@pytest.mark.parametrize(
    ("text", "degrees"),
    [("turn left ninety degrees", 90), ("turn 135 degrees to the right", -135), ("turn around to the left", 180)],
)
def test_a_turn_is_as_far_as_is_said(generator, text: str, degrees: float) -> None:
    for motion in generator.generate_batch([text, "walk forward", text], seed=1)[::2]:
        assert turned(motion) == pytest.approx(degrees, abs=5)


def test_only_a_turn_alone_is_promised() -> None:
    assert turn_asked("turn right 45 degrees") == pytest.approx(-np.pi / 4)
    assert all(np.isnan(turn_asked(text)) for text in ("turn left", "bow 40 degrees", "turn left 90 degrees, then bow"))


def travel(motion: Motion) -> float:
    """Metres along the facing of the first frame, which is +x."""
    return float(motion.root_pos[-1, 0] - motion.root_pos[0, 0])


def speed(motion: Motion) -> float:
    """Metres a second along the path."""
    return float(np.linalg.norm(np.diff(motion.root_pos[:, :2], axis=0), axis=1).sum() / motion.duration)


def most(results: list[bool]) -> bool:
    return sum(results) > len(results) / 2


@pytest.mark.parametrize(("side", "other"), [("right", "left"), ("left", "right")])
def test_the_hand_that_was_asked_for_waves(generator, side: str, other: str) -> None:
    motions = [generator.generate(f"a person waves with the {side} hand", seed=s) for s in SEEDS]
    assert most([raised(m, side) and swings(m, side) >= 2 and not raised(m, other) for m in motions])


def test_walking_forward_gets_somewhere(generator) -> None:
    assert most([travel(generator.generate("walk forward", seed=s)) > 0.5 for s in SEEDS])


def test_running_is_faster_than_walking(generator) -> None:
    pairs = [[speed(generator.generate(t, seed=s, seconds=3)) for t in ("run", "walk")] for s in SEEDS]
    assert most([run > walk for run, walk in pairs])


def test_the_exhausted_are_slower_than_the_active(generator) -> None:
    said = ("an exhausted person walks", "a person walks actively")
    pairs = [[speed(generator.generate(t, seed=s, seconds=4)) for t in said] for s in SEEDS]
    assert most([tired < active for tired, active in pairs])


def test_both_hands_go_up(generator) -> None:
    motions = [generator.generate("raise both hands", seed=s) for s in SEEDS]
    assert most([raised(m, "left") and raised(m, "right") for m in motions])


def test_turns_go_the_way_that_was_said(generator) -> None:
    for side, sign in (("left", 1), ("right", -1)):
        drift = [generator.generate(f"walk and turn {side}", seed=s).root_pos[-1, 1] for s in SEEDS]
        assert most([sign * y > 0.2 for y in drift]), side


def test_feet_that_should_stand_do() -> None:
    generator, slips = (
        load_generator("mdm"),
        [],
    )  # the other learns no losses of feet and speeds, and its feet slide more
    for seed in SEEDS:
        motion = generator.generate("walk forward", seed=seed, seconds=4)
        toes = motion.positions()[:, [motion.skeleton.index("left_foot"), motion.skeleton.index("right_foot")], :2]
        touch = motion.contacts[:, [1, 3]]
        speed = np.linalg.norm(np.diff(toes, axis=0), axis=-1) * motion.fps
        slips.append(speed[touch[1:] & touch[:-1]].mean())
    assert most([slip < 0.25 for slip in slips]), slips


def test_same_seed_same_motion_and_another_seed_another(generator) -> None:
    a, b, c = (generator.generate("bow", seed=s).joint_quat for s in (3, 3, 4))
    assert (a == b).all()
    assert a.shape != c.shape or np.abs(a - c).max() > 1e-3


def test_a_batch_draws_what_single_calls_draw(generator) -> None:
    alone = generator.generate("walk", seed=8, seconds=3)
    for seeds in (7, [3, 8]):
        batch = generator.generate_batch(["bow", "walk"], seed=seeds, seconds=3)[1]
        assert np.abs(alone.positions() - batch.positions()).max() < 1e-3


@pytest.mark.parametrize("seconds", [1.0, 2.5, 6.0, 14.0])
def test_length_is_what_was_asked(generator, seconds: float) -> None:
    motion = generator.generate("walk forward", seconds=seconds, seed=1)
    assert len(motion) == round(seconds * 30)
    step = np.linalg.norm(np.diff(motion.positions(), axis=0), axis=-1) * motion.fps
    assert step.max() < 15  # metres a second: no jump at the seams of windows


def test_it_knows_what_it_does_not_know(generator) -> None:
    assert generator.familiarity("a person waves with the left hand").known
    strange = generator.familiarity("solve a cubic equation")
    assert not strange.known
    assert len(strange.nearest) == 3


def test_motion_says_where_it_came_from(generator) -> None:
    motion = generator.generate("walk", seed=5)
    assert motion.source.seed == 5
    assert motion.source.weights == generator.digest
    assert "NC" in motion.source.licence
    assert motion.labels[0].text == "walk"
    assert WEIGHTS.stat().st_size <= 10_000_000


@pytest.mark.parametrize("text", ["", "   \n", "x" * 10_000])
def test_no_text_and_too_much(text: str) -> None:
    with pytest.raises(PromptError):
        check_prompt(text)


@pytest.mark.parametrize("seconds", [0.0, -3.0, 61.0, float("nan"), float("inf")])
def test_impossible_lengths(seconds: float) -> None:
    with pytest.raises(PromptError, match="between 1 and 60"):
        check_prompt("walk", seconds)


def test_unknown_generator_lists_the_known() -> None:
    with pytest.raises(PromptError, match=r"no generator 'gpt'.*mdm"):
        load_generator("gpt")


def test_weights_survive_the_round_trip_and_nothing_else_does(tmp_path: Path) -> None:
    weights = load_weights(WEIGHTS)
    copy = tmp_path / "copy.safetensors"
    save_weights(dataclasses.replace(weights, digest=""), copy)
    again = load_weights(copy)
    assert all((again.tensors[k] == v).all() for k, v in weights.tensors.items())
    assert (again.bank.vectors == weights.bank.vectors).all()
    data = copy.read_bytes()
    for broken in (data[: len(data) // 2], b"", b"\x80\x04K\x01.", b"PK\x03\x04" + data[:100]):
        copy.write_bytes(broken)
        with pytest.raises(WeightsError, match="cut short or of another model"):
            load_weights(copy)
    with pytest.raises(WeightsError, match="no such"):
        load_weights(tmp_path / "none.safetensors")


def test_slip_is_the_speed_of_feet_that_should_stand() -> None:
    """Somebody who faces left and is dragged along +x at 0.3 m/s slips to their own right."""
    still = stand(1.0)
    t = np.arange(len(still)) / still.fps
    quat = still.joint_quat.copy()
    quat[:, 0] = quat_mul(yaw_quat(np.pi / 2), quat[:, 0])
    dragged = dataclasses.replace(still, root_pos=still.root_pos + np.outer(t, [0.3, 0, 0]), joint_quat=quat)
    found = slip(dragged, np.ones((len(t), 4)))
    assert found[5:-5] == pytest.approx(np.tile([0.0, -0.3], (len(t) - 10, 1)), abs=1e-6)
    assert np.abs(slip(dragged, np.zeros((len(t), 4)))).max() == 0
