"""A rig's motion read back as a person's: what went in comes out, and what counts as running free."""

from dataclasses import replace

import motions
import numpy as np
import pytest
from read_back import read_back
from standing_tries import Try, does, is_free, labelled, short_of

from motiongen.gestures.catalogue import perform
from motiongen.measure.clip import observe
from motiongen.motion import Label
from motiongen.text.asking import asked_of
from motiongen.text.claims import holds
from retarget.retarget import retarget
from retarget.rig import load_rig

GOOD = Try(True, "imu", (), (9, 9), (), 1.5, 0.8, shows=True, does=False)


@pytest.mark.parametrize("name", ["wave", "walk"])
def test_a_person_comes_back_from_the_humanoid(name: str) -> None:
    """Limbs point where they did, and the way is as long."""
    clip, rig = getattr(motions, name)(), load_rig("humanoid")
    asked = retarget(clip, rig, mount="free")
    back = read_back(asked.qpos, asked.fps, rig, clip.skeleton)
    start = round((asked.duration - clip.duration) / 2 * asked.fps)
    places = [m.positions() - m.positions()[:, :1] for m in (clip.resampled(asked.fps), back)]
    wrist = clip.skeleton.index("right_wrist")
    offs = [
        np.linalg.norm(places[1][s : s + len(places[0]), wrist] - places[0][: len(places[1]) - s, wrist], axis=1).mean()
        for s in range(max(start - 15, 0), start + 15)
    ]
    assert min(offs) < 0.12
    gone = [np.linalg.norm(m.root_pos[-1, :2] - m.root_pos[0, :2]) for m in (clip, back)]
    assert gone[1] == pytest.approx(gone[0], abs=0.05 + 0.1 * gone[0])
    assert back.root_pos[0, 2] == pytest.approx(clip.root_pos[0, 2], abs=0.06)


@pytest.mark.parametrize("text", ["take two steps forward", "turn left 90 degrees", "wave with the right hand"])
def test_what_a_person_does_is_measured_on_the_puppet(text: str) -> None:
    from motiongen.generator import load_generator

    clip, rig, says = load_generator("gestures").generate(text, seed=1), load_rig("puppet"), asked_of(text)
    assert says is not None
    asked = retarget(clip, rig, mount="free")
    back = read_back(asked.qpos[labelled(asked)], asked.fps, rig, clip.skeleton)
    assert holds(says, observe(back))
    other = asked_of("turn right 90 degrees")
    assert other is not None
    assert not holds(other, observe(back))


def test_the_step_that_closes_the_feet_is_not_counted() -> None:
    one, two = asked_of("take a step forward"), perform("step-forward", count=2)
    assert one is not None
    assert not does(one, two, closing=False)
    assert does(one, two, closing=True)


def test_what_is_labelled_leaves_the_way_in_and_out() -> None:
    asked = retarget(perform("wave"), load_rig("puppet"), mount="free")
    told = replace(asked, labels=(Label(0.5, 1.0, "a"), Label(0.8, 1.5, "b")))
    assert labelled(told) == slice(25, 76)
    assert labelled(replace(asked, labels=())) == slice(0, len(asked))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"failed": ("fall_tilt",)}, ""),
        ({"far": 0.69}, "69% of the way"),
        ({"longer": 2.1}, "2.10 times as long"),
        ({"shows": False}, "not recognised"),
        ({"trials": (8, 10), "fell_to": (("fall_tilt", 2),)}, "2 of 10 trials fail: fall_tilt"),
        ({"trials": (1, 3)}, "2 of 3 trials fail"),
    ],
)
def test_what_runs_free_lacks_nothing(change: dict, says: str) -> None:
    assert is_free(GOOD)
    assert is_free(replace(GOOD, shows=False, does=True, trials=(9, 10)))
    bad = replace(GOOD, **change)
    assert not is_free(bad)
    assert says in short_of(bad)
