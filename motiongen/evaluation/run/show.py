"""What each kind of subject has to show: a generator draws, a folder and held-out clips are looked through."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from motiongen.data.dataset import Dataset
from motiongen.evaluation.baselines import MeanPose
from motiongen.evaluation.judges.contents import clips_of
from motiongen.evaluation.language.real import real_prompts
from motiongen.evaluation.protocol import Clips
from motiongen.evaluation.run.draw import Drawing, Drawn, draw
from motiongen.evaluation.run.judges import Judges
from motiongen.evaluation.run.measure import Shown
from motiongen.evaluation.run.sets import Plan, Sets, repeated
from motiongen.evaluation.subjects import BASELINES, Opened
from motiongen.generator import Generator, PromptError
from motiongen.motion import Motion

Tell = Callable[[str, int, int], None]  # what is done, how much of it, of how much


@dataclass(frozen=True)
class Wish:
    """How to evaluate. `judges`: folder of the evaluators; `cache`: folder for drawn motions, with one in it for each
    subject; `candidates`: how many motions are drawn to keep one."""

    plan: Plan
    judges: Path
    cache: Path
    seed: int = 0
    candidates: int = 1


def show(subject: Opened, data: Dataset, sets: Sets, wish: Wish, judges: Judges, tell: Tell) -> tuple[Shown, int]:
    """What the subject shows, and how many of the prompts it refused; raises as `draw`."""
    if subject.generator is not None:
        return _drawn(subject, subject.generator, data, sets, wish, tell)
    if subject.clips is not None:
        return _given(subject.clips, sets), 0
    return _real(data, sets, wish, judges), 0


def _drawn(
    subject: Opened, generator: Generator, data: Dataset, sets: Sets, wish: Wish, tell: Tell
) -> tuple[Shown, int]:
    how = Drawing(generator, subject.digest, wish.cache / subject.name, wish.seed, wish.candidates)

    def drawn(what: str, texts: Sequence[str], seconds: Sequence[float | None]) -> Drawn:
        said = f"{subject.name}: {what}"
        tell(said, 0, len(texts))
        return draw(how, texts, seconds, lambda done, total: tell(said, done, total))

    clips = drawn("held-out captions", sets.clips.captions, sets.seconds)
    rows = [] if subject.name in BASELINES else repeated(sets, wish.plan)  # what a baseline varies tells nothing
    again = drawn(
        "the same, several times", [sets.clips.captions[i] for i in rows], [sets.seconds[i] for i in rows]
    ).motions
    contents = drawn("contents", [text for text, _ in sets.contents], [None] * len(sets.contents)).motions
    asked = [i for i, prompt in enumerate(sets.language) if prompt.known is None]
    spoken = drawn("language", [sets.language[i].text for i in asked], [None] * len(asked)).motions
    by_prompt = dict(zip(asked, spoken, strict=True))
    still = MeanPose(data)
    filled = [
        still.generate(text, seconds=seconds) if motion is None else motion
        for motion, text, seconds in zip(clips.motions, sets.clips.captions, sets.seconds, strict=True)
    ]
    groups = zip(*[iter(again)] * wish.plan.again_times, strict=True)
    refused = sum(motion is None for motion in (*clips.motions, *contents, *spoken))
    return Shown(
        replace(sets.clips, motions=tuple(filled)),
        tuple(tuple(m for m in group if m is not None) for group in groups if None not in group),
        tuple((text, content, m) for (text, content), m in zip(sets.contents, contents, strict=True)),
        tuple(
            (prompt, by_prompt.get(i), prompt.known is not None and _known(generator, prompt.text))
            for i, prompt in enumerate(sets.language)
        ),
        clips.pace,
        subject.passes,
    ), refused


def _known(generator: Generator, text: str) -> bool:
    try:
        return generator.familiarity(text).known
    except PromptError:
        return False


def _real(data: Dataset, sets: Sets, wish: Wish, judges: Judges) -> Shown:
    """Held-out clips: those whose captions the others are asked for; of every content; and, for the language tests,
    those whose captions ask for something that can be measured."""
    contents = [
        (data.captions(i, mirrored)[0], content, data.motion(i, mirrored))
        for content, rows in clips_of(data, list(judges.real_contents), "test").items()
        for i, mirrored in rows
    ]
    spoken = [
        (prompt, motion, False)
        for prompt, motion in zip(*real_prompts(data, wish.plan.language, wish.seed), strict=True)
        if (judges.contents or not prompt.content) and (judges.style or not prompt.style)
    ]
    return Shown(sets.clips, contents=tuple(contents), language=tuple(spoken))


def _given(clips: Clips, sets: Sets) -> Shown:
    """Motion files with captions. Those with a caption that is a prompt of ours are measured as such, one file a
    prompt; familiarity is not a thing of files."""
    left = _by_caption(clips)
    contents = [(text, content, m) for text, content in sets.contents if (m := next(left(text), None)) is not None]
    left = _by_caption(clips)
    spoken = [(p, m, False) for p in sets.language if p.known is None and (m := next(left(p.text), None)) is not None]
    label_of = dict(zip(sets.clips.captions, sets.clips.labels, strict=True))
    labels = tuple(label_of.get(caption, label) for caption, label in zip(clips.captions, clips.labels, strict=True))
    return Shown(replace(clips, labels=labels), contents=tuple(contents), language=tuple(spoken))


def _by_caption(clips: Clips) -> Callable[[str], Iterator[Motion]]:
    """For a caption, the motions that have it and were not taken yet."""
    motions: dict[str, list[Motion]] = {}
    for motion, caption in zip(clips.motions, clips.captions, strict=True):
        motions.setdefault(caption, []).append(motion)
    left = {caption: iter(each) for caption, each in motions.items()}
    return lambda caption: left.get(caption, iter(()))
