"""Two things at once that no model was trained on together: are the legs right, are the arms, are both?

Twenty pairs of a gait and something that the arms do, which a data set's composition holds out. The judges are linear
discriminants of the legs and of the arms of real clips; what they are worth is in the first row, where they see the
held-out clips of those very pairs, the real arms of one clip laid over the real legs of another.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from lines import Line
from parts import Options, Part

from motiongen.compose.combinations import GAITS, HELD_OUT_PAIRS, parts_for, plain_name
from motiongen.compose.motions import overlay
from motiongen.compose.parts import PARTS
from motiongen.data.dataset import Dataset, open_dataset
from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.diffusion.timeline import Entry, columns_of
from motiongen.evaluation.baselines import Retrieval
from motiongen.evaluation.language.discriminants import Discriminant, statistics
from motiongen.features import CONTACTS, motion_to_features
from motiongen.motion import Motion
from motiongen.text.captions import swap_sides
from motiongen.text.combined_captions import doing

LAMBDAS, QUICK_LAMBDAS = (0.0, 0.01, 0.3, 3.0), (0.01,)
SEEDS = 3
QUICK_PAIRS = 4
SECONDS = 4.0
MOST, QUICK_MOST = 60, 12  # clips to learn from, of each thing that legs or arms do
STANDING, IDLE = "standing", "nothing"  # what legs do while somebody gestures, and arms while somebody walks

_LEGS = {
    "walk": "walk forward", "run": "run forward", "walk-back": "walk backwards", "march": "march in place",
    "walk-left": "walk sideways to the left", "walk-turn-left": "walk and turn to the left",
}  # fmt: skip
_ARMS = {
    "salute-left": "salute with the left hand", "raise-up-both-hands": "raise both hands", "clap": "clap your hands",
    "wave-left-hand": "wave with the left hand", "wave-both-hands": "wave with both hands", "celebrate": "celebrate",
    "raise-up-left-hand": "raise the left hand", "point-forward-left": "point forward with the left hand",
}  # fmt: skip

Draw = Callable[[str, str, int], Motion]  # of a gait, an action and a seed


@dataclass(frozen=True)
class Judge:
    """Names what the legs of features (T, 140) do, and what the arms."""

    legs: Discriminant
    arms: Discriminant

    def __call__(self, features: Sequence[np.ndarray]) -> list[tuple[str, str]]:
        rows = np.stack([statistics(each) for each in features])
        return list(zip(self.legs(rows[:, LEGS]), self.arms(rows[:, ARMS]), strict=True))


def pairs(options: Options) -> Part:
    """The share that is right, for parts drawn by Eq. 10 with several λ, and for what they have to beat."""
    if options.data is None:
        return Part((("not judged: --data names no data set",),), _lines(None, None))
    dataset = open_dataset(options.data)
    judge = learnt(dataset, QUICK_MOST if options.quick else MOST)
    chosen = HELD_OUT_PAIRS[:: len(HELD_OUT_PAIRS) // QUICK_PAIRS] if options.quick else HELD_OUT_PAIRS
    seeds = range(1 if options.quick else SEEDS)
    rows = [("how", "legs right", "arms right", "both"), _row("held-out clips", held_out_clips(dataset, judge, MOST))]
    both = {}
    for name, draw in _ways(options, dataset):
        asked = [(gait, action) for gait, action in chosen for _ in seeds]
        drawn = [motion_to_features(draw(*pair, seed)) for pair in chosen for seed in seeds]
        found = _right(judge(drawn), asked)
        rows.append(_row(name, found))
        both[name] = float(found.all(1).mean())
    best = max((share for name, share in both.items() if name.startswith("parts")), default=None)
    return Part(tuple(rows), _lines(best, both["one plain prompt"]))


def _lines(best: float | None, plain: float | None) -> tuple[Line, ...]:
    over = None if best is None or plain is None else best - plain
    return (
        Line("pairs", "held-out pairs, legs and arms right, share", best, 0.5, True),
        Line("pairs", "the same, over one plain prompt", over, 0.2, True),
    )


def _ways(options: Options, dataset: Dataset) -> Iterator[tuple[str, Draw]]:
    lambdas = QUICK_LAMBDAS if options.quick else LAMBDAS
    for own, name in ((True, "parts, bodies of their own"), (False, "parts, one body")):
        for lam in lambdas:
            drawing = DiffusionGenerator(options.weights, lam_parts=lam, own_bodies=own)
            yield f"{name}, λ₁ = {lam:g}", _by_parts(drawing)
    alone = DiffusionGenerator(options.weights, alone=True)
    yield (
        "one plain prompt",
        lambda gait, action, seed: alone.generate(at_once(gait, action), seconds=SECONDS, seed=seed),
    )
    yield (
        "cut and paste",
        lambda gait, action, seed: overlay(
            alone.generate(said(gait), seconds=SECONDS, seed=seed),
            alone.generate(said(action), seconds=SECONDS, seed=seed),
            parts_for(action),
        ),
    )
    if options.quick:
        return  # reading all captions takes minutes
    retrieval = Retrieval(dataset)
    yield "nearest caption", lambda gait, action, seed: retrieval.generate(at_once(gait, action), seed=seed)


def _by_parts(generator: DiffusionGenerator) -> Draw:
    def draw(gait: str, action: str, seed: int) -> Motion:
        entries = [Entry(said(gait), 0, SECONDS), Entry(said(action), 0, SECONDS, parts_for(action))]
        return generator.generate_timeline(entries, seed=seed)

    return draw


def said(content: str) -> str:
    """A text that asks for one of the held-out contents."""
    known = _LEGS | _ARMS
    return known[content] if content in known else swap_sides(known[swap_sides(content)])


def at_once(gait: str, action: str) -> str:
    """A text that asks for both."""
    return f"{said(action)} while {doing(said(gait))}"


# ---- Judging


_LOWER = columns_of(["lower_body"])
_LOWER[CONTACTS] = False  # a network's own word on its feet is not believed
LEGS, ARMS = (np.tile(columns, 5) for columns in (_LOWER, columns_of(["arms"])))  # five statistics of each feature


def learnt(dataset: Dataset, most: int) -> Judge:
    """Discriminants of training clips and their mirror images: all of a gait with something that the arms do, and
    `most` of each thing alone. A name that leaves the side open, where others tell it, is not learnt from."""
    random, clips = np.random.default_rng(0), list[tuple[int, bool, tuple[str, str]]]()
    for i, entry in enumerate(dataset.entries):
        for mirrored in (False, True):
            shown = parts_shown(swap_sides(entry.content) if mirrored else entry.content)
            if entry.split == "train" and shown is not None:
                clips.append((i, mirrored, shown))
    sided = {arms.rpartition("-")[0] for _, _, (_, arms) in clips if arms.endswith(("-left", "-right"))}
    taken: Counter[tuple[str, str]] = Counter()
    rows, names = [], []
    for k in random.permutation(len(clips)):
        i, mirrored, shown = clips[k]
        alone = STANDING in shown or IDLE in shown
        if shown[1] in sided or (alone and taken[shown] == most):
            continue
        taken[shown] += 1
        rows.append(statistics(dataset.features(i, mirrored)))
        names.append(shown)
    vectors, (legs, arms) = np.stack(rows), zip(*names, strict=True)
    return Judge(Discriminant(vectors[:, LEGS], legs), Discriminant(vectors[:, ARMS], arms))


def parts_shown(content: str) -> tuple[str, str] | None:
    """What legs and arms do in a clip of `content`; None for what is neither a gait, nor of the arms, nor both."""
    first, *rest = content.split("+")
    if rest:
        arms = rest[0] if _of_arms(rest[0]) else IDLE
        return plain_name(first), plain_name(arms)
    if first in GAITS:
        return plain_name(first), IDLE
    return (STANDING, plain_name(first)) if _of_arms(first) else None


def _of_arms(content: str) -> bool:
    return any(set(PARTS[part]) & set(PARTS["arms"]) for part in parts_for(content))


def held_out_clips(dataset: Dataset, judge: Judge, most: int) -> np.ndarray:
    """Which parts (n, 2) are recognised in the data set's own clips of the held-out pairs."""
    pairs = {"+".join(pair): pair for pair in HELD_OUT_PAIRS}
    rows = [i for i, e in enumerate(dataset.entries) if e.split == "test" and e.content in pairs][:most]
    if not rows:
        return np.zeros((0, 2), bool)
    return _right(judge([dataset.features(i) for i in rows]), [pairs[dataset.entries[i].content] for i in rows])


def _right(found: Sequence[tuple[str, str]], asked: Sequence[tuple[str, str]]) -> np.ndarray:
    """Whether legs, and arms, (n, 2), are found to do what they were asked to."""
    wanted = [(plain_name(gait), plain_name(action)) for gait, action in asked]
    return np.array([[a == b for a, b in zip(*each, strict=True)] for each in zip(found, wanted, strict=True)])


def _row(name: str, right: np.ndarray) -> tuple[str, ...]:
    if not len(right):
        return name, "–", "–", "–"
    return name, *(f"{share:.2f}" for share in (*right.mean(0), right.all(1).mean()))
