"""Turns on the spot and counted steps go as far, and the way, that they say, on feet that stand or swing."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from motiongen.generator import PromptError, load_generator
from motiongen.gestures.catalogue import gestures, perform
from motiongen.gestures.pose import Pose, Step
from motiongen.gestures.reading import read
from motiongen.gestures.track import play
from motiongen.measure.clip import observe
from motiongen.measure.legs import runs
from motiongen.motion import Motion
from motiongen.rotation import Array, quat_to_rotvec
from motiongen.text.asking import asked_of
from motiongen.text.claims import holds

STEPS = {"step-forward": (1, 0), "step-back": (-1, 0), "sidestep": (0, -1)}  # the way, of the right side
PAIR_M = {"step-forward": 0.40, "step-back": 0.30, "sidestep": 0.28}
DEGREES = (30, 45, 72, 90, 120, 180, 270, 360)


@cache
def going() -> tuple[Motion, ...]:
    """Turns and steps, slow and quick, small and large, to both sides."""
    out = []
    for name in ("turn", *STEPS):
        family = gestures()[name]
        for i, side in enumerate(family.sides or (None,)):
            for k, speed in enumerate((family.speeds[0], 1.0, family.speeds[1])):
                amplitude = family.amplitudes[(i + k) % 2]
                count = 3 + k if family.repeats else 1
                out.append(perform(name, side=side, count=count, speed=speed, amplitude=amplitude, seed=k))
    return tuple(out)


def ankles(motion: Motion) -> Array:
    """Where the ankles are (T, 2, 3): left, right."""
    return motion.positions()[:, [motion.skeleton.index(f"{side}_ankle") for side in ("left", "right")]]


def lifted(motion: Motion) -> list[tuple[int, int]]:
    """How often a sole is 1 cm and more off the floor: first frame and foot (0 left) of each swing, in order."""
    toes = motion.positions()[:, [motion.skeleton.index(f"{side}_foot") for side in ("left", "right")], 2]
    up = toes > motion.skeleton.foot_height[1] + 0.01
    return sorted((first, foot) for foot in (0, 1) for first, _ in runs(up[:, foot]))


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("side", ["left", "right"])
def test_turns_are_as_far_as_was_asked(degrees: int, side: str) -> None:
    sign = 1 if side == "left" else -1
    for seed, speed in enumerate((0.5, 1.0, 1.6)):
        motion = perform("turn", side=side, amplitude=degrees / 90, speed=speed, seed=seed)
        assert observe(motion).totals.turn_deg == pytest.approx(sign * degrees, abs=3)
        for foot in ("left", "right"):  # both soles point where the body faces, side by side, around where it began
            at = motion.positions()[-1]
            sole = at[motion.skeleton.index(f"{foot}_foot")] - at[motion.skeleton.index(f"{foot}_ankle")]
            facing = np.radians(sign * degrees)
            assert sole[:2] @ [np.cos(facing), np.sin(facing)] == pytest.approx(np.linalg.norm(sole[:2]), abs=1e-3)
        assert np.linalg.norm(ankles(motion)[-1].mean(0)[:2]) < 1e-6


def test_the_head_turns_before_the_feet() -> None:
    motion = perform("turn", side="left")
    turned = quat_to_rotvec(motion.global_quat()[:, [0, motion.skeleton.index("head")]])[..., 2]
    pelvis, head = (int(np.argmax(np.degrees(turned[:, i]) > 30)) for i in (0, 1))
    assert head < pelvis - 3


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("name", STEPS)
def test_steps_are_counted_go_their_way_and_take_turns(name: str, count: int) -> None:
    sides = gestures()[name].sides
    side = sides[count % 2] if sides else None
    speeds, amplitudes = gestures()[name].speeds, gestures()[name].amplitudes
    for seed in range(4):
        speed, amplitude = speeds[seed % 2], amplitudes[seed // 2 % 2]
        motion = perform(name, count=count, side=side, speed=speed, amplitude=amplitude, seed=seed)
        seen = observe(motion)
        assert seen.totals.steps == count
        swings = lifted(motion)
        assert len(swings) == count
        assert all(one != other for (_, one), (_, other) in pairwise(swings))
        assert swings[0][1] == (0 if side == "left" else 1)
        way = np.array(STEPS[name]) * (1, -1 if side == "left" else 1)
        ends = ankles(motion)[[0, -1], :, :2]
        went = (ends[1].mean(0) - ends[0].mean(0)) @ way
        assert went == pytest.approx(amplitude * expected(name, count), abs=1e-6)
        assert np.array(seen.ahead_m) @ way == pytest.approx(went, abs=0.03)
        assert abs(seen.totals.turn_deg) < 3


def expected(name: str, count: int) -> float:
    """Metres that the middle of the feet goes: single steps move it by half."""
    if name == "sidestep":
        return PAIR_M[name] * (count // 2) + 0.125 * (count % 2)
    return PAIR_M[name] * (count - 1) if count > 1 else 0.125


@pytest.mark.parametrize(
    ("name", "count"), [("step-forward", 2), ("step-forward", 3), ("step-back", 5), ("sidestep", 4)]
)
def test_the_last_step_closes_the_feet(name: str, count: int) -> None:
    apart = np.diff(ankles(perform(name, count=count)), axis=1)[[0, -1], 0]
    np.testing.assert_allclose(apart[1], apart[0], atol=1e-6)


@pytest.mark.parametrize("index", range(len(going())))
def test_soles_on_the_floor_do_not_move(index: int) -> None:
    motion = going()[index]
    for foot in ("left", "right"):
        both = motion.positions()[:, [motion.skeleton.index(f"{foot}_{part}") for part in ("ankle", "foot")]]
        flat = (np.abs(both[..., 2] - motion.skeleton.foot_height) < 2e-3).all(1)
        for first, last in runs(flat):
            assert np.ptp(both[first : last + 1], axis=0).max() < 0.01
    assert observe(motion).skate < 0.28  # Bandai-Namco's walks have 0.28 to 0.34


@pytest.mark.parametrize("index", range(len(going())))
def test_legs_stay_within_what_people_can_and_out_of_each_others_way(index: int) -> None:
    motion = going()[index]
    assert np.linalg.norm(np.diff(ankles(motion), axis=1), axis=2).min() > 0.12
    for side in ("left", "right"):
        out = -1 if side == "left" else 1
        hip, knee, ankle = (
            np.degrees(quat_to_rotvec(motion.joint_quat[:, motion.skeleton.index(f"{side}_{joint}")]))
            for joint in ("hip", "knee", "ankle")
        )
        assert (np.abs(hip[:, 0]) < 30).all()  # to the side
        assert ((hip[:, 1] > -70) & (hip[:, 1] < 30)).all()  # forward is negative
        assert ((-out * hip[:, 2] > -35) & (-out * hip[:, 2] < 45)).all()  # toes out
        assert ((knee[:, 1] > 0) & (knee[:, 1] < 95)).all()
        assert ((ankle[:, 1] > -35) & (ankle[:, 1] < 45)).all()


def test_the_body_goes_on_while_it_walks() -> None:
    motion = perform("step-forward", count=6)
    speed = np.gradient(motion.root_pos[:, 0]) * motion.fps
    middle = np.searchsorted(motion.root_pos[:, 0], [0.4, 1.8])
    assert speed[slice(*middle)].min() > 0.3
    arms = [motion.positions()[:, motion.skeleton.index(f"{side}_wrist"), 0] for side in ("left", "right")]
    feet = ankles(motion)[..., 0]
    apart = np.corrcoef((arms[0] - arms[1])[slice(*middle)], (feet[:, 0] - feet[:, 1])[slice(*middle)])[0, 1]
    assert apart < -0.8  # arms swing against the legs
    height = motion.root_pos[slice(*middle), 2]
    assert 0.01 < np.ptp(height) < 0.06
    assert 0.02 < np.ptp(motion.root_pos[slice(*middle), 1]) < 0.12


def test_flow_is_the_monotone_cubic_of_scipy() -> None:
    from scipy.interpolate import PchipInterpolator

    rng = np.random.default_rng(1)
    x, spans = rng.normal(size=8), rng.uniform(0.2, 0.6, 9)
    steps = [
        Step(0.3, Pose()), *(Step(float(s), Pose(shift=(a, 0, 0)), "flow") for s, a in zip(spans, x, strict=False)),
        Step(0.4, Pose(shift=(x[-1], 0, 0))),
    ]  # fmt: skip
    times, keys = np.cumsum([0.3, *spans[:8]]), np.array([0.0, *x])
    # Rest on both sides, as what does not flow is: flat ends.
    slopes = PchipInterpolator([-1.0, *times, times[-1] + 1], [0.0, *keys, keys[-1]])
    found = play(steps, 1.0, 100.0).shift[:, 0]
    at = np.arange(len(found)) / 100
    inside = (at >= times[0]) & (at <= times[-1])
    np.testing.assert_allclose(found[inside], slopes(at[inside]), atol=1e-9)


# ---- What is said


@pytest.mark.parametrize("degrees", gestures()["turn"].named)
def test_angles_by_name(degrees: int) -> None:
    family = gestures()["turn"]
    captions = family.captions(family.params(side="left", amplitude=degrees / 90))
    said = [read(caption) for caption in captions]
    assert {request.name for request in said} == {"turn"}
    assert {request.side for request in said} == {"left"}
    assert {request.degrees for request in said} - {None} == {degrees}
    assert any("degrees" not in caption for caption in captions) or not family.named[degrees]


@pytest.mark.parametrize(("text", "name", "side", "count", "degrees"), [
    ("turn left 90 degrees", "turn", "left", None, 90),
    ("rotates on the spot to the right, 120 degrees", "turn", "right", None, 120),
    ("turn around", "turn", None, None, 180),
    ("makes a quarter turn to the left", "turn", "left", None, 90),
    ("spin around", "turn", None, None, 360),
    ("turn to the right", "turn", "right", None, None),
    ("take three steps", "step-forward", None, 3, None),
    ("walks four steps forward", "step-forward", None, 4, None),
    ("take a step", "step-forward", None, 1, None),
    ("steps back twice", "step-back", None, 2, None),
    ("goes two steps backwards", "step-back", None, 2, None),
    ("sidesteps three times to the left", "sidestep", "left", 3, None),
    ("takes two steps to the right", "sidestep", "right", 2, None),
    ("take two steps forward with the left foot first", "step-forward", "left", 2, None),
    ("march four steps in place", "march", None, 4, None),
    ("turn your head to the left", "look", "left", None, None),
    ("turn the upper body to the right", "twist", "right", None, None),
    ("look around", "look-around", None, None, None),
])  # fmt: skip
def test_going_is_read(text: str, name: str, side: str | None, count: int | None, degrees: float | None) -> None:
    request = read(text)
    assert (request.name, request.side, request.count, request.degrees) == (name, side, count, degrees)


@pytest.mark.parametrize("text", [
    "turn left 90 degrees", "turn right", "turn around", "turn forty-five degrees to the right", "take three steps",
    "walk four steps forward", "take a step back", "step back twice", "sidestep three times to the left",
    "take two steps to the right", "take five steps slowly",
])  # fmt: skip
def test_what_is_said_is_done(text: str) -> None:
    asked = asked_of(text)
    assert asked is not None
    assert asked.claims[0].action in ("turn", "step")
    model = load_generator("gestures")
    assert model.familiarity(text).known
    assert holds(asked, observe(model.generate(text, seed=1)))


def test_who_has_arrived_stands_there() -> None:
    motion = load_generator("gestures").generate("take two steps forward", seconds=8.0)
    assert motion.duration == pytest.approx(8.0, abs=0.02)
    assert motion.root_pos[len(motion) // 2 :, 0].min() > 0.38


@pytest.mark.parametrize(("text", "says"), [
    ("turn left 400 degrees", r"turn: amplitude 4.44\d*; .*30 to 360 degrees"),
    ("take 30 steps back", "step-back: count 30; 1 to 20"),
])  # fmt: skip
def test_turns_and_steps_have_an_end(text: str, says: str) -> None:
    with pytest.raises(PromptError, match=says):
        load_generator("gestures").generate(text)
