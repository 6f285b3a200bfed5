"""Drawing in chunks: nothing is drawn twice, an interruption loses a chunk, what decides a motion decides its chunk."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from motions import walk

from motiongen.evaluation.run.draw import CHUNK, Drawing, draw
from motiongen.files import FileError
from motiongen.generator import Familiarity, PromptError
from motiongen.motion import Motion

TEXTS = [f"walk {i}" for i in range(CHUNK + 8)]


class Counting:
    """Walks that start `seed` metres ahead, and keeps account of what it was asked for."""

    name = "counting"
    licence = "none"

    def __init__(self, refuses: str = "", breaks_after: int = 10**9) -> None:
        self.asked: list[tuple[str, float | None, int]] = []
        self.refuses, self.breaks_after = refuses, breaks_after

    def familiarity(self, text: str) -> Familiarity:
        return Familiarity(True, 1.0, ())

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        if len(self.asked) == self.breaks_after:
            raise KeyboardInterrupt
        if text == self.refuses:
            raise PromptError("no")
        self.asked.append((text, seconds, seed))
        clip = walk(seconds=seconds or 2.0)
        return replace(clip, root_pos=clip.root_pos + np.array([seed, 0, 0]))


def drawing(generator: Counting, folder: Path, **changes: object) -> Drawing:
    return replace(Drawing(generator, "digest", folder, 0, 1), **changes)  # type: ignore[arg-type]


def silent(done: int, total: int) -> None:
    pass


def test_what_was_drawn_is_read_and_is_the_same(tmp_path: Path) -> None:
    generator = Counting()
    how = drawing(generator, tmp_path)
    first = draw(how, TEXTS, [None] * len(TEXTS), silent)
    count = len(generator.asked)
    again = draw(how, TEXTS, [None] * len(TEXTS), silent)
    assert count == len(generator.asked) == len(TEXTS)
    for text, one, two in zip(TEXTS, first.motions, again.motions, strict=True):
        assert one is not None
        assert two is not None
        assert one.labels[0].text == text
        assert np.array_equal(one.joint_quat, two.joint_quat)
    wanted = generator.generate(TEXTS[5], seed=5)
    assert np.abs(first.motions[5].positions() - wanted.positions()).max() < 1e-5  # type: ignore[union-attr]
    assert again.pace == first.pace


def test_an_interrupted_drawing_goes_on_with_its_last_chunk(tmp_path: Path) -> None:
    broken = Counting(breaks_after=CHUNK + 3)
    with pytest.raises(KeyboardInterrupt):
        draw(drawing(broken, tmp_path), TEXTS, [None] * len(TEXTS), silent)
    fresh, told = Counting(), []
    draw(drawing(fresh, tmp_path), TEXTS, [None] * len(TEXTS), lambda done, total: told.append((done, total)))
    assert len(fresh.asked) == 8
    assert told == [(CHUNK, len(TEXTS)), (len(TEXTS), len(TEXTS))]


@pytest.mark.parametrize("changes", [{"digest": "other weights"}, {"seed": 1}, {"candidates": 2}])
def test_other_weights_seeds_or_candidates_draw_anew(tmp_path: Path, changes: dict[str, object]) -> None:
    draw(drawing(Counting(), tmp_path), TEXTS[:3], [None] * 3, silent)
    fresh = Counting()
    draw(drawing(fresh, tmp_path, **changes), TEXTS[:3], [None] * 3, silent)
    assert fresh.asked


def test_each_text_gets_its_own_seconds_and_its_own_seed(tmp_path: Path) -> None:
    generator = Counting()
    seconds = [3.0, 1.0, 2.0, 1.0]
    drawn = draw(drawing(generator, tmp_path), TEXTS[:4], seconds, silent)
    assert [m.duration for m in drawn.motions if m is not None] == pytest.approx(seconds, abs=0.04)
    assert {text: each for text, each, _ in generator.asked} == dict(zip(TEXTS, seconds, strict=False))
    assert len({seed for *_, seed in generator.asked}) == 4


def test_a_refused_text_has_no_motion(tmp_path: Path) -> None:
    drawn = draw(drawing(Counting(refuses=TEXTS[1]), tmp_path), TEXTS[:3], [None] * 3, silent)
    assert [motion is None for motion in drawn.motions] == [False, True, False]


def test_another_skeleton_and_a_damaged_chunk_are_one_line(tmp_path: Path) -> None:
    class Headless(Counting):
        def generate(self, *args: object, **options: object) -> Motion:
            clip = walk(seconds=1.0)
            body = clip.skeleton
            cut = replace(body, names=body.names[:21], parents=body.parents[:21], offsets=body.offsets[:21])
            return replace(clip, skeleton=cut, joint_quat=clip.joint_quat[:, :21])

    with pytest.raises(ValueError, match="a motion of 21 joints; it needs the 22 of SMPL"):
        draw(drawing(Headless(), tmp_path), TEXTS[:1], [None], silent)
    draw(drawing(Counting(), tmp_path), TEXTS[:1], [None], silent)
    next(tmp_path.glob("*.npz")).write_bytes(b"not an archive")
    with pytest.raises(FileError, match="damaged"):
        draw(drawing(Counting(), tmp_path), TEXTS[:1], [None], silent)
