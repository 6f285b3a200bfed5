"""Language tests: does a generator do what the text says? Measured in the motion, by category.

python -m motiongen.evaluation.language.run --generator NAME --dataset DIR [--quick] [--json]

NAME is mdm, gestures, retrieval, mean or real.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import track

from motiongen.candidates import BatchGenerator, choose
from motiongen.evaluation.language.prompts import Prompt, family, prompts
from motiongen.generator import Generator, PromptError, load_generator
from motiongen.measure.clip import observe
from motiongen.motion import Motion
from motiongen.text.claims import holds

Judge = Callable[[list[Motion]], list[str]]  # content, or style, of every motion

FULL, QUICK = 200, 20  # prompts a category
BATCH = 16
Z = 1.96  # of the normal distribution: 95 %


@dataclass(frozen=True)
class Row:
    """Of the `n` prompts of a category the `share` that was done right, and its 95 % interval."""

    category: str
    n: int
    share: float
    low: float
    high: float


def language_table(
    generator: Generator,
    asked: Sequence[Prompt],
    judge: Judge,
    style_judge: Judge,
    *,
    seed: int = 0,
    candidates: int = 1,
) -> tuple[Row, ...]:
    """Draw a motion for every prompt, number i from `seed` + i, and say how often it shows what was asked, by category.

    `judge` names the content of motions, `style_judge` their style. A prompt that the generator refuses is not done.
    """
    needed = [i for i, prompt in enumerate(asked) if prompt.known is None]
    drawn = dict(zip(needed, draw(generator, [asked[i].text for i in needed], seed, candidates), strict=True))
    motions = [drawn.get(i) for i in range(len(asked))]
    known = [prompt.known is not None and _known(generator, prompt.text) for prompt in asked]
    return rows(asked, verdicts(asked, motions, known, judge, style_judge))


def draw(generator: Generator, texts: Sequence[str], seed: int, candidates: int) -> list[Motion | None]:
    """A motion a text, text i from `seed` + i, the best of several `candidates`; None where the generator refuses."""
    if candidates == 1 and isinstance(generator, BatchGenerator):
        batches = [list(texts[start : start + BATCH]) for start in range(0, len(texts), BATCH)]
        starts = range(seed, seed + len(texts), BATCH)
        steps = track(list(zip(starts, batches, strict=True)), "drawing", console=Console(stderr=True))
        return [motion for start, batch in steps for motion in generator.generate_batch(batch, seed=start)]
    out: list[Motion | None] = []
    for i, text in enumerate(track(texts, "drawing", console=Console(stderr=True))):
        try:
            # Candidates of a text are drawn from seeds that no other text uses.
            out.append(choose(generator, text, candidates=candidates, seed=seed + i * candidates).motion)
        except PromptError:
            out.append(None)
    return out


def verdicts(
    asked: Sequence[Prompt], motions: Sequence[Motion | None], known: Sequence[bool], judge: Judge, style_judge: Judge
) -> list[bool]:
    """Whether each motion, and each `known`, is what its prompt asks for."""
    content = _judged(judge, motions, [bool(prompt.content) for prompt in asked])
    style = _judged(style_judge, motions, [bool(prompt.style) for prompt in asked])
    return [
        prompt.known == known[i]
        if prompt.known is not None
        else motion is not None
        and (not prompt.content or family(content[i]) == prompt.content)
        and (not prompt.style or style[i] == prompt.style)
        and (prompt.asked is None or holds(prompt.asked, observe(motion)))
        for i, (prompt, motion) in enumerate(zip(asked, motions, strict=True))
    ]


def rows(asked: Sequence[Prompt], right: Sequence[bool]) -> tuple[Row, ...]:
    """The share that is right, by category, in the order of the prompts."""
    out = []
    for category in dict.fromkeys(prompt.category for prompt in asked):
        of_it = [good for prompt, good in zip(asked, right, strict=True) if prompt.category == category]
        out.append(Row(category, len(of_it), sum(of_it) / len(of_it), *interval(sum(of_it), len(of_it))))
    return tuple(out)


def interval(right: int, n: int) -> tuple[float, float]:
    """95 % interval of a share of which `right` of `n` were seen (Wilson 1927, the score interval)."""
    share, z2 = right / n, Z * Z
    centre = (share + z2 / (2 * n)) / (1 + z2 / n)
    half = Z / (1 + z2 / n) * math.sqrt(share * (1 - share) / n + z2 / (4 * n * n))
    return max(0.0, centre - half), min(1.0, centre + half)


def _judged(judge: Judge, motions: Sequence[Motion | None], wanted: Sequence[bool]) -> dict[int, str]:
    """What the judge says of the motions that are there and wanted, by index; "" of all others."""
    which = [i for i, motion in enumerate(motions) if wanted[i] and motion is not None]
    said = dict.fromkeys(range(len(motions)), "")
    if which:
        said |= zip(which, judge([motion for i in which if (motion := motions[i]) is not None]), strict=True)
    return said


def _known(generator: Generator, text: str) -> bool:
    try:
        return generator.familiarity(text).known
    except PromptError:
        return False


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table of a generator; the exit code."""
    from motiongen.data.dataset import DatasetError, open_dataset
    from motiongen.evaluation.baselines import MeanPose, Retrieval
    from motiongen.evaluation.language.discriminants import content_judge, style_judge
    from motiongen.evaluation.language.real import real_prompts

    parser = argparse.ArgumentParser(prog="python -m motiongen.evaluation.language.run", description=__doc__)
    parser.add_argument("--generator", default="mdm", help="mdm, gestures, retrieval, mean, or real: held-out clips")
    parser.add_argument("--dataset", type=Path, required=True, help="a built data set")
    parser.add_argument("--weights", type=Path, help="weights of the mdm other than those that come with it")
    parser.add_argument("--candidates", type=int, default=1, help="motions drawn a prompt, of which the best is kept")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} prompts a category instead of {FULL}")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args(argv)
    try:
        dataset = open_dataset(args.dataset)
    except DatasetError as error:
        print(error, file=sys.stderr)
        return 2
    judges = content_judge(dataset), style_judge(dataset)
    each = QUICK if args.quick else FULL
    if args.generator == "real":
        asked, clips = real_prompts(dataset, each, args.seed)
        table = rows(asked, verdicts(asked, clips, [False] * len(asked), *judges))
    else:
        if args.generator == "mdm" and args.weights:
            from motiongen.diffusion.generator import DiffusionGenerator

            generator: Generator = DiffusionGenerator(args.weights)
        elif args.generator in ("retrieval", "mean"):
            generator = Retrieval(dataset) if args.generator == "retrieval" else MeanPose(dataset)
        else:
            generator = load_generator(args.generator)
        asked = prompts(each, args.seed)
        table = language_table(generator, asked, *judges, seed=args.seed, candidates=args.candidates)
    if args.json:
        print(json.dumps([asdict(row) for row in table], indent=1))
    else:
        print(f"{'category':26} {'n':>4} {'right':>6}   95 % interval")
        for row in table:
            print(f"{row.category:26} {row.n:4} {row.share:6.0%}   {row.low:.0%} to {row.high:.0%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
