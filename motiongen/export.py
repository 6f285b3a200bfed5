"""Make the weights file from a training run's last checkpoint.

python -m motiongen.export runs/corpus.npz runs/mdm motiongen/weights/mdm.safetensors
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file

from motiongen import corpus as corpora
from motiongen.captions import CONTENTS, STYLES, kept_for_testing
from motiongen.features import FPS
from motiongen.skeletons import BANDAI_NAMCO
from motiongen.text import TextEncoder
from motiongen.train import statistics
from motiongen.weights import Bank, Weights, load_weights, save_weights

# Between phrasings kept for testing (nine in ten lie above 0.6) and prompts about something else (nearly all below
# 0.53); `benchmarks/semantics.py` prints both shares.
KNOWN = 0.54


def make_bank(corpus: corpora.Corpus) -> Bank:
    """Plain captions of every content, and two in every style, as sentence vectors; none that is kept for testing."""
    contents = tuple(CONTENTS)
    captions, which = [], []
    for i, name in enumerate(contents):
        what = CONTENTS[name]
        said = [*what.plain, *(f"a person {verb}" for verb in what.third), *what.nouns]
        for style, (adverbs, adjectives) in STYLES.items():
            if style != "normal":
                article = "an" if adjectives[0][0] in "aeiou" else "a"
                said += [f"{what.plain[0]} {adverbs[0]}", f"{article} {adjectives[0]} person {what.third[0]}"]
        said = [c for c in dict.fromkeys(said) if not kept_for_testing(c)]
        captions += said
        which += [i] * len(said)
    encoder = TextEncoder()
    vectors = np.concatenate([encoder(captions[i : i + 128])[2] for i in range(0, len(captions), 128)])
    lengths = np.diff(corpus.starts) / FPS
    seconds = tuple(
        float(np.clip(np.median(lengths[[c == name for c in corpus.contents]]), 2.0, 6.0).round(1)) for name in contents
    )
    return Bank(vectors, tuple(which), contents, seconds, KNOWN)


def export(corpus: corpora.Corpus, run: Path, path: Path) -> Weights:
    """Write the averaged weights of the run's last checkpoint to `path` and read them back."""
    config = json.loads((run / "config.json").read_text())
    tensors = load_file(run / "checkpoint.safetensors")
    average = {k.removeprefix("average."): v for k, v in tensors.items() if k.startswith("average.")}
    mean, std = statistics(corpus)
    training = {
        "data": "Bandai-Namco Research Motiondataset 1 and 2",
        "clips": str(int((~corpus.held_out).sum())),
        "steps": str(int(tensors["step"])),
        "batch": str(config["batch"]),
        "seed": str(config["seed"]),
    }
    shape = config["model"]["patch"], config["model"]["heads"]
    offsets = corpus.offsets.astype(np.float32)
    licence = BANDAI_NAMCO.licence
    save_weights(Weights(average, *shape, mean, std, offsets, make_bank(corpus), licence, training, ""), path)
    return load_weights(path)


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit("usage: python -m motiongen.export CORPUS.npz RUN OUT.safetensors")
    made = export(corpora.load(Path(sys.argv[1])), Path(sys.argv[2]), Path(sys.argv[3]))
    print(f"{sys.argv[3]}: {Path(sys.argv[3]).stat().st_size / 1e6:.2f} MB, {made.digest}, {made.training}")
