"""Make the weights file of a training run: the network, how long motions last, and what it knows to be known."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np

from motiongen.data.dataset import Dataset, Entry
from motiongen.data.free import free_only, licences
from motiongen.data.texts import Texts, data_texts
from motiongen.diffusion.batches import CUT, LONGEST
from motiongen.diffusion.checkpoint import CHECKPOINT, read_checkpoint
from motiongen.diffusion.configs import DiffusionPhaseConfig
from motiongen.diffusion.lengths import fit_lengths
from motiongen.diffusion.run_folder import Run, read_run
from motiongen.diffusion.weights import Bank, Weights, load_weights, save_weights
from motiongen.features import FPS
from motiongen.nn import Floats, Tensors
from motiongen.phase.first_stage import read_first_stage
from motiongen.text.say_numbers import says_number

# Between phrasings never trained on (nearly all above 0.55) and prompts about something else (nearly all below 0.5);
# `rigcast eval` prints how many of both are told apart.
KNOWN = 0.50
ENDLESS_S = 6.0  # what goes on for as long as one likes is drawn this long where nobody says how long
MOST_TOLD = 1500  # captions of a content that are covered, the plainest
BANK = 1100  # captions by which a text is told to be known: what fits beside the network into 10 MB


def _said(data: Dataset) -> list[tuple[str, int, bool]]:
    """Caption, clip and whether it speaks of the mirror image, of all training clips."""
    rows = [i for i, e in enumerate(data.entries) if e.split == "train"]
    return [(c, i, m) for i in rows for m in (False, True) for c in data.captions(i, m)]


def make_bank(data: Dataset, texts: Texts) -> Bank:
    """Sentence vectors of captions of every content, so few that cover the others; contents in order of their clips."""
    by_content: dict[str, set[str]] = {}
    for caption, i, _ in _said(data):
        by_content.setdefault(_group(data.entries[i]), set()).add(caption)
    clips = Counter(_group(e) for e in data.entries if e.split == "train")
    contents = tuple(name for name, _ in clips.most_common())
    each = max(2, BANK // len(contents))
    vectors, which = [], []
    for i, name in enumerate(contents):
        captions = sorted(by_content[name], key=_plainness)[:MOST_TOLD]
        sentences = texts.sentences(captions)
        chosen = sentences[_cover(sentences, each)]
        vectors.append(chosen)
        which += [i] * len(chosen)
    return Bank(np.concatenate(vectors), tuple(which), contents, KNOWN)


def _plainness(caption: str) -> tuple[int, str]:
    """Short captions first: long ones say other things too."""
    return len(caption.split()), caption


def _group(entry: Entry) -> str:
    """What a clip counts as: its content; those that have none, and combinations, are one group a source."""
    return entry.source if entry.source == "composed" or not entry.content else entry.content


def _cover(x: Floats, count: int) -> list[int]:
    """Rows of at most `count` unit vectors `x` (N, D), to which all others are as near as greedy choice can bring them
    (facility location, Nemhauser et al. 1978)."""
    like = x @ x.T
    rows: list[int] = []
    near = np.zeros(len(x), np.float32)
    while len(rows) < min(count, len(x)):
        rows.append(int(np.maximum(like, near).sum(1).argmax()))
        near = np.maximum(near, like[rows[-1]])
    return rows


def make_lengths(data: Dataset, texts: Texts) -> Tensors:
    """The network that tells the length of a motion from its text."""
    said = [(c, data.entries[i]) for c, i, _ in _said(data)]
    said = [(c, e) for c, e in said if e.frames <= LONGEST or e.source in CUT]
    return fit_lengths(texts.sentences([c for c, _ in said]), np.array([_seconds(c, e) for c, e in said]))


def _seconds(caption: str, entry: Entry) -> float:
    endless = entry.source in CUT and not says_number(caption)
    return min(entry.seconds, ENDLESS_S if endless else LONGEST / FPS)


def _sizes(run: Run) -> dict[str, int | float | str]:
    """What has to be known of a network to run it; of phases, also what their auto-encoder is."""
    sizes: dict[str, int | float | str] = run.config["model"]
    if run.config["network"] != DiffusionPhaseConfig.network:
        return sizes | {"actions": len(run.actions)}
    layout = read_first_stage(Path(str(sizes["autoencoder"]))).layout
    return {k: v for k, v in sizes.items() if k != "autoencoder"} | asdict(layout)


def export(data: Dataset, folder: Path, path: Path, *, eight_bits: bool = False) -> Weights:
    """Write the averaged weights of the last checkpoint of the run in `folder` to `path` and read them back.

    `data` is what the run was trained on; from it come the bank, the lengths and the licences. Raises RunError or
    CheckpointError where the run is missing or damaged, DatasetError where no clip of `data` was for this run.
    """
    run, tensors = read_run(folder), read_checkpoint(folder / CHECKPOINT)
    data = free_only(data) if run.config["free"] else data
    texts = data_texts(data, [c for c, _, _ in _said(data)])
    learnt = [e for e in data.entries if e.split == "train"]
    hours = sum(e.seconds for e in learnt) / 3600
    training = {
        "data": ", ".join(sorted({e.source for e in learnt})),
        "clips": str(len(learnt)),
        "hours": f"{hours:.1f}",
        "steps": str(int(tensors["step"])),
        "batch": str(run.config["batch"]),
        "seed": str(run.config["seed"]),
    }
    made = Weights(
        tensors={k.removeprefix("average."): v.numpy() for k, v in tensors.items() if k.startswith("average.")},
        network=run.config["network"],
        sizes=_sizes(run),
        schedule=run.config["schedule"],
        prediction=run.config["prediction"],
        unconditioned=run.config["drop_text"] > 0,
        actions=run.actions,
        window=run.config["model"]["history"] + run.config["live"]["chunk"] if run.config.get("live") else LONGEST,
        mean=run.scale.mean,
        std=run.scale.std,
        offsets=run.scale.offsets,
        lengths=make_lengths(data, texts),
        bank=make_bank(data, texts),
        licence="; ".join(licences("; ".join({e.licence for e in learnt}))),
        training=training,
        digest="",
    )
    save_weights(made, path, eight_bits=eight_bits)
    return load_weights(path)
