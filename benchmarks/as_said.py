"""What a text says exactly: what the network alone makes of it, what is put right, and the best of a few candidates.

The prompts are those of the language tests (docs/language.md), and so is the measuring.
"""

from __future__ import annotations

from lines import Line
from parts import Options, Part

from motiongen.candidates import DEFAULT_CANDIDATES, choose_from
from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.evaluation.language.prompts import Prompt, prompts
from motiongen.measure.clip import observe
from motiongen.motion import Motion
from motiongen.text.claims import holds

CATEGORIES = ("left and right", "counts", "degrees", "speed", "two at once", "sequences")
EACH, QUICK_EACH = 40, 4
BATCH = 12
GAINING = ("counts", "sequences")  # in which it must help


def as_said(options: Options) -> Part:
    """Shares of prompts that are done, category by category; sequences and counts must gain from being put right."""
    alone = DiffusionGenerator(options.weights, alone=True)
    helped = DiffusionGenerator(options.weights)
    each = QUICK_EACH if options.quick else EACH
    rows, gains = [], {}
    for category in CATEGORIES:
        asked = [p for p in prompts(each) if p.category == category]
        plain, right = (_drawn(generator, asked) for generator in (alone, helped))
        best = [
            choose_from(motion, helped, p.text, candidates=DEFAULT_CANDIDATES, seed=i * DEFAULT_CANDIDATES).motion
            for i, (p, motion) in enumerate(zip(asked, right, strict=True))
        ]
        shares = [_share(asked, motions) for motions in (plain, right, best)]
        gains[category] = shares[1] - shares[0]
        rows.append((category, str(len(asked)), *(f"{share:.2f}" for share in shares)))
    head = ("said", "prompts", "network alone", "put right", f"best of {DEFAULT_CANDIDATES}")
    lines = tuple(Line("said", f"{name}: gain from being put right", gains[name], 0.2, True) for name in GAINING)
    return Part((head, *rows), lines)


def _drawn(generator: DiffusionGenerator, asked: list[Prompt]) -> list[Motion]:
    """One motion a prompt, prompt i from seed i times the number of candidates."""
    out = []
    for start in range(0, len(asked), BATCH):
        texts = [p.text for p in asked[start : start + BATCH]]
        seeds = [(start + i) * DEFAULT_CANDIDATES for i in range(len(texts))]
        out += generator.generate_batch(texts, seed=seeds)
    return out


def _share(asked: list[Prompt], motions: list[Motion]) -> float:
    done = [p.asked is not None and holds(p.asked, observe(m)) for p, m in zip(asked, motions, strict=True)]
    return sum(done) / len(done)
