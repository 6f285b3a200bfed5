"""The generator of phases: motion of any length, one text after another, at any frame rate (DiffusionPhase)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from motiongen.diffusion import said
from motiongen.diffusion.draw import Drawing
from motiongen.diffusion.known import familiarity
from motiongen.diffusion.lengths import usual_seconds
from motiongen.diffusion.weights import FOLDER, load_weights
from motiongen.features import FPS
from motiongen.generator import MIN_SECONDS, Familiarity, PromptError, check_prompt
from motiongen.motion import Motion, Source
from motiongen.nn import Floats
from motiongen.phase.draw import anywhere, codec_of, draw_phrases
from motiongen.phase.phase_run import Start
from motiongen.phase.phrases import Phrase, lasting, whole_turns
from motiongen.text.encoder import TextEncoder

GUIDANCE = 2.5  # of the paper's 2.5 to 3.5
OVER = 1.5  # times the usual length of what a text says, beyond which its primary segment is repeated


class PhaseGenerator:
    """The network in the weights file at `path`, named after it. Raises WeightsError, ModuleNotFoundError."""

    def __init__(
        self, path: Path = FOLDER / "diffusionphase.safetensors", *, sampler: str = "dpm-solver-2m", steps: int = 10
    ) -> None:
        self.name = path.stem
        self._model = load_weights(path)
        self.codec = codec_of(self._model)
        self._encoder = TextEncoder()
        self._sampler, self.passes = sampler, steps
        self.licence, self.digest = self._model.licence, self._model.digest

    def familiarity(self, text: str) -> Familiarity:
        """How close `text` is to the training captions; raises PromptError for a text that nobody could follow."""
        return familiarity(self._model.bank, self._encoder, text)

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
        """One motion a text, drawn together; text i from seed + i, or from `seed[i]` where there is one for each.

        Where `seconds` are many more than such a motion usually has, its primary segment is repeated.
        """
        texts = [check_prompt(text, seconds) for text in texts]
        seeds = list(range(seed, seed + len(texts))) if isinstance(seed, int) else list(seed)
        phrases = self.phrases(texts, seconds=seconds, seeds=seeds, guidance=guidance)
        return [self.motion([p], [t], seed=s) for p, t, s in zip(phrases, texts, seeds, strict=True)]

    def phrases(
        self,
        texts: Sequence[str],
        *,
        seconds: float | None,
        seeds: Sequence[int],
        guidance: float | None = None,
        poses: Floats | None = None,
    ) -> list[Phrase]:
        """A phrase a text, drawn together, repeated where `seconds` are many; None: as long as such motions are.

        `poses` (B, 140), normalised: in which their primary segments are to begin, as the codec's `pose` gives them.
        """
        if not texts:
            return []
        usual = usual_seconds(self._model.lengths, self._encoder(list(texts))[2])
        usual = np.clip(usual, MIN_SECONDS, self._model.window / FPS)
        wanted = usual if seconds is None else np.full(len(texts), seconds)
        drawn = np.where(wanted > OVER * usual, usual, wanted)
        counts = np.rint(np.minimum(drawn * FPS, self._model.window)).astype(int)
        start = anywhere(counts.tolist(), len(self._model.mean))
        if poses is not None:
            start = Start(poses, np.ones(len(texts), bool), counts)
        told = said.texts(self._encoder, texts)
        found = draw_phrases(self._model, self.codec.layout, told, start, seeds, self._how(guidance))
        totals = np.rint(wanted * FPS).astype(int)
        return [p if n == p.frames else lasting(p, int(n)) for p, n in zip(found, totals, strict=True)]

    def generate_sequence(
        self, texts: Sequence[str], *, seconds: float, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """Texts one after the other, each for about `seconds`: every primary segment begins in the pose in which the
        one before ended. Raises PromptError, also where there are no texts."""
        if not texts:
            raise PromptError("no texts; say what the rig should do, one thing after another")
        texts = [check_prompt(text, seconds) for text in texts]
        phrases: list[Phrase] = []
        for i, text in enumerate(texts):
            poses = self.codec.pose(phrases[-1])[None] if phrases else None
            found = self.phrases([text], seconds=seconds, seeds=[seed + i], guidance=guidance, poses=poses)[0]
            phrases.append(whole_turns(found))
        return self.motion(phrases, texts, seed=seed)

    def motion(self, phrases: Sequence[Phrase], texts: Sequence[str], *, seed: int, dense: int = 1) -> Motion:
        """Phrases one after the other, a text each, as a motion at `dense` times 30 frames a second."""
        return self.codec.motion(phrases, texts, source=Source(self.name, self.digest, seed, self.licence), dense=dense)

    def _how(self, guidance: float | None) -> Drawing:
        scale = GUIDANCE if guidance is None else guidance
        if not math.isfinite(scale):
            raise ValueError(f"guidance must be a number, not {guidance}")
        return Drawing(self._sampler, self.passes, scale)
