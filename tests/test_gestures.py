"""Gestures do what they are asked, measured on the motion itself."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from motions import at, excursions

from motiongen.features import mirror, motion_to_features
from motiongen.gestures.catalogue import gestures, perform, sample
from motiongen.gestures.pose import reach
from motiongen.measure.legs import runs
from motiongen.motion import FOOT_JOINTS, Motion
from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate, quat_to_rotvec

FAMILIES = tuple(gestures())
SIDED = tuple(name for name, family in gestures().items() if "left" in family.sides)
GOING = ("turn", "step-forward", "step-back", "sidestep")
COUNTED = tuple(name for name, family in gestures().items() if family.repeats)


def pointing(motion: Motion, joint: str, axis: tuple[float, float, float]) -> Array:
    """World direction (T, 3) of an axis of a joint's frame."""
    return quat_rotate(motion.global_quat()[:, motion.skeleton.index(joint)], axis)


@cache
def extremes(name: str) -> tuple[Motion, ...]:
    """A family at its slowest and smallest and at its fastest and largest, on every side."""
    family = gestures()[name]
    count = 2 if family.repeats else 1
    return tuple(
        perform(name, side=side, count=count, speed=family.speeds[i], amplitude=family.amplitudes[i], seed=i)
        for side in family.sides or (None,)
        for i in (0, 1)
    )


# ---- Every family


def test_there_are_enough() -> None:
    assert len(FAMILIES) >= 30


@pytest.mark.parametrize("name", FAMILIES)
def test_feet_stay_planted_and_nobody_sinks_or_flies(name: str) -> None:
    for motion in extremes(name):
        assert motion.contacts is not None
        stand = np.tile(motion.skeleton.foot_height, 2)
        feet = np.stack([at(motion, joint) for joint in FOOT_JOINTS], axis=1)
        assert (feet[..., 2] > stand - 2e-3).all()
        for i in range(4):
            down = motion.contacts[:, i]
            for first, last in runs(down):
                assert np.ptp(feet[first : last + 1, i], axis=0).max() < 2e-3
            assert name in GOING or np.abs(feet[down, i] - feet[0, i]).max() < 2e-3
            assert np.abs(feet[~down, i] - feet[0, i]).max(initial=0.0) == 0 or name in {
                "march", "stand-on-one-leg", "raise-knee", "kick", "jump", "tiptoe", *GOING,
            }  # fmt: skip
        assert motion.contacts[0].all()
        assert motion.contacts[-1].all()


@pytest.mark.parametrize("name", FAMILIES)
def test_joints_move_as_fast_as_people_and_knees_bend_forward(name: str) -> None:
    for motion in extremes(name):
        step = quat_mul(quat_conj(motion.joint_quat[:-1]), motion.joint_quat[1:])
        assert np.linalg.norm(quat_to_rotvec(step), axis=-1).max() * motion.fps < 15
        for side in ("left", "right"):
            knee = quat_to_rotvec(motion.joint_quat[:, motion.skeleton.index(f"{side}_knee")])
            assert (knee[:, 1] > 0).all()


@pytest.mark.parametrize("name", FAMILIES)
def test_hands_stay_out_of_the_trunk_and_the_head(name: str) -> None:
    for motion in extremes(name):
        head = at(motion, "head") + 0.09 * pointing(motion, "head", (0, 0, 1))
        middle = at(motion, "spine3")
        for side in ("left", "right"):
            hand = at(motion, f"{side}_wrist")
            assert np.linalg.norm(hand - head, axis=1).min() > 0.10
            assert np.linalg.norm(hand - middle, axis=1).min() > 0.10


@pytest.mark.parametrize("name", FAMILIES)
def test_it_starts_and_ends_standing_and_lives(name: str) -> None:
    motion = perform(name, count=2 if name in GOING and name in COUNTED else 1)
    for frame in (0, -1):
        assert abs(motion.root_pos[frame, 2] - perform("idle").root_pos[0, 2]) < 0.005
        for side in ("left", "right"):
            assert at(motion, f"{side}_wrist")[frame, 2] < motion.root_pos[frame, 2]
    assert np.abs(np.diff(motion.joint_quat, axis=0)).max(axis=(1, 2)).min() > 0  # never quite still
    assert motion.source.generator == f"gesture {name}"
    assert motion.source.licence == "Apache-2.0"


@pytest.mark.parametrize("name", FAMILIES)
def test_the_same_seed_is_the_same_motion_and_another_is_not(name: str) -> None:
    one, same, other = perform(name, seed=3), perform(name, seed=3), perform(name, seed=4)
    assert np.array_equal(one.joint_quat, same.joint_quat)
    assert len(other) != len(one) or not np.allclose(other.joint_quat, one.joint_quat)


@pytest.mark.parametrize("name", FAMILIES)
def test_twice_as_slow_takes_twice_as_long(name: str) -> None:
    family = gestures()[name]
    slow, fast = (perform(name, speed=speed, fps=60) for speed in family.speeds)
    assert slow.duration / fast.duration == pytest.approx(family.speeds[1] / family.speeds[0], rel=0.02)


@pytest.mark.parametrize("name", SIDED)
def test_the_left_is_the_mirror_image_of_the_right(name: str) -> None:
    right, left = perform(name, side="right", seed=5), perform(name, side="left", seed=5)
    flip = right.positions() * [1, -1, 1]
    for joint in right.skeleton.names:
        partner = joint.replace("left", "?").replace("right", "left").replace("?", "right")
        assert np.abs(flip[:, right.skeleton.index(joint)] - at(left, partner)).max() < 1e-9
    assert np.allclose(mirror(motion_to_features(right)), motion_to_features(left), atol=1e-4)


# ---- What single families do


@pytest.mark.parametrize("count", [1, 3, 6])
@pytest.mark.parametrize("speed", [0.6, 1.4])
def test_counts_are_counted_in_the_motion(count: int, speed: float) -> None:
    def of(name: str) -> Motion:
        return perform(name, count=count, speed=speed, seed=count)

    nod = -pointing(of("nod"), "head", (1, 0, 0))[:, 2]
    assert excursions(nod, 0.25, 0.1) == count
    shake = pointing(of("shake-head"), "head", (1, 0, 0))[:, 1]
    assert excursions(shake, 0.3, -0.3) == count
    clap = of("clap")
    gap = np.linalg.norm(at(clap, "left_wrist") - at(clap, "right_wrist"), axis=1)
    assert gap.min() < 0.12
    assert excursions(-gap, -0.15, -0.22) == count
    squat = of("squat").root_pos[:, 2]
    assert excursions(squat[0] - squat, 0.2, 0.05) == count
    wave = of("wave")
    swing = at(wave, "right_elbow")[:, 1] - at(wave, "right_wrist")[:, 1]  # outward of the elbow
    up = at(wave, "right_wrist")[:, 2] > at(wave, "right_elbow")[:, 2] + 0.15
    assert excursions(-swing[up], 0.02, -0.04) == count
    kick = of("kick") if speed < 1 else perform("kick", count=count)
    assert excursions(at(kick, "right_ankle")[:, 0], 0.45, 0.1) == count
    punch = of("punch") if speed < 1 else perform("punch", count=count)
    assert excursions(at(punch, "right_wrist")[:, 0], 0.42, 0.32) == count
    march = of("march")
    lifted = [excursions(at(march, f"{side}_ankle")[:, 2], 0.2, 0.13) for side in ("left", "right")]
    assert sum(lifted) == count
    assert abs(lifted[0] - lifted[1]) <= 1
    if speed > 1:
        jump = perform("jump", count=count)
        assert excursions(at(jump, "left_foot")[:, 2], 0.08, 0.05) == count


@pytest.mark.parametrize("degrees", [30, 60, 120])
@pytest.mark.parametrize("side", ["left", "right"])
def test_an_arm_is_raised_to_the_angle(degrees: int, side: str) -> None:
    for name, forward in (("raise-arm", True), ("raise-arm-sideways", False)):
        motion = perform(name, side=side, amplitude=degrees / 90)
        arm = at(motion, f"{side}_wrist") - at(motion, f"{side}_shoulder")
        other = at(motion, f"{'left' if side == 'right' else 'right'}_wrist")
        frame = len(motion) // 2
        assert np.degrees(np.arccos(-arm[frame, 2] / np.linalg.norm(arm[frame]))) == pytest.approx(degrees, abs=4)
        outward = arm[frame, 1] * (1 if side == "left" else -1)
        assert (arm[frame, 0] if forward else outward) > 0.2
        assert np.abs(other - other[0]).max() < 0.08


@pytest.mark.parametrize(("name", "joint", "axis", "towards"), [
    ("bow", "spine3", (0, 0, 1), (1, 0, 0)),
    ("lean-forward", "spine3", (0, 0, 1), (1, 0, 0)),
    ("lean", "spine3", (0, 0, 1), (0, -1, 0)),
    ("twist", "spine3", (1, 0, 0), (0, -1, 0)),
    ("look", "head", (1, 0, 0), (0, -1, 0)),
    ("look-up", "head", (1, 0, 0), (0, 0, 1)),
    ("look-down", "head", (1, 0, 0), (0, 0, -1)),
])  # fmt: skip
@pytest.mark.parametrize("amplitude", [0.5, 1.0, 1.3])
def test_angles_are_reached(
    name: str, joint: str, axis: tuple[float, float, float], towards: tuple[float, float, float], amplitude: float
) -> None:
    motion = perform(name, amplitude=amplitude)
    reached = np.degrees(np.arcsin(np.clip(pointing(motion, joint, axis) @ np.array(towards), -1, 1))).max()
    assert reached == pytest.approx(gestures()[name].degrees * amplitude, abs=3)


def test_pointing_points() -> None:
    for name, way in (("point", (0, -1, 0)), ("point-forward", (1, 0, 0)), ("point-up", (0, 0, 1))):
        motion = perform(name)
        arm = at(motion, "right_wrist") - at(motion, "right_shoulder")
        assert (arm[len(motion) // 2] @ np.array(way)) / np.linalg.norm(arm[len(motion) // 2]) > 0.95


def test_a_jump_flies_as_gravity_has_it() -> None:
    motion = perform("jump", fps=240)
    assert motion.contacts is not None
    air = ~motion.contacts.any(axis=1)
    height = motion.root_pos[air, 2]
    fall = np.polyfit(np.arange(len(height)) / motion.fps, height, 2)[0] * 2
    assert fall == pytest.approx(-9.81, rel=0.12)  # timing is uneven by up to 4 %
    assert at(motion, "left_foot")[:, 2].max() - motion.skeleton.foot_height[1] == pytest.approx(0.10, abs=0.005)


def test_one_leg_bears_who_stands_on_it() -> None:
    motion = perform("stand-on-one-leg", side="right")
    middle = len(motion) // 2
    assert at(motion, "right_ankle")[middle, 2] > 0.3
    assert abs(motion.root_pos[middle, 1] - at(motion, "left_ankle")[middle, 1]) < 0.02


def test_a_hand_goes_where_it_is_sent() -> None:
    from motiongen.gestures.body import FOREARM, SHOULDER, UPPER_ARM

    for hand in ((0.3, 0.03, -0.1), (0.1, 0.2, 0.14), (0.04, 0.19, -0.29)):
        arm = reach(hand)
        assert np.linalg.norm(arm.upper) == pytest.approx(UPPER_ARM)
        assert np.linalg.norm(arm.fore) == pytest.approx(FOREARM)
        assert np.allclose(np.array(arm.upper) + arm.fore, np.array(hand) - [0, SHOULDER, 0])
    with pytest.raises(ValueError, match=r"no arm reaches \(0.9"):
        reach((0.9, 0, 0))


# ---- Corpus, mistakes, and text


def test_samples_are_drawn_alike_from_alike_seeds() -> None:
    (one, said), (same, again) = (sample(np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(one.joint_quat, same.joint_quat)
    assert said == again
    rng = np.random.default_rng(0)
    drawn = [sample(rng) for _ in range(60)]
    assert len({motion.source.generator for motion, _ in drawn}) > 25
    assert all(motion.labels[0].text in captions for motion, captions in drawn)


@pytest.mark.parametrize(("wrong", "says"), [
    ({"name": "fly"}, r"unknown gesture 'fly'; known are nod, "),
    ({"name": "nod", "side": "left"}, r"nod: side 'left'; it has no sides"),
    ({"name": "salute", "side": "both"}, r"salute: side 'both'; it takes right or left"),
    ({"name": "nod", "count": 0}, r"nod: count 0; 1 to 20 are possible"),
    ({"name": "salute", "count": 2}, r"salute: count 2; only 1 is possible"),
    ({"name": "nod", "speed": 9.0}, r"nod: speed 9; 0.5 to 1.6 is possible"),
    ({"name": "nod", "speed": float("nan")}, r"nod: speed nan"),
    ({"name": "bow", "amplitude": 3.0}, r"bow: amplitude 3; .* which is 10 to 70 degrees"),
    ({"name": "nod", "fps": 0.0}, r"fps must be above 0, not 0"),
    ({"name": "nod", "seconds": 0.5}, r"0.5 seconds; this gesture takes"),
])  # fmt: skip
def test_mistakes_name_the_value_and_the_good_ones(wrong: dict, says: str) -> None:
    with pytest.raises(ValueError, match=says) as caught:
        perform(**wrong)
    assert "\n" not in str(caught.value)
