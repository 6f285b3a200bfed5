"""What a clip says by itself, against gestures whose counts, sides and degrees are known, and synthetic walks."""

from __future__ import annotations

import os
from dataclasses import asdict, replace
from pathlib import Path

import motions
import numpy as np
import pytest

from motiongen.formats.bvh import read_bvh
from motiongen.formats.bvh_write import write_bvh
from motiongen.gestures.assemble import mirrored
from motiongen.gestures.catalogue import gestures, perform
from motiongen.measure.__main__ import main
from motiongen.measure.clip import Measured, measure
from motiongen.measure.legs import Feet, jumps
from motiongen.measure.swings import smoothed, turnings
from motiongen.motion import Motion, Skeleton
from motiongen.text.say_numbers import clauses, in_words, with_numbers

COUNTED = {
    "nod": "nods",
    "shake-head": "head_shakes",
    "clap": "claps",
    "squat": "squats",
    "jump": "jumps",
    "march": "steps",
}

GOING = ("turn", "step-forward", "step-back", "sidestep")


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("name", COUNTED)
def test_gestures_are_counted(name: str, count: int) -> None:
    family = gestures()[name]
    if (name, count) == ("march", 1):
        count = 0  # one lift of one foot is a raised knee
    (slow, fast), (small, large) = family.speeds, family.amplitudes
    for speed, amplitude in {(slow, small), (fast, small), (fast, large)}:
        found = measure(perform(name, count=count or 1, speed=speed, amplitude=amplitude, seed=count))
        assert getattr(found, COUNTED[name]) == count, (speed, amplitude)
        assert found.bows == 0


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("side", ["left", "right", "both"])
def test_waves_are_counted_on_their_side(side: str, count: int) -> None:
    for speed, amplitude in ((0.5, 0.5), (1.6, 0.5), (1.6, 1.4)):
        found = measure(perform("wave", side=side, count=count, speed=speed, amplitude=amplitude, seed=count))
        assert found.left_waves == (count if side != "right" else 0), (speed, amplitude)
        assert found.right_waves == (count if side != "left" else 0), (speed, amplitude)
        assert (found.left_raises, found.right_raises) == (side != "right", side != "left")


@pytest.mark.parametrize("degrees", [20, 30, 45, 60, 70])
def test_bows_are_as_deep_as_they_were_made(degrees: int) -> None:
    found = measure(perform("bow", amplitude=degrees / 40))
    assert found.bows == 1
    assert found.bow_deg == pytest.approx(degrees, abs=1.5)
    assert found.squats == 0


def test_jumps_are_as_high_as_they_were_made() -> None:
    for amplitude in (0.5, 1.0, 1.5):
        found = measure(perform("jump", amplitude=amplitude, count=2))
        assert found.jump_height_m == pytest.approx(0.10 * amplitude, abs=0.01)
        assert found.squats == found.steps == 0


@pytest.mark.parametrize(
    "name", sorted({*gestures()} - {*COUNTED, "wave", "sit", "celebrate", "lean-forward", "bow", *GOING})
)
def test_other_gestures_are_none_of_these(name: str) -> None:
    found = measure(perform(name))
    for what in ("left_waves", "right_waves", "nods", "head_shakes", "claps", "bows", "squats", "jumps", "steps"):
        assert getattr(found, what) == 0, what
    assert found.path_m < 0.1
    assert abs(found.turn_deg) < 5


@pytest.mark.parametrize("speed", [0.6, 1.2, 1.5])
@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_a_walk_has_its_steps_way_and_speed(speed: float, yaw: float) -> None:
    """1 s a stride: four strides of each foot in 4 s."""
    found = measure(motions.turned(motions.walk(speed=speed, seconds=4), yaw, np.array([3.0, -2.0, 0.0])))
    assert (found.left_steps, found.right_steps) == (4, 4)
    assert found.path_m == pytest.approx(4 * speed, abs=0.05)
    assert found.net_m == pytest.approx(4 * speed, abs=0.05)
    assert found.mean_speed_m_s == pytest.approx(speed, abs=0.02)
    assert abs(found.turn_deg) < 1
    assert found.jumps == found.squats == found.bows == found.nods == 0


def test_a_single_step_is_one() -> None:
    """From 0.5 to 1.05 s of the walk only the left foot swings."""
    walk = motions.walk()
    rows = slice(15, 32)
    found = measure(replace(walk, root_pos=walk.root_pos[rows], joint_quat=walk.joint_quat[rows]))
    assert (found.left_steps, found.right_steps) == (1, 0)


def test_a_circle_is_longer_than_its_ends_are_apart() -> None:
    """Once round a circle of 1 m: 2π m and 360 degrees, back where it began."""
    turn = np.linspace(0, 2 * np.pi, 241)
    stand = motions.stand(8)
    quat = stand.joint_quat.copy()
    quat[:, 0] = np.stack([np.cos(turn / 2), 0 * turn, 0 * turn, np.sin(turn / 2)], 1)
    root = stand.root_pos + np.stack([np.sin(turn), 1 - np.cos(turn), 0 * turn], 1)
    found = measure(replace(stand, root_pos=root, joint_quat=quat))
    assert found.path_m == pytest.approx(2 * np.pi, rel=0.01)
    assert found.net_m == pytest.approx(0, abs=1e-9)
    assert found.turn_deg == pytest.approx(360, abs=4)
    assert measure(mirrored(replace(stand, root_pos=root, joint_quat=quat))).turn_deg == pytest.approx(-360, abs=4)


def test_the_synthetic_wave_swings_in_three_times() -> None:
    """Its elbow bends furthest at 0.25, 1.25, 2.25 and 3.25 s, at the first of them with the hand still down."""
    found = measure(motions.wave("left", seconds=4))
    assert (found.left_waves, found.right_waves) == (3, 0)


CLIPS = [
    motions.walk(),
    motions.wave("left"),
    motions.squat(),
    *(perform(name, count=3, seed=2) for name in ("march", "clap", "shake-head", "nod", "jump")),
    perform("wave", side="left", count=3),
    perform("bow"),
]


@pytest.mark.parametrize("clip", CLIPS, ids=lambda clip: clip.labels[0].text)
def test_the_mirror_image_measures_mirrored(clip: Motion) -> None:
    here, there = asdict(measure(clip)), asdict(measure(mirrored(clip)))
    there["turn_deg"] *= -1
    for name, value in here.items():
        other = name.replace("left", "?").replace("right", "left").replace("?", "right")
        assert there[other] == pytest.approx(value, abs=1e-6), name


@pytest.mark.parametrize("clip", CLIPS, ids=lambda clip: clip.labels[0].text)
def test_the_frame_rate_changes_nothing(clip: Motion) -> None:
    here, there = asdict(measure(clip)), asdict(measure(clip.resampled(60)))
    for name, value in here.items():
        exact = isinstance(value, int)
        assert there[name] == (value if exact else pytest.approx(value, rel=0.01, abs=0.02)), name


def test_one_frame_shows_nothing() -> None:
    found = measure(motions.stand(0))
    assert {name for name, value in asdict(found).items() if abs(value) > 1e-9} == set()
    assert clauses(found) == ()


def test_who_never_stands_on_both_feet_does_not_jump() -> None:
    """The left foot, the right one, a flight, and the same again: both leave and land together, but never stand so."""
    stands = ([0, 9], [0, 9], [9, 0], [9, 0], *([9, 9],) * 6, [0, 9], [0, 9], [9, 0], [9, 0])
    found = Feet((), np.zeros((14, 2), bool), np.array(stands, float), np.zeros((14, 2, 3)))
    assert jumps(motions.stand(0.5), np.ones((14, 3)), found) == ([], 0.0)


def test_a_skeleton_that_lacks_joints_is_refused() -> None:
    stick = Motion(
        np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1, 1)), 30, Skeleton(("pelvis",), (-1,), np.zeros((1, 3)))
    )
    with pytest.raises(ValueError, match="left_hip"):
        measure(stick)


def test_turnings_of_a_sine() -> None:
    """Three periods of 2 s: tops and bottoms in turn, those inside each for half a period in its half of the swing."""
    t = np.arange(181) / 30
    found = turnings(np.sin(np.pi * t), 30, 0.5)
    assert [f.high for f in found] == [True, False] * 3
    np.testing.assert_allclose([f.frame / 30 for f in found], 0.5 + np.arange(6), atol=1e-9)
    np.testing.assert_allclose([f.depth for f in found], [1, 2, 2, 2, 2, 1], atol=1e-9)
    np.testing.assert_allclose([f.seconds for f in found[1:-1]], 1.0, atol=0.07)
    assert turnings(np.sin(np.pi * t), 30, 2.5) == []


def test_smoothing_keeps_a_line() -> None:
    line = np.arange(30.0)
    np.testing.assert_allclose(smoothed(line, 30)[3:-3], line[3:-3])


def nothing() -> Measured:
    return measure(motions.stand(0))


def test_captions_say_what_is_clear_cut() -> None:
    walk = replace(nothing(), duration_s=4.5, left_steps=2, right_steps=2, path_m=2.45, turn_deg=-88.0, nods=3)
    assert clauses(walk) == ("takes four steps", "turns right ninety degrees")
    assert with_numbers("a person walks", walk) == (
        "a person walks four steps",
        "a person walks 4 steps",
        "a person walks, turning right ninety degrees",
        "a person walks, turning right 90 degrees",
    )
    assert with_numbers("she walks and turns to the right", walk)[2:] == (
        "she walks and turns to the right ninety degrees",
        "she walks and turns to the right 90 degrees",
    )
    assert with_numbers("she walks sadly and turns to the left", replace(walk, left_steps=30)) == ()
    assert clauses(replace(walk, turn_deg=82.0)) == ("takes four steps",)
    wave = replace(nothing(), duration_s=2.0, left_waves=3, left_perhaps=3)
    assert with_numbers("wave with the left hand", wave) == (
        "wave with the left hand three times",
        "wave with the left hand 3 times",
        "wave with the left hand for two seconds",
        "wave with the left hand for 2 seconds",
    )
    assert clauses(wave) == ("waves the left hand three times", "moves for two seconds")
    assert clauses(replace(wave, left_perhaps=4)) == ("moves for two seconds",)
    quick = replace(wave, duration_s=2.5)
    for caption in ("wave with the right hand", "wave both hands", "a wave", "waves and nods", "says hello"):
        assert with_numbers(caption, quick) == (), caption
    assert clauses(replace(nothing(), left_waves=3, left_perhaps=3, right_waves=2, right_perhaps=2)) == ()
    assert clauses(replace(nothing(), left_waves=1, left_perhaps=1, right_waves=1, right_perhaps=1)) == ()
    assert clauses(replace(nothing(), head_shakes=2.5)) == ()
    assert with_numbers("a person nods", replace(nothing(), bows=1, bow_deg=46.0)) == ()
    assert with_numbers("bow", replace(nothing(), bows=1, bow_deg=46.0)) == (
        "bow by forty-five degrees",
        "bow by 45 degrees",
        "bow once",
    )
    assert with_numbers("wave twice", wave) == ()
    assert with_numbers("can you wave?", quick) == ("can you wave three times?", "can you wave 3 times?")
    assert with_numbers("wave!", quick)[0] == "wave three times!"
    assert with_numbers("a person waves.", quick)[0] == "a person waves three times"


def test_words_for_numbers() -> None:
    assert [in_words(n) for n in (0, 1, 11, 20, 45, 90, 100, 135, 360)] == [
        "zero", "one", "eleven", "twenty", "forty-five", "ninety", "one hundred", "one hundred thirty-five",
        "three hundred sixty",
    ]  # fmt: skip
    with pytest.raises(ValueError, match="-1"):
        in_words(-1)


def test_the_command_prints_what_a_file_says(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_bvh(perform("wave", side="left", count=3), tmp_path / "wave.bvh")
    assert main(tmp_path / "wave.bvh") == 0
    assert "waves the left hand three times" in capsys.readouterr().out
    assert main(tmp_path / "wave.txt") == 2
    assert ".bvh, .npy, .npz" in capsys.readouterr().err


REAL = os.environ.get("RIGCAST_MOTION_DATA")


def real(content: str) -> list[Measured]:
    """Eight clips of a content, spread over its styles."""
    files = sorted(Path(str(REAL)).expanduser().rglob(f"dataset-2_{content}_*.bvh"))
    return [measure(read_bvh(path)) for path in files[:: max(1, len(files) // 8)][:8]]


@pytest.mark.skipif(not REAL, reason="RIGCAST_MOTION_DATA names no motion data")
@pytest.mark.parametrize(("side", "other"), [("left", "right"), ("right", "left")])
def test_real_clips_have_their_sides(side: str, other: str) -> None:
    waves = [asdict(m) for m in real(f"wave-{side}-hand")]
    assert sum(m[f"{side}_waves"] > 0 for m in waves) >= 6  # some wave below the shoulder
    assert sum(m[f"{other}_waves"] for m in waves) == 0
    turns = [m.turn_deg * (1 if side == "left" else -1) for m in real(f"walk-turn-{side}")]
    assert np.median(turns) == pytest.approx(90, abs=15)
    assert min(turns) > 0
