"""What every subject of an evaluation is asked for: held-out captions, contents in turn, and the language tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from motiongen.data.dataset import Dataset
from motiongen.evaluation.judges.contents import clips_of
from motiongen.evaluation.judges.judge import Kind
from motiongen.evaluation.judges.sanity import held_out
from motiongen.evaluation.judges.seen import MOST_SECONDS
from motiongen.evaluation.language.prompts import Prompt, prompts
from motiongen.evaluation.metrics import BATCH, draw_batches
from motiongen.evaluation.protocol import Clips
from motiongen.evaluation.run.results import ResultsError
from motiongen.generator import MIN_SECONDS
from motiongen.text.captions import kept_for_testing


@dataclass(frozen=True)
class Plan:
    """How much is measured. `clips`: held-out captions; `again_texts` are drawn `again_times` each, for
    MultiModality; `content` and `language`: prompts a content, a category; `gate`: motions put through physics;
    `judge_steps`, `content_steps`: training steps of the evaluators and of the classifier of contents."""

    clips: int
    again_texts: int
    again_times: int
    content: int
    language: int
    gate: int
    judge_steps: Mapping[Kind, int]
    content_steps: int


FULL = Plan(
    clips=500,
    again_texts=30,
    again_times=20,
    content=10,
    language=200,
    gate=40,
    judge_steps={"guo": 700, "tmr": 600},
    content_steps=1500,
)
QUICK = Plan(
    clips=128,
    again_texts=4,
    again_times=10,
    content=1,
    language=10,
    gate=5,
    judge_steps={"guo": 60, "tmr": 60},
    content_steps=150,
)


@dataclass(frozen=True)
class Sets:
    """`reference`: held-out clips that others are held against; `clips`: as many others, whose captions are asked for,
    each for `seconds`. `contents`: text and the content that it asks for."""

    reference: Clips
    clips: Clips
    seconds: tuple[float, ...]
    contents: tuple[tuple[str, str], ...]
    language: tuple[Prompt, ...]


def require_held_out(data: Dataset) -> None:
    """Raise ResultsError where there are too few held-out clips for two sets of 32."""
    count = sum(entry.split == "test" for entry in data.entries)
    if count < 2 * BATCH:
        raise ResultsError(
            f"{data.folder}: {count} held-out clips; an evaluation needs {2 * BATCH}, {BATCH} to ask for and {BATCH} "
            "to compare with"
        )


def make_sets(data: Dataset, contents: list[str], plan: Plan, seed: int, *, styles: bool) -> Sets:
    """Draw the sets by `seed`. `contents`: those that can be judged; `styles`: whether they can. Language tests that
    ask for what cannot be judged are left out.

    A clip's seconds are those of the held-out clip in whole numbers, up to the 8 s that evaluators see. Raises
    ResultsError as `require_held_out`, ValueError where fewer than 32 of the clips are different.
    """
    require_held_out(data)
    tested = held_out(data, seed=seed)
    count = min(plan.clips, len(tested.captions) // 2)
    order = np.random.default_rng(seed).permutation(len(tested.captions))
    asked = _some(tested, order[count : 2 * count])
    draw_batches(asked.labels, np.random.default_rng(seed))  # too few different ones are told before any work
    seconds = tuple(float(np.clip(round(m.duration), MIN_SECONDS, MOST_SECONDS)) for m in asked.motions)
    judged = [p for p in prompts(plan.language, seed) if (contents or not p.content) and (styles or not p.style)]
    return Sets(
        _some(tested, order[:count]),
        asked,
        seconds,
        _content_prompts(data, contents, plan.content, seed),
        tuple(judged),
    )


def _some(clips: Clips, rows: np.ndarray) -> Clips:
    return Clips(*(tuple(values[i] for i in rows) for values in (clips.motions, clips.captions, clips.labels)))


def _content_prompts(data: Dataset, contents: list[str], each: int, seed: int) -> tuple[tuple[str, str], ...]:
    """`each` captions of held-out clips of every content: of the phrasings kept for testing, where there are any."""
    rng = np.random.default_rng(seed)
    out = []
    for content, rows in clips_of(data, contents, "test").items():
        said = sorted({caption for i, mirrored in rows for caption in data.captions(i, mirrored)})
        kept = [caption for caption in said if kept_for_testing(caption)] or said
        rounds = [kept[i] for _ in range(each // len(kept) + 1) for i in rng.permutation(len(kept))]
        out += [(caption, content) for caption in rounds[:each]]
    return tuple(out)


def repeated(sets: Sets, plan: Plan) -> list[int]:
    """Rows of `sets.clips` that are drawn several times each, those of a text one after another."""
    texts = min(plan.again_texts, len(sets.clips.captions))
    return np.repeat(np.arange(texts), plan.again_times).tolist()
