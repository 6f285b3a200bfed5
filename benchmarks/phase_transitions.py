"""Transitions (DiffusionPhase, Sec. 4.4): does it help to begin a phrase in the pose in which the one before ended?

Held-out texts in pairs: the first gives a motion, the second one that goes on from it, begun in the first one's last
pose, in the last pose of another pair's, or in any. The stretch around the join goes through the auto-encoder: what is
like the real motion that it was trained on, it gives back better than what jumps.
"""

from __future__ import annotations

import numpy as np
from lines import Line
from parts import Part
from phase_options import Options, halves

from motiongen.nn import Floats
from motiongen.phase.codec import Codec
from motiongen.phase.generator import PhaseGenerator
from motiongen.phase.phrases import Phrase, joined_frames, whole_turns

PAIRS, QUICK_PAIRS = 32, 8
ROUNDS = 8  # draws of the 32 texts
SECONDS = 4.0
AROUND, SEEN = 30, 10  # frames on either side of the join: encoded, and compared


def transitions(options: Options) -> Part:
    """Error of the auto-encoder around joins, and how far apart the two poses are, for three ways to begin."""
    _, asked = halves(options.dataset, 2 * PAIRS)
    pairs, rounds = (QUICK_PAIRS, 1) if options.quick else (PAIRS, ROUNDS)
    first, second = asked.captions[:pairs], asked.captions[PAIRS : PAIRS + pairs]
    generator = PhaseGenerator(options.weights)
    found: dict[str, list[tuple[float, float]]] = {"last pose": [], "random pose": [], "no pose": []}
    for number in range(rounds):
        seeds = [1000 * number + i for i in range(pairs)]
        begun = [whole_turns(p) for p in generator.phrases(first, seconds=SECONDS, seeds=seeds)]
        last = np.stack([generator.codec.pose(phrase) for phrase in begun])
        for name, poses in zip(found, (last, np.roll(last, 1, axis=0), None), strict=True):
            ends = generator.phrases(second, seconds=SECONDS, seeds=[s + 500 for s in seeds], poses=poses)
            joins = zip(begun, map(whole_turns, ends), strict=True)
            found[name] += [_join(generator.codec, one, other) for one, other in joins]
    rows = [("begun in", "joins", "error of the auto-encoder", "poses apart")]
    means = {name: np.mean(each, axis=0) for name, each in found.items()}
    rows += [(name, str(len(found[name])), f"{error:.3f}", f"{far:.3f}") for name, (error, far) in means.items()]
    lines = tuple(
        Line(
            "transition",
            f"error with the last pose to that with {other}",
            means["last pose"][0] / means[other][0],
            1.0,
            False,
        )
        for other in ("random pose", "no pose")
    )
    return Part(tuple(rows), lines)


def _join(codec: Codec, one: Phrase, other: Phrase) -> tuple[float, float]:
    """Root mean squares in normalised features: what the auto-encoder changes around the join, and how far apart the
    poses are."""
    x: Floats = codec.features([one, other])[0]
    at = one.head + one.loop
    stretch = x[max(0, at - AROUND) : min(joined_frames([one, other]), at + AROUND + 1)]
    middle = at - max(0, at - AROUND)
    seen = slice(max(0, middle - SEEN), middle + SEEN + 1)
    again = codec.features([codec.coded(stretch)])[0]
    apart = codec.pose(one) - codec.pose(other)
    return float(np.sqrt(np.square(again - stretch)[seen].mean())), float(np.sqrt(np.square(apart).mean()))
