"""Quality against length (DiffusionPhase, Fig. 4): held-out texts and clips, 1 to 5 times as long as they were.

As in the paper, the last stretch of a long motion, as long as the clip was, is held against real clips. `FID` here is
that of a judge trained on our corpus, of fewer clips than it has numbers: compare columns, not papers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path

from lines import Line
from parts import Part
from phase_options import Options, halves

from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.diffusion.weights import FOLDER
from motiongen.evaluation.metrics import fid, kid
from motiongen.evaluation.protocol import Clips
from motiongen.motion import Motion, Source
from motiongen.phase.generator import PhaseGenerator
from motiongen.phase.phrases import lasting

TIMES, QUICK_TIMES = (1, 2, 3, 4, 5), (1, 5)
CLIPS, QUICK_CLIPS = 192, 32
BATCH = 16
MOST_WORSE = 1.5  # times the distance at 1 ×, at 5 ×
OTHERS = ("mdm", "motiondiffuse")

Maker = Callable[[Clips, int], list[Motion]]


def lengths(options: Options) -> Part:
    """FID and KID for every way of making a motion long, and how much worse they are at 5 times the length."""
    reference, asked = halves(options.dataset, QUICK_CLIPS if options.quick else CLIPS)
    judge, phase = options.judge, PhaseGenerator(options.weights)
    makers: dict[str, Maker] = {
        "auto-encoder, repeated": lambda clips, times: _repeated(phase, clips, times),
        "diffusionphase, repeated": lambda clips, times: _drawn(phase, clips, times),
        "diffusionphase, drawn on": lambda clips, times: _drawn_on(phase, clips, times),
    }
    for name in OTHERS:
        if (file := FOLDER / f"{name}.safetensors").is_file():
            makers[name] = _plainly(file)
    real = judge.embed_motions(reference.motions)
    times = QUICK_TIMES if options.quick else TIMES
    rows = [("way", "measure", *(f"{n} ×" for n in times))]
    lines = []
    for name, make in {"real clips": lambda clips, times: list(clips.motions)}.items() | makers.items():
        made = [judge.embed_motions(_last(make(asked, n), asked)) for n in times]
        distances = [fid(real, each) for each in made]
        rows.append((name, "FID", *(f"{value:.2f}" for value in distances)))
        rows.append(("", "KID × 1000", *(f"{1000 * kid(real, each):.1f}" for each in made)))
        if name in ("auto-encoder, repeated", "diffusionphase, repeated"):
            worse = distances[-1] / distances[0]
            lines.append(Line("lengths", f"{name}: FID at 5 × to that at 1 ×", worse, MOST_WORSE, False))
    return Part(tuple(rows), tuple(lines))


def _last(motions: Sequence[Motion], asked: Clips) -> list[Motion]:
    """The end of each motion, as long as the clip that was asked for."""
    out = []
    for motion, clip in zip(motions, asked.motions, strict=True):
        count = min(len(motion), round(clip.duration * motion.fps) + 1)
        contacts = None if motion.contacts is None else motion.contacts[-count:]
        out.append(
            replace(motion, root_pos=motion.root_pos[-count:], joint_quat=motion.joint_quat[-count:], contacts=contacts)
        )
    return out


def _repeated(phase: PhaseGenerator, clips: Clips, times: int) -> list[Motion]:
    """Held-out clips through the auto-encoder, their primary segments repeated."""
    out = []
    for clip, caption in zip(clips.motions, clips.captions, strict=True):
        phrase = phase.codec.encoded(clip)
        long = lasting(phrase, times * phrase.frames) if times > 1 else phrase
        out.append(phase.codec.motion([long], [caption], source=Source("auto-encoder")))
    return out


def _drawn(phase: PhaseGenerator, clips: Clips, times: int) -> list[Motion]:
    """Phrases drawn as long as the clips, their primary segments repeated."""
    out = []
    for i, (clip, caption) in enumerate(zip(clips.motions, clips.captions, strict=True)):
        phrase = phase.phrases([caption], seconds=clip.duration, seeds=[i])[0]
        long = lasting(phrase, times * phrase.frames) if times > 1 else phrase
        out.append(phase.motion([long], [caption], seed=i))
    return out


def _drawn_on(phase: PhaseGenerator, clips: Clips, times: int) -> list[Motion]:
    """As many phrases one after the other as a motion is to be longer, each begun in the last one's pose."""
    pairs = zip(clips.motions, clips.captions, strict=True)
    return [
        phase.generate_sequence([caption] * times, seconds=clip.duration, seed=times * i)
        for i, (clip, caption) in enumerate(pairs)
    ]


def _plainly(file: Path) -> Maker:
    """All of it drawn at once by a network that makes frames."""
    generator = DiffusionGenerator(file, alone=True)

    def make(clips: Clips, times: int) -> list[Motion]:
        seconds = [round(motion.duration * times, 1) for motion in clips.motions]
        out: dict[int, Motion] = {}
        order = sorted(range(len(seconds)), key=lambda i: seconds[i])
        for long, same in groupby(order, key=lambda i: seconds[i]):
            rows = list(same)
            for rows_now in (rows[at : at + BATCH] for at in range(0, len(rows), BATCH)):
                texts = [clips.captions[i] for i in rows_now]
                out |= zip(rows_now, generator.generate_batch(texts, seconds=long, seed=rows_now), strict=True)
        return [out[i] for i in range(len(seconds))]

    return make
