"""The generator in the tree: text encoder, diffusion and features put together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion.constraints import keep_known
from motiongen.diffusion.lengths import usual_seconds
from motiongen.diffusion.mdm_run import denoise
from motiongen.diffusion.samplers import SAMPLERS, Denoiser, guided, seeded
from motiongen.diffusion.schedule import COSINE, even_times
from motiongen.diffusion.weights import FOLDER, load_weights, nearest
from motiongen.features import CONTACTS, FPS, HEIGHT, PLANAR, features_to_motion
from motiongen.generator import MIN_SECONDS, Familiarity, check_prompt
from motiongen.motion import FOOT_JOINTS, SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source
from motiongen.nn import Floats
from motiongen.rotation import quat_conj, quat_rotate, yaw_of_quat, yaw_quat
from motiongen.skeletons import BANDAI_NAMCO
from motiongen.text.encoder import TextEncoder

OVERLAP = 36  # frames of the last window that the next one is made to go on from
GUIDANCE = 2.5


class MdmGenerator:
    """MDM with the weights in the tree, or those at `path`. Raises WeightsError, ModuleNotFoundError."""

    name = "mdm"

    def __init__(self, path: Path | None = None, *, sampler: str = "dpm-solver-2m", steps: int = 10) -> None:
        self._weights = load_weights(path or FOLDER / "mdm.safetensors")
        self._encoder = TextEncoder()
        self._sample, self._times = SAMPLERS[sampler], even_times(steps)
        self.licence, self.digest, self.passes = self._weights.licence, self._weights.digest, steps

    def familiarity(self, text: str) -> Familiarity:
        """How close `text` is to the training captions; raises PromptError for a text that nobody could follow."""
        bank = self._weights.bank
        best = nearest(bank, self._encoder([check_prompt(text)])[2][0])
        names = tuple(bank.contents[i].replace("-", " ") for _, i in best[:3])
        return Familiarity(best[0][0] >= bank.known, best[0][0], names)

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """Motion for `text`; see `Generator`. Raises PromptError, ValueError for a guidance that is not finite."""
        return self.generate_batch([text], seconds=seconds, seed=seed, guidance=guidance)[0]

    def generate_batch(
        self,
        texts: list[str],
        *,
        seconds: float | None = None,
        seed: int | Sequence[int] = 0,
        guidance: float | None = None,
    ) -> list[Motion]:
        """One motion a text, drawn together; text i from seed + i, or from `seed[i]` where there is one for each."""
        scale = GUIDANCE if guidance is None else guidance
        if not math.isfinite(scale):
            raise ValueError(f"guidance must be a number, not {guidance}")
        texts = [check_prompt(t, seconds) for t in texts]
        said = self._encoder(texts)
        usual = np.clip(usual_seconds(self._weights.lengths, said[2]), MIN_SECONDS, self._weights.window / FPS)
        counts = [round((seconds or each) * FPS) for each in usual.round(1)]
        seeds = list(range(seed, seed + len(texts))) if isinstance(seed, int) else list(seed)
        x = self._draw(said, np.array(counts), seeds, scale)
        return [self._motion(x[i, :n], texts[i], seeds[i]) for i, n in enumerate(counts)]

    def _draw(
        self, said: tuple[Floats, NDArray[np.bool_], Floats], counts: NDArray[np.int_], seeds: list[int], scale: float
    ) -> Floats:
        """Normalised features (B, T, 140): the first window, then windows that go on from the one before."""
        patch, width = self._weights.patch, len(self._weights.mean)
        total = patch * math.ceil(counts.max() / patch)
        length = min(total, self._weights.window)
        draw = seeded(seeds, self._weights.window, length, width)
        done = np.zeros((len(seeds), 0, width), np.float32)
        while done.shape[1] < total:
            known = done[:, -OVERLAP:]
            start = done.shape[1] - known.shape[1]
            frames = np.arange(length) < np.maximum(counts[:, None] - start, patch)
            x = self._sample(self._denoiser(said, frames, known, scale), draw, COSINE, self._times)
            done = np.concatenate([done[:, :start], x], axis=1)
        return done[:, :total]

    def _denoiser(
        self, said: tuple[Floats, NDArray[np.bool_], Floats], frames: NDArray[np.bool_], known: Floats, scale: float
    ) -> Denoiser:
        """Guided estimate of x_0 with the known first frames written over it at every pass (MDM, Sec. 3)."""
        w = self._weights
        words, word_mask, sentence = (np.concatenate([y, y]) for y in said)
        both = np.concatenate([frames, frames])
        keep = np.arange(2 * len(frames)) < len(frames)

        def predict(x: Floats, t: float) -> Floats:
            return denoise(w.tensors, w.patch, w.heads, x, t, both, words, word_mask, sentence, keep)

        first = np.zeros((*frames.shape, len(w.mean)), np.float32)
        first[:, : known.shape[1]] = known
        return keep_known(guided(predict, scale), first, np.arange(frames.shape[1])[:, None] < known.shape[1])

    def _motion(self, x: Floats, text: str, seed: int) -> Motion:
        w = self._weights
        features = _smooth((x * w.std + w.mean).astype(float))
        skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, w.offsets.astype(float), BANDAI_NAMCO.foot_height)
        source = Source(self.name, w.digest, seed, w.licence)
        label = Label(0.0, (len(features) - 1) / FPS, text)
        drawn = features_to_motion(features, skeleton)
        features[:, HEIGHT] -= _floats(drawn)
        features[:, PLANAR] -= _slip(drawn, features[:, CONTACTS])
        return features_to_motion(features, skeleton, labels=(label,), source=source)


def _smooth(features: NDArray[np.float64]) -> NDArray[np.float64]:
    """Binomial smoothing over five frames, which takes away what jitters faster than people can (over ~8 Hz)."""
    padded = np.concatenate([features[:1]] * 2 + [features] + [features[-1:]] * 2)
    return np.sum([k / 16 * padded[i : i + len(features)] for i, k in enumerate((1, 4, 6, 4, 1))], axis=0)


def _slip(motion: Motion, touch: NDArray[np.float64]) -> NDArray[np.float64]:
    """Planar velocity (T, 2) in m/s, in each frame's heading, with which feet slide that should stand.

    The mean over `FOOT_JOINTS`, each weighed by how surely it touches the floor (`touch` (T, 4), 0…1). Taken off the
    root's velocity, it is the planted foot that stays and the body that moves over it.
    """
    feet = motion.positions()[:, [motion.skeleton.index(n) for n in FOOT_JOINTS]]
    moved = np.zeros((len(feet), len(FOOT_JOINTS), 3))
    moved[:-1] = np.diff(feet, axis=0) * motion.fps
    sure = np.clip(touch, 0.0, 1.0)
    sure[:-1] = np.minimum(sure[:-1], sure[1:])
    mean = (moved * sure[..., None]).sum(1) / np.maximum(sure.sum(1), 1e-6)[:, None]
    slip = quat_rotate(quat_conj(yaw_quat(yaw_of_quat(motion.joint_quat[:, 0]))), mean)[:, :2]
    return _smooth(slip * sure.max(1)[:, None])


def _floats(motion: Motion) -> float:
    """Metres by which the lower foot lies too high in most frames (the 20 % quantile: a runner flies in between)."""
    ankle, toe = motion.skeleton.foot_height
    names = motion.skeleton.names
    at = motion.positions()[:, [names.index(n) for n in ("left_ankle", "right_ankle", "left_foot", "right_foot")], 2]
    return float(np.quantile((at - np.array([ankle, ankle, toe, toe])).min(axis=1), 0.2))
