"""Edits and timelines: does what is kept stay, does what is drawn meet it, and does each thing happen in its time?

The clips are gestures, which need neither weights nor data, turned and moved to somewhere else in the world.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from lines import Line
from parts import Options, Part

from motiongen.compose.motions import sharpest
from motiongen.compose.parts import joints_of
from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.diffusion.ranges import kept_frames, runs
from motiongen.diffusion.timeline import Entry
from motiongen.gestures.catalogue import gestures, perform
from motiongen.measure.clip import observe
from motiongen.motion import SMPL_JOINTS, Motion
from motiongen.rotation import quat_mul, quat_rotate, yaw_quat
from motiongen.text.asking import asked_of
from motiongen.text.claims import holds

CLIPS, QUICK_CLIPS = 20, 4
SECONDS = 4.0
RANGES = {"both ends": "0:1s,3s:", "the start": "0:2s", "the end": "2s:"}
PARTS = {"left_arm": "a person waves with the left hand", "upper_body": "a person bows", "head": "a person nods"}
STILL = 0.25  # m/s: a smaller jump is none, also in a clip that hardly moves
STORY = (
    Entry("a person walks forward", 0, 5),
    Entry("a person waves with the right hand", 5, 10),
    Entry("a person bows", 10, 15),
    Entry("a person raises both hands", 15, 20),
)
SEEDS, QUICK_SEEDS = 5, 1
SEAM_S = 0.5


def editing(options: Options) -> Part:
    """What is kept, and the seams, over clips and ranges and over clips and parts."""
    generator, clips = DiffusionGenerator(options.weights), _clips(QUICK_CLIPS if options.quick else CLIPS)
    rows = [("what is kept", "moved by, m", "jump at seams / clip's own, median", "most")]
    moved, ratios = [], []
    for name, ranges in RANGES.items():
        found = [_between(generator, clip, ranges, seed) for seed, clip in enumerate(clips)]
        rows.append(_row(name, [m for m, _ in found], [r for _, r in found]))
        moved += [m for m, _ in found]
        ratios += [r for _, r in found]
    turned, shifted = [], []
    for part, text in PARTS.items():
        found = [_parts(generator, clip, part, text, seed) for seed, clip in enumerate(clips)]
        rows.append((f"all but {part}", f"{max(m for _, m in found):.1e}", "–", "–"))
        turned += [t for t, _ in found]
        shifted += [m for _, m in found]
    return Part(
        tuple(rows),
        (
            Line("editing", "kept frames move by, m", max(moved), 1e-4, False),
            Line("editing", "velocity jump at seams over the clip's own, worst", max(ratios), 2.0, False),
            Line("editing", "other joints turn on their parents by, rad", max(turned), 1e-4, False),
            Line("editing", "the root of a part edit moves by, m", max(shifted), 1e-4, False),
        ),
    )


def timeline(options: Options) -> Part:
    """A story of four lines, 20 s: is each told in its time, and are its seams within what gestures do themselves?"""
    generator, seeds = DiffusionGenerator(options.weights), range(QUICK_SEEDS if options.quick else SEEDS)
    stories = [generator.generate_timeline(STORY, seed=seed) for seed in seeds]
    told = {e.text: np.mean([_does(_cut(story, e.start_s, e.end_s), e.text) for story in stories]) for e in STORY}
    own = max(sharpest(clip) for clip in _clips(CLIPS))
    seams = [sharpest(_cut(s, e.start_s - SEAM_S, e.start_s + SEAM_S)) for s in stories for e in STORY[1:]]
    rows = [("what", "share of seeds in which it is seen in its time")]
    rows += [(text, f"{share:.2f}") for text, share in told.items()]
    return Part(
        tuple(rows),
        (
            Line("timeline", "entries seen in their time, share", float(np.mean(list(told.values()))), 0.75, True),
            Line("timeline", "sharpest turn at a seam over that of gestures", max(seams) / own, 1.0, False),
        ),
    )


def _clips(count: int) -> list[Motion]:
    names = list(gestures())
    chosen = [names[i] for i in np.linspace(0, len(names) - 1, count).round().astype(int)]
    return [_elsewhere(perform(name, seed=i), 0.3 * i) for i, name in enumerate(chosen)]


def _elsewhere(clip: Motion, yaw: float) -> Motion:
    """`clip` facing another way at another place, held at its end until it is long enough."""
    rows = np.minimum(np.arange(max(len(clip), round(SECONDS * clip.fps))), len(clip) - 1)
    quat = clip.joint_quat[rows]
    quat[:, 0] = quat_mul(yaw_quat(yaw), quat[:, 0])
    root = quat_rotate(yaw_quat(yaw), clip.root_pos[rows]) + np.array([3.0, -2.0, 0.0])
    return replace(clip, root_pos=root, joint_quat=quat, contacts=None)


def _between(generator: DiffusionGenerator, clip: Motion, ranges: str, seed: int) -> tuple[float, float]:
    """How far kept joints moved, and the largest jump of a velocity at a seam over the clip's own largest."""
    out = generator.edit(clip, clip.labels[0].text, keep=ranges, seed=seed)
    kept = kept_frames(ranges, len(clip), clip.fps)
    seams = [f for run in runs(~kept) for end in run for f in (end - 1, end) if 1 <= f <= len(clip) - 2]
    jump = _jumps(out)[np.array(seams) - 1].max() / max(_jumps(clip).max(), STILL)
    return float(np.abs(out.positions() - clip.positions())[kept].max()), float(jump)


def _parts(generator: DiffusionGenerator, clip: Motion, part: str, text: str, seed: int) -> tuple[float, float]:
    """By how much the other joints turned, and the root moved."""
    out = generator.edit(clip, text, parts=[part], seed=seed)
    rest = [j for j in range(len(SMPL_JOINTS)) if j not in joints_of([part])]
    apart = np.abs(np.abs(np.sum(out.joint_quat * clip.joint_quat, axis=-1)) - 1)[:, rest].max()
    return float(2 * np.sqrt(2 * apart)), float(np.abs(out.root_pos - clip.root_pos).max())


def _jumps(clip: Motion) -> np.ndarray:
    velocity = np.diff(clip.positions(), axis=0) * clip.fps
    return np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max(1)


def _cut(motion: Motion, start_s: float, end_s: float) -> Motion:
    rows = slice(round(start_s * motion.fps), round(end_s * motion.fps))
    contacts = None if motion.contacts is None else motion.contacts[rows]
    return replace(motion, root_pos=motion.root_pos[rows], joint_quat=motion.joint_quat[rows], contacts=contacts)


def _does(motion: Motion, text: str) -> bool:
    asked = asked_of(text)
    return asked is not None and holds(asked, observe(motion))


def _row(name: str, moved: list[float], ratios: list[float]) -> tuple[str, ...]:
    return name, f"{max(moved):.1e}", f"{np.median(ratios):.2f}", f"{max(ratios):.2f}"
