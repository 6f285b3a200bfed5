"""Which texts are taken apart, into what, and what comes of it in a motion."""

import numpy as np
import pytest

from motiongen.generator import load_generator
from motiongen.measure.clip import observe
from motiongen.text.plan import Piece, plan_of


@pytest.mark.parametrize(
    ("text", "plan"),
    [
        ("walk while waving the left hand", ((("walk", ()), ("waving the left hand", ("left_arm",))),)),
        (
            "go ahead and squat and clap your hands at the same time, please",
            ((("squat", ()), ("clap your hands, please", ("arms",))),),
        ),
        ("nod and meanwhile raise both arms", ((("nod", ("head",)), ("raise both arms", ("arms",))),)),
        ("Bow, then jump twice", ((("bow", ()),), (("jump twice", ()),))),
        (
            "walk while nodding, then turn left",
            ((("walk", ()), ("nodding", ("head",))), (("turn left", ()),)),
        ),
    ],
)
def test_what_is_taken_apart(text: str, plan: tuple) -> None:
    assert plan_of(text) == tuple(tuple(Piece(*piece) for piece in step) for step in plan)


@pytest.mark.parametrize(
    "text",
    [
        "walk forward",
        "walk and turn left",  # one way to go
        "walk while squatting",  # both need the legs
        "wave the left hand and salute with the left hand at the same time",
        "walk while reciting a poem",  # nobody can tell what of the body recites
        "sing, then bow",
    ],
)
def test_what_is_left_as_it_is(text: str) -> None:
    assert plan_of(text) == ()


def test_one_after_the_other_in_one_motion() -> None:
    generator = load_generator()
    motion = generator.generate("walk forward, then raise both arms", seed=1)
    assert [label.text for label in motion.labels] == ["walk forward, then raise both arms"]
    assert observe(motion).totals.path_m > 1.0
    assert len(generator.generate("walk forward, then raise both arms", seconds=6.0, seed=1)) == 180


def test_a_batch_gives_what_each_text_gives_alone() -> None:
    generator = load_generator()
    texts = ["bow", "walk while waving the left hand", "walk forward"]
    for motion, text, seed in zip(generator.generate_batch(texts, seed=4), texts, range(4, 7), strict=True):
        alone = generator.generate(text, seed=seed)
        assert len(alone) == len(motion)
        assert np.abs(alone.positions() - motion.positions()).max() < 1e-3
