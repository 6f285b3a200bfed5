"""How good is the ruler? What the rules of `motiongen.text.claims` say where the truth is known.

python -m motiongen.evaluation.language.ruler [--dataset DIR] [--each N] [--json]

On hand-written gestures every count, side, angle and speed is known; of motion capture the content, and its side. Each
motion is asked for what it shows, and for what it does not show. Two mistakes are told apart: a right motion called
wrong, and a wrong one called right. With a data set the judges are held against its held-out clips as well.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from motiongen.data.dataset import Dataset, DatasetError, open_dataset
from motiongen.gestures.catalogue import gestures, perform
from motiongen.measure.clip import Seen, observe
from motiongen.text.captions import swap_sides
from motiongen.text.claims import NEAR_DEG, Asked, Claim, Pace, holds

_COUNTED = {
    "wave": "wave", "nod": "nod", "shake-head": "shake", "clap": "clap", "squat": "squat", "jump": "jump",
    "march": "step", "bow": "bow", "step-forward": "step", "step-back": "step",
}  # fmt: skip
_ANGLED = {"turn": "turn", "bow": "bow", "raise-arm": "arm", "raise-arm-sideways": "arm"}
_PACED = ("wave", "nod", "shake-head", "clap", "squat", "bow")
_SIDED = {
    "wave": "wave", "raise-arm": "raise", "salute": "hand", "point-up": "hand", "beckon": "hand",
    "hand-on-heart": "hand", "kick": "leg", "raise-knee": "leg", "stand-on-one-leg": "leg",
}  # fmt: skip
_SIGNS = {  # of contents of motion capture: something that each shows, with its side
    "wave-left-hand": Claim("wave", "left"), "raise-up-left-hand": Claim("raise", "left"),
    "walk-turn-left": Claim("turn", "left"), "walk-left": Claim("aside", "left"),
}  # fmt: skip
_DONE = {"walk": Claim("walk"), "run": Claim("run"), "bow": Claim("bow"), "wave-both-hands": Claim("wave", "both"),
         "raise-up-both-hands": Claim("raise", "both")}  # fmt: skip
_NOT_DONE = (Claim("nod", count=2), Claim("clap", count=2), Claim("squat"), Claim("jump"))


@dataclass(frozen=True)
class Case:
    """A motion, something asked of it, whether it truly does that, and under which name it is told of."""

    what: str
    seen: Seen
    claim: Claim
    true: bool


@dataclass(frozen=True)
class Trust:
    """Of `right` motions that do what is asked the share `found` so; of `wrong` ones the share `refused`."""

    what: str
    right: int
    found: float
    wrong: int
    refused: float


def trust(cases: Sequence[Case]) -> tuple[Trust, ...]:
    """What the ruler is worth, by what it is asked for; NaN where no case was there."""
    out = []
    for what in dict.fromkeys(case.what for case in cases):
        right = [holds(Asked((case.claim,)), case.seen) for case in cases if case.what == what and case.true]
        wrong = [not holds(Asked((case.claim,)), case.seen) for case in cases if case.what == what and not case.true]
        out.append(Trust(what, len(right), _share(right), len(wrong), _share(wrong)))
    return tuple(out)


def _share(good: list[bool]) -> float:
    return float(np.mean(good)) if good else float("nan")


def gesture_cases(each: int, seed: int = 0) -> Iterator[Case]:
    """`each` performances of every gesture that can be measured, drawn over all its parameters."""
    rng = np.random.default_rng(seed)
    for _ in range(each):
        for name, action in _COUNTED.items():
            yield from _counts(name, action, rng)
        for name, action in _ANGLED.items():
            yield from _angles(name, action, rng)
        for name in _PACED:
            yield from _paces(name, rng)
        for name, action in _SIDED.items():
            yield from _sides(name, action, rng)


def _counts(name: str, action: str, rng: np.random.Generator) -> Iterator[Case]:
    """One to five, and whether any other number would be believed. One step of a march is a raised knee: no case."""
    family = gestures()[name]
    count = int(rng.integers(2 if name == "march" else 1, 6))
    seen = _performed(name, rng, count=count, speed=rng.uniform(*family.speeds))
    for said in range(1, 6):
        yield Case(f"counts: {name}", seen, Claim(action, count=said), said == count)


def _angles(name: str, action: str, rng: np.random.Generator) -> Iterator[Case]:
    family = gestures()[name]
    amplitude = rng.uniform(*family.amplitudes)
    seen, degrees = _performed(name, rng, amplitude=amplitude), family.degrees * amplitude
    for off in (0.0, 0.5, -0.5, 1.6, -1.6):
        said = degrees + off * NEAR_DEG[action]
        if said > 0:
            yield Case(f"degrees: {name}", seen, Claim(action, degrees=said), abs(off) < 1)


def _paces(name: str, rng: np.random.Generator) -> Iterator[Case]:
    """As slow and as quick as the gesture generator makes it for these words, and as usual."""
    action = _COUNTED.get(name, name)
    for speed, pace in ((0.7, "slow"), (1.0, ""), (1.4, "quick")):
        seen = _performed(name, rng, speed=speed)
        said: Pace
        for said in ("slow", "quick"):
            yield Case(f"speed: {name}", seen, Claim(action, pace=said), said == pace)


def _sides(name: str, action: str, rng: np.random.Generator) -> Iterator[Case]:
    side = str(rng.choice(["left", "right"]))
    seen = _performed(name, rng, side=side)
    for said in ("left", "right"):
        yield Case(f"side: {name}", seen, replace(Claim(action), side=said), said == side)


def _performed(
    name: str,
    rng: np.random.Generator,
    *,
    side: str | None = None,
    count: int = 1,
    speed: float = 1.0,
    amplitude: float = 1.0,
) -> Seen:
    seed = int(rng.integers(2**31))
    return observe(perform(name, side=side, count=count, speed=float(speed), amplitude=float(amplitude), seed=seed))


def mocap_cases(dataset: Dataset, each: int, seed: int = 0) -> Iterator[Case]:
    """Up to `each` clips of every content whose side, or action, is known, and their mirror images."""
    rng = np.random.default_rng(seed)
    signs = _SIGNS | {swap_sides(content): replace(c, side="right") for content, c in _SIGNS.items()}
    for content, claim in (signs | _DONE).items():
        clips = [i for i, entry in enumerate(dataset.entries) if entry.content == content and entry.style]
        for i in rng.permutation(clips)[:each]:
            seen = observe(dataset.motion(int(i)))
            kind = "side" if content in signs else "action"
            yield Case(f"motion capture, {kind}: {content}", seen, claim, True)
            if content in signs:
                other = replace(claim, side="left" if claim.side == "right" else "right")
                yield Case(f"motion capture, {kind}: {content}", seen, other, False)
            for absent in _NOT_DONE:
                yield Case(f"motion capture, {kind}: {content}", seen, absent, False)


def main(argv: Sequence[str] | None = None) -> int:
    """Print what the ruler is worth; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m motiongen.evaluation.language.ruler", description=__doc__)
    parser.add_argument("--dataset", type=Path, help="a built data set with motion capture in it")
    parser.add_argument("--each", type=int, default=20, help="motions of each kind")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args(argv)
    cases = list(gesture_cases(args.each))
    if args.dataset is not None:
        try:
            cases += mocap_cases(open_dataset(args.dataset), args.each)
        except DatasetError as error:
            print(error, file=sys.stderr)
            return 2
    found = trust(cases)
    if args.json:
        print(json.dumps([asdict(each) for each in found], indent=1))
        return 0
    print(f"{'asked for':46} {'right':>5} {'found':>6} {'wrong':>6} {'refused':>8}")
    for each in found:
        print(f"{each.what:46} {each.right:5} {each.found:6.1%} {each.wrong:6} {each.refused:8.1%}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
