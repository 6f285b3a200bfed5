"""A long live motion with random prompts, and what can be measured of it without any network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.evaluation.metrics import fid
from motiongen.features import FPS, TURNS
from motiongen.live.generator import LiveGenerator
from motiongen.measure.clip import observe
from motiongen.motion import Motion
from motiongen.rotation import quat_continuous
from motiongen.text.asking import asked_of
from motiongen.text.claims import holds

PROMPTS = (
    "wave with the right hand", "wave with the left hand", "bow", "nod", "shake the head", "turn to the left",
    "turn to the right", "raise both arms", "raise the right hand", "raise the left hand", "walk forward",
    "walk backwards", "clap the hands", "squat", "jump", "kick with the right foot", "march in place",
    "step forward", "salute with the right hand", "point forward with the left hand",
)  # fmt: skip
STILL = 0.3  # rad/s of a joint: less is breath
ANSWER_S = 2.0  # in which something has to move
TAKES = 3  # of each prompt, by the offline model
POSES_A_MINUTE = 300  # that are looked at
DEALS = 50  # of the minutes by chance
KEPT = 24  # directions of the pose in which distributions are compared


@dataclass(frozen=True)
class Hour:
    """`not_finite` frames; prompts at which nothing moved (`still`); `drift`: Fréchet distance of poses between the
    first sixth and the last, over what it is where chance deals their minutes; which prompts were recognised in
    their window, live and offline, and their `share`; `spread`: standard deviation of all poses."""

    minutes: float
    prompts: int
    not_finite: int
    still: int
    drift: float
    live: float
    offline: float
    share: float
    spread: float


def hour(weights: Path, *, minutes: float, prompts: int, seed: int = 0) -> Hour:
    """`prompts` at random times of `minutes`, each from `PROMPTS`; the rest of the time it idles."""
    rng = np.random.default_rng(seed)
    live = LiveGenerator(weights, seed=seed)
    total = round(minutes * 60 * FPS)
    least = total // prompts
    said = [(i * least + int(rng.integers(least // 4)), str(rng.choice(PROMPTS))) for i in range(prompts)]
    poses, not_finite, still, right = [], 0, 0, 0
    for i, (at, text) in enumerate(said):
        _until(live, at, [])
        live.say(text, at)
        window: list[Motion] = []
        end = said[i + 1][0] if i + 1 < prompts else total
        poses += _until(live, end, window)
        motion = _whole(window)
        not_finite += int((~np.isfinite(motion.root_pos)).any(1).sum())
        still += _stillness(motion)
        asked = asked_of(text)
        right += asked is not None and holds(asked, observe(motion))
    rows = np.concatenate(poses)[:: round(FPS * 60 / POSES_A_MINUTE)]
    drawn = _offline(seed)
    return Hour(
        minutes,
        prompts,
        not_finite,
        still,
        _drift(rows),
        right / prompts,
        drawn,
        right / prompts / drawn,
        float(rows.std(0).mean()),
    )


def _until(live: LiveGenerator, frame: int, kept: list[Motion]) -> list[np.ndarray]:
    """Poses (n, 132) up to `frame`, and the motions that they are of into `kept`."""
    rows = []
    while live.frame < frame:
        first = live.frame
        motion = live.next_chunk()
        kept.append(motion)
        rows.append(live.state.history[-min(len(motion), live.frame - first) :, TURNS])
    return rows


def _whole(motions: list[Motion]) -> Motion:
    return Motion(
        np.concatenate([m.root_pos for m in motions]),
        quat_continuous(np.concatenate([m.joint_quat for m in motions])),
        FPS,
        motions[0].skeleton,
    )


def _stillness(motion: Motion) -> bool:
    """Whether no joint moves in the time in which a prompt has to be answered."""
    quat = motion.joint_quat[: round(ANSWER_S * FPS)]
    turned = 2 * np.arccos(np.clip(np.abs((quat[1:] * quat[:-1]).sum(-1)), 0, 1)) * FPS
    return bool(turned.max() < STILL)


def _drift(rows: np.ndarray) -> float:
    """Fréchet distance of the first sixth and the last, over the median of that when their minutes are dealt to two
    sides by chance: what it is where nothing but chance sets them apart."""
    sixth, minute = len(rows) // 6, max(2, min(POSES_A_MINUTE, len(rows) // 24))
    both = np.concatenate([rows[:sixth], rows[-sixth:]])
    axes = np.linalg.svd(both - both.mean(0), full_matrices=False)[2][:KEPT]
    seen = (both - both.mean(0)) @ axes.T
    number = np.arange(len(seen)) // minute
    rng, by_chance = np.random.default_rng(0), []
    for _ in range(DEALS):
        side = rng.permutation(number[-1] + 1) % 2
        by_chance.append(fid(seen[side[number] == 0], seen[side[number] == 1]))
    return fid(seen[:sixth], seen[sixth:]) / max(float(np.median(by_chance)), 1e-9)


def _offline(seed: int) -> float:
    """Share of the same prompts that the offline model does, drawn alone, by the same measure."""
    generator = DiffusionGenerator(alone=True)
    texts = list(PROMPTS) * TAKES
    done = 0
    for at in range(0, len(texts), len(PROMPTS)):
        drawn = generator.generate_batch(texts[at : at + len(PROMPTS)], seed=seed + at)
        done += sum(holds(asked, observe(m)) for m, t in zip(drawn, PROMPTS, strict=True) if (asked := asked_of(t)))
    return done / len(texts)
