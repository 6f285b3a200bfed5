"""Does generated motion show what the text says? A classifier trained on real clips judges.

    python benchmarks/semantics.py runs/corpus.npz [--quick] [--json] [--gate]

Captions are of the tenth of all phrasings that no model was trained on. Both shares are macro averages over contents
with at least 12 clips: the judge's accuracy on held-out real clips, and on generated ones.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

sys.path.insert(0, str(Path(__file__).parent))
from judge import train_judge

from motiongen import corpus as corpora
from motiongen.captions import kept_for_testing, phrasings
from motiongen.features import motion_to_features
from motiongen.mdm_generator import MdmGenerator

TARGET = 0.75  # generated over real
COMMON = 100  # clips; a content with fewer has four or five held-out ones, mirrors counted, to be judged by
OUT_OF_SCOPE = (
    "solve a cubic equation", "cook dinner", "swim in the ocean", "fly an airplane", "play the piano", "do a backflip",
    "climb a ladder", "sit down on a chair", "drive a car to work", "quantum mechanics lecture", "eat a sandwich",
    "the stock market crashed", "write a poem about rain", "brush your teeth", "type on a keyboard", "sleep on a bed",
    "jump rope", "crawl under a table", "do a cartwheel", "play tennis", "open the door", "make coffee", "a cat purrs",
    "what is the capital of France", "ride a bicycle", "squat three times", "do push-ups", "asdfgh qwerty",
)  # fmt: skip


def held_out_captions(corpus: corpora.Corpus, contents: list[str], count: int, seed: int) -> list[tuple[str, str]]:
    """`count` pairs of caption and content, contents in turn, styles as the corpus has them; none trained on."""
    rng = np.random.default_rng(seed)
    pairs = []
    for n in range(count):
        content = contents[n % len(contents)]
        styles = sorted({s for c, s in zip(corpus.contents, corpus.styles, strict=True) if c == content})
        said = [p for s in styles for p in phrasings(content, s) if kept_for_testing(p)]
        pairs.append((str(rng.choice(said)), content))
    return pairs


def accuracy(said: list[str], true: list[str]) -> dict[str, float]:
    """Share right, by content."""
    return {c: float(np.mean([a == b for a, b in zip(said, true, strict=True) if b == c])) for c in dict.fromkeys(true)}


def main(
    corpus: Annotated[Path, tyro.conf.Positional] = Path("runs/corpus.npz"),
    weights: Path | None = None,
    clips: int = 200,
    judge_steps: int = 1500,
    sampler: str = "dpm-solver-2m",
    steps: int = 10,
    guidance: float = 2.5,
    seed: int = 0,
    quick: bool = False,
    as_json: Annotated[bool, tyro.conf.arg(name="json")] = False,
    gate: bool = False,
) -> int:
    """Print the judge's accuracy on held-out real clips and on generated ones, and how scope is told."""
    if quick:
        clips, judge_steps = 54, 250
    if not corpus.exists():
        print(f"semantics: no corpus at {corpus}; build one with python -m motiongen.corpus", file=sys.stderr)
        return 2
    data = corpora.load(corpus)
    counts = Counter(data.contents)
    contents = [c for c in counts if counts[c] >= 12]
    judge = train_judge(data, contents, steps=judge_steps)
    rows = [(int(i), m) for i in np.flatnonzero(data.held_out) for m in (False, True)]
    rows = [(i, m) for i, m in rows if data.content(i, m) in contents]
    real = accuracy(judge.judge([data.clip(*r) for r in rows]), [data.content(*r) for r in rows])

    generator = MdmGenerator(weights, sampler=sampler, steps=steps)
    pairs = held_out_captions(data, contents, clips, seed)
    motions = []
    for start in range(0, len(pairs), 20):
        texts = [t for t, _ in pairs[start : start + 20]]
        motions += generator.generate_batch(texts, seed=seed + start, guidance=guidance)
    said = judge.judge([motion_to_features(m) for m in motions])
    made = accuracy(said, [c for _, c in pairs])
    confused = Counter((c, s) for (_, c), s in zip(pairs, said, strict=True) if c != s).most_common(12)

    familiar = float(np.mean([generator.familiarity(t).known for t, _ in pairs]))
    strange = float(np.mean([generator.familiarity(t).known for t in OUT_OF_SCOPE]))
    result = {
        "clips": clips,
        "real_held_out_clips": len(rows),
        "real": float(np.mean(list(real.values()))),
        "generated": float(np.mean(list(made.values()))),
        "warned_in_scope": 1 - familiar,
        "warned_out_of_scope": 1 - strange,
        "sampler": sampler,
        "steps": steps,
        "guidance": guidance,
        "weights": generator.digest,
        "by_content": {c: {"real": real[c], "generated": made[c]} for c in contents},
    }
    ratio = result["ratio"] = result["generated"] / result["real"]
    common = [c for c in contents if counts[c] >= COMMON]
    result["ratio_common"] = float(np.sum([made[c] for c in common]) / np.sum([real[c] for c in common]))
    if as_json:
        print(json.dumps(result, indent=1))
    else:
        print(f"{'content':22} {'real':>6} {'generated':>10}")
        for c in contents:
            print(f"{c:22} {real[c]:6.0%} {made[c]:10.0%}")
        print(f"{'macro average':22} {result['real']:6.1%} {result['generated']:10.1%}   ratio {ratio:.3f}")
        print(f"over the {len(common)} contents with at least {COMMON} clips the ratio is {result['ratio_common']:.3f}")
        print("most confused: " + ", ".join(f"{a} → {b} ×{n}" for (a, b), n in confused))
        print(
            f"warned: {1 - familiar:.1%} of {clips} captions in scope, {1 - strange:.1%} of {len(OUT_OF_SCOPE)} out of"
        )
    if gate and ratio < TARGET:
        print(f"semantics: generated over real is {ratio:.3f}, the target is {TARGET}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(tyro.cli(main))
