"""The data source `composed:COUNT`: stable, split by split, nothing held out in training; and its captions."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from motiongen.compose.combinations import GAITS, HELD_OUT_PAIRS, held_out, parts_for, why_not
from motiongen.compose.parts import PARTS
from motiongen.data.build import build
from motiongen.data.clip import Clip, Sample, SourceError, split_of
from motiongen.data.composed import composed_clips, content_of
from motiongen.data.sources import find_all, find_clips
from motiongen.features import FPS
from motiongen.gestures.catalogue import gestures, perform
from motiongen.measure.clip import measure
from motiongen.text.captions import CONTENTS, kept_for_testing, phrasings, swap_sides
from motiongen.text.combined_captions import at_once, doing, one_after_another, phrases_of

GESTURES = find_clips("gestures:400")


def bandai(content: str, number: int) -> Clip:
    """A clip of that name, not to be read."""

    def load() -> Sample:
        raise AssertionError("read while only listed")

    return Clip(f"bandai-namco/dataset-1_{content}_active_{number:03d}", "bandai-namco", "x.bvh", load)


OTHERS = [*(bandai(content, i) for content in CONTENTS for i in range(40)), *GESTURES]


# ---- What goes with what


def test_twenty_pairs_are_held_out_and_mirror_images_with_them() -> None:
    assert len(set(HELD_OUT_PAIRS)) == 20
    for gait, action in HELD_OUT_PAIRS:
        assert gait in GAITS
        assert set(parts_for(action)) <= set(PARTS)
        assert (swap_sides(gait), swap_sides(action)) in HELD_OUT_PAIRS
    # Nothing of them is new by itself: every gait and action is trained on in other company.
    known = {a for _, a in HELD_OUT_PAIRS}
    for gait, action in HELD_OUT_PAIRS:
        assert any(not held_out(gait, other) for other in known)
        assert any(not held_out(other, action) for other in GAITS)
    assert held_out("dash", "wave-left")  # by another name
    assert not held_out("walk", "wave-left")


def test_every_part_has_what_it_needs() -> None:
    assert parts_for("wave-left-hand") == ("left_arm",)
    assert parts_for("raise-up-both-hands") == ("arms",)
    assert parts_for("point-right") == ("right_arm", "head")
    for content in ("walk", "bow", "squat", "kick-left", "march", "byebye", "twist-left"):
        assert parts_for(content) == ()


@pytest.mark.parametrize(
    ("lower", "upper", "parts", "why"),
    [
        ("march", "squat", ("arms",), "needs its own legs"),
        ("march", "bow", ("upper_body",), "bows by"),
        ("squat", "wave", ("right_arm",), "the lower clip"),
        ("wave", "nod", ("head",), "the lower clip's right hand"),
        ("march", "wave", ("right_arm",), ""),
        ("march", "nod", ("head",), ""),
    ],
)
def test_why_two_clips_do_not_go_together(lower: str, upper: str, parts: tuple[str, ...], why: str) -> None:
    found = why_not(measure(perform(lower)), measure(perform(upper)), parts)
    assert why in found if why else not found


# ---- Captions


def test_a_combination_has_twenty_phrasings_or_more_in_every_style_of_speech() -> None:
    walk, bow = phrases_of(phrasings("walk", "happy")), phrases_of(phrasings("bow"))
    for gesture in gestures().values():
        wave = phrases_of(gesture.captions(gesture.params()))
        for said in (at_once(walk, wave), one_after_another([walk, wave]), one_after_another([walk, wave, bow])):
            assert len(set(said)) == len(said) >= 20
            assert any(re.match(r"(a person|she|the robot) \w+s\b", c) for c in said)
            assert any(c.startswith("please ") for c in said)
            assert any(c.startswith("can you ") for c in said)


def test_captions_read_as_people_speak() -> None:
    walk = phrases_of(("a person walks happily", "please walk"))
    wave = phrases_of(("she waves their hand three times", "please wave your hand"))
    together = at_once(walk, wave)
    for wanted in (
        "a person walks happily and waves their hand three times",
        "he waves their hand three times while walking",
        "wave your hand while walking",
        "the robot walks happily while waving their hand",
    ):
        assert wanted in together
    in_turn = one_after_another([walk, wave])
    for wanted in (
        "someone walks happily, then waves their hand three times",
        "first walk and then wave your hand",
        "after walking, a person waves their hand three times",
    ):
        assert wanted in in_turn


def test_participles() -> None:
    said = {"run along": "running along", "wave": "waving", "tie": "tying", "see": "seeing", "shrug": "shrugging"}
    said |= {"sidestep left": "sidestepping left", "wave your hand": "waving their hand", "look up": "looking up"}
    assert {plain: doing(plain) for plain in said} == said


def test_phrases_that_hold_two_actions_are_not_joined() -> None:
    left_out = ("he walks and turns left", "she walks, taking four steps", "someone is running")
    found = phrases_of((*left_out, "a happy person runs", "please run", "please lift the arm and wave"))
    assert found.third == ("runs",)
    assert found.plain == ("run",)
    with pytest.raises(ValueError, match="no phrase"):
        phrases_of(left_out)


# ---- The source


def test_clips_are_drawn_from_their_own_split_and_not_what_is_held_out() -> None:
    clips = composed_clips(600, OTHERS)
    assert [clip.name for clip in clips[:2]] == ["composed/000000", "composed/000001"]
    tested = 0
    for clip in clips:
        _, together, tries = clip.load.args  # type: ignore[attr-defined]
        for one in tries:
            assert {part.split for part in one.clips} == {clip.split}
            assert tuple(map(content_of, one.clips)) == one.contents
            if together:
                tested += held_out(*one.contents)
                assert clip.split == "test" or not held_out(*one.contents)
    assert tested > 100


def test_a_clip_depends_on_its_number_and_the_clips_there_are() -> None:
    few, many = composed_clips(20, OTHERS), composed_clips(40, OTHERS)
    assert [(c.name, c.stamp) for c in few] == [(c.name, c.stamp) for c in many[:20]]
    other = composed_clips(20, OTHERS[:-300])
    assert [c.stamp for c in other] != [c.stamp for c in few]
    again = pickle.loads(pickle.dumps(composed_clips(4, GESTURES)[1])).load()  # as for another process
    here = composed_clips(4, GESTURES)[1].load()
    np.testing.assert_array_equal(again.motion.joint_quat, here.motion.joint_quat)
    assert again.captions == here.captions


def test_composed_clips_of_gestures() -> None:
    clips = [clip for clip in composed_clips(20, GESTURES) if clip.split != "val"]
    done = 0
    for clip in clips:
        try:
            sample = clip.load()
        except ValueError:
            continue  # as a build leaves out what cannot be composed: few gestures are long enough for a short march
        done += 1
        assert ("+" in sample.content) != (">" in sample.content)
        assert sample.motion.fps == FPS
        assert len(sample.captions) == len(set(sample.captions)) == 12
        assert len(sample.motion.labels) == len(re.split(r"[+>]", sample.content))
        assert sample.licence == "Apache-2.0"
        assert clip.split == split_of(clip.name)
        if clip.split == "train":
            assert not any(map(kept_for_testing, (*sample.captions, *sample.mirrored)))
        sides = set(re.findall(r"-(left|right)\b", sample.content))
        if len(sides) == 1 and not re.search("check-watch|look-|think", sample.content):
            (side,) = sides
            other = swap_sides(side)
            assert all(side in caption and other not in caption for caption in sample.captions)
            assert all(other in caption and side not in caption for caption in sample.mirrored)
    assert done >= 0.7 * len(clips)


def test_a_data_set_with_composed_clips(tmp_path: Path) -> None:
    dataset, _ = build(["composed:4", "gestures:60"], tmp_path / "out")
    composed = [i for i, entry in enumerate(dataset.entries) if entry.source == "composed"]
    assert len(composed) + sum(s.name.startswith("composed/") for s in dataset.skipped) == 4
    assert len(composed) >= 2
    assert len(dataset.motion(composed[0])) == dataset.entries[composed[0]].frames


def test_composing_needs_something_to_compose() -> None:
    with pytest.raises(SourceError, match="composed:3: needs one of the sources bandai-namco and gestures"):
        find_all(["composed:3"])
    with pytest.raises(SourceError, match="composed:x: the count"):
        find_all(["gestures:3", "composed:x"])
