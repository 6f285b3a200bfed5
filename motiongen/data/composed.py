"""Clips composed of others of the same data set: one's arms on another's legs, and one after another.

Clip i is drawn from its number and the clips there are; of a clip's split are all its parts.
"""

from __future__ import annotations

import hashlib
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from motiongen.compose.combinations import EVEN_GAITS, FAST_GAITS, GAITS, HELD_OUT_PAIRS, held_out, parts_for, why_not
from motiongen.compose.motions import clearance, looped, overlay, sequence, sharpest
from motiongen.data.clip import Clip, Sample, SourceError, drawn, split_of
from motiongen.features import FPS
from motiongen.gestures.catalogue import draw
from motiongen.measure.clip import measure
from motiongen.motion import Label, Motion, Source, cut
from motiongen.text.combined_captions import at_once, one_after_another, phrases_of

TRIES = 8  # combinations drawn for a clip, of which the first that goes well is taken
LEAD_S = 1.0  # a gait goes on for up to this before, and after, what the hands do
GAIT_S = (2.5, 4.5)  # of a gait in a sequence
SLACK = 0.03  # m that a hand may come nearer to the trunk than in both clips
SHARPER = 1.2  # times the largest angular acceleration of the parts: a knee that snaps straight has four times it
KEPT = 512  # clips kept in memory once read: some 100 MB

_PARTS_OF = ("bandai-namco", "gestures")
_TIME, _NUMBERS = re.compile(r"\bseconds?\b"), re.compile(r"\d|\b(seconds?|steps?|metres?|degrees)\b")


@dataclass(frozen=True)
class _Try:
    """Clips to compose and what each shows. `seed` draws how they are cut."""

    clips: tuple[Clip, ...]
    contents: tuple[str, ...]
    seed: int


@dataclass(frozen=True)
class _Part:
    """A clip that was read: its motion at 30 frames a second, captions of it and of its mirror image."""

    motion: Motion
    captions: tuple[str, ...]
    mirrored: tuple[str, ...]


def composed_clips(count: int, others: Sequence[Clip]) -> list[Clip]:
    """`count` clips composed of `others`: of even number two at once, of odd two or three one after another.

    Parts are the clips of Bandai-Namco and the gestures of the same split. Pairs of `HELD_OUT_PAIRS` are composed for
    testing only. Raises SourceError where `others` has no such clips.
    """
    by_split: dict[str, dict[str, list[Clip]]] = defaultdict(lambda: defaultdict(list))
    for clip in others:
        if clip.source in _PARTS_OF:
            by_split[clip.split][content_of(clip)].append(clip)
    if not by_split:
        raise SourceError(f"composed:{count}: needs one of the sources {' and '.join(_PARTS_OF)} beside it")
    choices = {split: _choices(there) for split, there in by_split.items()}
    return [_composed(number, choices) for number in range(count)]


def content_of(clip: Clip) -> str:
    """What a clip of Bandai-Namco or of the gestures shows, the side at the end: "walk", "salute-left"."""
    if clip.source == "gestures":
        family, params = draw(np.random.default_rng(int(clip.name.removeprefix("gestures/"))))
        return f"{family.name}-{params.side}" if params.side else family.name
    said = re.search(r"dataset-\d_(.+)_.+_\d+$", clip.name)
    if said is None:
        raise SourceError(f"{clip.name}: not dataset-1_CONTENT_STYLE_NUMBER")
    return said[1]


@dataclass(frozen=True)
class _Choices:
    """What a split has: clips by content; what can be done at once, what of it is held out; gaits, and the rest."""

    clips: Mapping[str, Sequence[Clip]]
    pairs: tuple[tuple[str, ...], ...]
    held_out: tuple[tuple[str, ...], ...]
    gaits: tuple[str, ...]
    others: tuple[str, ...]


def _choices(clips: Mapping[str, Sequence[Clip]]) -> _Choices:
    gaits = tuple(gait for gait in GAITS if gait in clips)
    actions = [content for content in sorted(clips) if parts_for(content)]
    return _Choices(
        clips,
        pairs=tuple((gait, action) for gait in gaits for action in actions if not held_out(gait, action)),
        held_out=tuple(pair for pair in HELD_OUT_PAIRS if all(content in clips for content in pair)),
        gaits=gaits,
        others=tuple(content for content in sorted(clips) if content not in (*GAITS, "idle")),
    )


def _composed(number: int, choices: Mapping[str, _Choices]) -> Clip:
    name = f"composed/{number:06d}"
    rng, split = np.random.default_rng(number), split_of(name)
    together, tries = number % 2 == 0, []
    for _ in range(TRIES if split in choices else 0):
        there = choices[split]
        contents = _pair(rng, there, testing=split == "test") if together else _row(rng, there)
        if contents:
            clips = tuple(there.clips[content][int(rng.integers(len(there.clips[content])))] for content in contents)
            tries.append(_Try(clips, contents, int(rng.integers(2**31))))
    made_of = "\n".join(f"{clip.name} {clip.stamp}" for one in tries for clip in one.clips)
    stamp = hashlib.sha256(made_of.encode()).hexdigest()[:16]
    return Clip(name, "composed", "", partial(_load, name, together, tuple(tries)), stamp)


def _pair(rng: np.random.Generator, there: _Choices, testing: bool) -> tuple[str, ...]:
    """A gait and an action; half of those for testing are held out."""
    pairs = there.held_out if testing and rng.random() < 0.5 else there.pairs
    return pairs[rng.integers(len(pairs))] if pairs else ()


def _row(rng: np.random.Generator, there: _Choices) -> tuple[str, ...]:
    """Two or three contents, half of them gaits, none twice in a row."""
    row: tuple[str, ...] = ()
    for _ in range(int(rng.integers(2, 4))):
        pool = there.gaits if rng.random() < 0.5 else there.others
        pool = tuple(content for content in pool if not row or _follows(row[-1], content))
        if pool:
            row = (*row, pool[rng.integers(len(pool))])
    return row if len(row) > 1 else ()


def _follows(first: str, second: str) -> bool:
    """Whether one goes over into the other: nobody stops from, or starts with, a run within a step."""
    fast = (first in FAST_GAITS, second in FAST_GAITS)
    return first != second and (not any(fast) or (first in EVEN_GAITS and second in EVEN_GAITS))


# ---- Reading


def _load(name: str, together: bool, tries: tuple[_Try, ...]) -> Sample:
    """The first of `tries` that goes well; raises ValueError that says why the last did not."""
    compose = _at_once if together else _one_after_another
    why = f"its split has no clips to compose {'at once' if together else 'one after another'}"
    for one in tries:
        try:
            return compose(name, one)
        except ValueError as error:
            why = f"{' and '.join(clip.name for clip in one.clips)}: {error}"
    raise ValueError(f"nothing could be composed; {why}")


def _at_once(name: str, one: _Try) -> Sample:
    (gait, action), rng = one.contents, np.random.default_rng(one.seed)
    lower, upper = (_read(clip) for clip in one.clips)
    parts = parts_for(action)
    if why := why_not(measure(lower.motion), measure(upper.motion), parts):
        raise ValueError(why)
    legs, start_s = lower.motion, 0.0
    if gait in EVEN_GAITS:
        start_s, after_s = rng.uniform(0, LEAD_S, 2)
        legs = _lasting(legs, start_s + upper.motion.duration + after_s, rng)
    elif legs.duration < upper.motion.duration:
        raise ValueError(f"{gait} takes {legs.duration:.1f} s, {action} {upper.motion.duration:.1f} s")
    else:
        start_s = rng.uniform(0, legs.duration - upper.motion.duration)
    motion = overlay(legs, upper.motion, parts, start_s=start_s)
    near, nearest = clearance(motion), min(clearance(legs), clearance(upper.motion))
    if near < nearest - SLACK:
        raise ValueError(f"a hand comes within {near:.2f} m of the trunk, {nearest - near:.2f} m nearer than before")
    said = [
        at_once(phrases_of(_true_of(gait, below)), phrases_of(_true_of(action, above)))
        for below, above in ((lower.captions, upper.captions), (lower.mirrored, upper.mirrored))
    ]
    return _sample(name, motion, said, f"{gait}+{action}")


def _one_after_another(name: str, one: _Try) -> Sample:
    rng = np.random.default_rng(one.seed)
    parts = [_read(clip) for clip in one.clips]
    motions = [
        _lasting(part.motion, rng.uniform(*GAIT_S), rng) if content in EVEN_GAITS else part.motion
        for content, part in zip(one.contents, parts, strict=True)
    ]
    motion = sequence(motions)
    sharp, before = sharpest(motion), max(map(sharpest, motions))
    if sharp > SHARPER * before:
        raise ValueError(f"a joint jerks at a seam: {sharp:.0f} rad/s², no more than {before:.0f} in the clips")
    said = [
        one_after_another([phrases_of(_true_of(c, words)) for c, words in zip(one.contents, side, strict=True)])
        for side in ([part.captions for part in parts], [part.mirrored for part in parts])
    ]
    return _sample(name, motion, said, ">".join(one.contents))


def _sample(name: str, motion: Motion, said: Sequence[tuple[str, ...]], content: str) -> Sample:
    captions, mirrored = (drawn(captions, name) for captions in said)
    return Sample(motion, captions, mirrored, motion.source.licence, content)


def _lasting(gait: Motion, seconds: float, rng: np.random.Generator) -> Motion:
    """An even gait for `seconds`: a piece of it, or gone on with where it is too short."""
    gait = gait if gait.duration >= seconds else looped(gait, seconds)
    count = min(round(seconds * gait.fps) + 1, len(gait))
    first = int(rng.integers(len(gait) - count + 1))
    label = Label(0.0, (count - 1) / gait.fps, gait.labels[0].text)
    return replace(cut(gait, first, first + count), labels=(label,))


def _true_of(content: str, captions: Sequence[str]) -> list[str]:
    """Those of `captions` that hold of a piece, or of more, of a clip too."""
    untrue = _NUMBERS if content in GAITS and content != "march" else _TIME
    return [caption for caption in captions if not untrue.search(caption)]


_read_already: dict[str, _Part] = {}


def _read(clip: Clip) -> _Part:
    """The clip, kept for others that are made of it."""
    if clip.name not in _read_already:
        sample = clip.load()
        motion = sample.motion.resampled(FPS) if sample.motion.fps != FPS else sample.motion
        label = Label(0.0, motion.duration, sample.captions[0])
        motion = replace(motion, labels=(label,), source=Source(clip.name, licence=sample.licence))
        if len(_read_already) >= KEPT:
            del _read_already[next(iter(_read_already))]
        _read_already[clip.name] = _Part(motion, sample.captions, sample.mirrored)
    return _read_already[clip.name]
