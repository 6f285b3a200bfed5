"""What the encoding is worth (DiffusionPhase, Table 2): an auto-encoder for each of its rows, trained equally long.

Judged are held-out clips that went through it, against the same clips as they were.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from lines import Line
from parts import Part
from phase_options import Options, halves

from motiongen.data.dataset import Dataset
from motiongen.diffusion.configs import PhaseAutoencoderConfig
from motiongen.diffusion.named_configs import named
from motiongen.diffusion.train import train
from motiongen.evaluation.metrics import BATCH, fid, r_precision
from motiongen.evaluation.protocol import Clips
from motiongen.motion import Motion, Source
from motiongen.phase.codec import Codec
from motiongen.phase.first_stage import read_first_stage

ROWS = ((8, False, 128), (30, False, 128), (30, True, 128), (30, True, 256))  # highest frequency, cosines, phases
CLIPS, QUICK_CLIPS, QUICK_STEPS = 192, 32, 2


def encodings(options: Options) -> Part:
    """R-precision, FID and the joints' error of reconstructed clips, row by row of Table 2."""
    data, judge = options.dataset, options.judge
    _, clips = halves(data, QUICK_CLIPS if options.quick else CLIPS)
    count = len(clips.motions) // BATCH * BATCH
    text, real = judge.embed_texts(clips.captions[:count]), judge.embed_motions(clips.motions[:count])
    rows = [("highest", "waves", "phases", "top 1", "top 3", "FID", "joints, cm")]
    top = r_precision(text, real)
    rows.append(("real clips", "", "", f"{top[0]:.3f}", f"{top[2]:.3f}", "0", "0"))
    distance = {}
    with TemporaryDirectory() as folder:
        for highest, cosine, phases in ROWS:
            sizes = PhaseAutoencoderConfig(highest=highest, phases=phases, cosine=cosine)
            run = (options.runs or Path(folder)) / f"{highest}-{'cos' if cosine else 'sin'}-{phases}"
            codec = _trained(sizes, data, run, QUICK_STEPS if options.quick else options.steps)
            made = [_through(codec, motion) for motion in clips.motions[:count]]
            embedded = judge.embed_motions(made)
            top = r_precision(text, embedded)
            distance[highest, cosine, phases] = fid(real, embedded)
            figures = f"{top[0]:.3f}", f"{top[2]:.3f}", f"{distance[highest, cosine, phases]:.3f}"
            rows.append(
                (str(highest), "sin, cos" if cosine else "sin", str(phases), *figures, f"{_apart(clips, made):.2f}")
            )
    lines = (
        Line("encodings", "FID: highest frequency 30 to 8", distance[ROWS[1]] / distance[ROWS[0]], 1.0, False),
        Line("encodings", "FID: sines and cosines to sines", distance[ROWS[2]] / distance[ROWS[1]], 1.0, False),
    )
    return Part(tuple(rows), lines)


def _trained(sizes: PhaseAutoencoderConfig, data: Dataset, run: Path, steps: int) -> Codec:
    train(replace(named("phase-autoencoder"), model=sizes, steps=steps), data, run)
    first = read_first_stage(run)
    return Codec(first.tensors, first.layout, *vars(first.run.scale).values())


def _through(codec: Codec, motion: Motion) -> Motion:
    return codec.motion([codec.encoded(motion)], [""], source=Source("auto-encoder"))


def _apart(clips: Clips, made: list[Motion]) -> float:
    """Mean distance in cm of joints from where they were, seen from the pelvis, on the same body."""
    off = []
    for clip, again in zip(clips.motions, made, strict=False):
        here = replace(clip, skeleton=again.skeleton).resampled(again.fps).positions()
        there = again.positions()
        count = min(len(here), len(there))
        here, there = (y[:count] - y[:count, :1] for y in (here, there))
        off.append(np.linalg.norm(here - there, axis=-1).mean())
    return 100 * float(np.mean(off))
