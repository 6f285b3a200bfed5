"""The diffusion generator: text, actions, nothing, timelines and edits, drawn by one network from its weights file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from motiongen.compose.motions import composed_of
from motiongen.diffusion import said
from motiongen.diffusion.draw import GUIDANCE, LAM_PARTS, Constraint, Drawing, draw, require_known, require_whole, whole
from motiongen.diffusion.editing import edit_of, edited
from motiongen.diffusion.finish import finished
from motiongen.diffusion.known import familiarity
from motiongen.diffusion.lengths import usual_seconds
from motiongen.diffusion.mended import counted, lasting, mended
from motiongen.diffusion.promised import turning
from motiongen.diffusion.said import Said
from motiongen.diffusion.timeline import Entry, passes_of
from motiongen.diffusion.weights import FOLDER, load_weights
from motiongen.features import FPS, features_to_motion, mirror
from motiongen.generator import MIN_SECONDS, Familiarity, PromptError, check_prompt, check_seconds
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source
from motiongen.nn import Floats
from motiongen.skeletons import BANDAI_NAMCO
from motiongen.text.encoder import TextEncoder
from motiongen.text.plan import Piece, plan_of

UNSAID_S = 4.0  # length of what nobody described


class DiffusionGenerator:
    """The network in the weights file at `path`, named after it. Raises WeightsError, ModuleNotFoundError."""

    def __init__(
        self,
        path: Path = FOLDER / "mdm.safetensors",
        *,
        sampler: str = "dpm-solver-2m",
        steps: int = 10,
        alone: bool = False,
        lam_parts: float = LAM_PARTS,
        own_bodies: bool = True,
    ) -> None:
        """`alone`: the network alone is to follow the text, with nothing taken apart, turned or mended for it;
        `lam_parts`: λ₁ of MotionDiffuse's Eq. 10; `own_bodies`: see `bodies.py`, without them Eq. 10 is as printed."""
        self.name = path.stem
        self._model = load_weights(path)
        require_known(self._model, str(path))
        require_whole(self._model, str(path))
        self._encoder = TextEncoder()
        self._sampler, self._alone = sampler, alone
        self._lam_parts, self._own_bodies = lam_parts, own_bodies
        self.licence, self.digest, self.passes = self._model.licence, self._model.digest, steps

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

        Where a text says by how many degrees to turn, that is how far it turns (`turning`); a side, a count or a pace
        that came out wrong is put right (`mended`). Where it says several things, at once or one after the other, it is
        drawn as the timeline that it amounts to (`plan_of`).
        """
        texts = [check_prompt(t, seconds) for t in texts]
        seeds = list(range(seed, seed + len(texts))) if isinstance(seed, int) else list(seed)
        plans = [() if self._alone else plan_of(text) for text in texts]
        plain = [i for i, plan in enumerate(plans) if not plan]
        drawn = self._texts([texts[i] for i in plain], seconds, [seeds[i] for i in plain], guidance)
        found = dict(zip(plain, drawn, strict=True))
        for i in set(range(len(texts))) - set(plain):
            found[i] = self._planned(texts[i], plans[i], seconds, seeds[i], guidance)
        return [found[i] for i in range(len(texts))]

    def _usual(self, texts: Sequence[str], seconds: float | None) -> list[float]:
        """Seconds for each text: as many as are asked for, or as such motions last."""
        if seconds is not None or not texts:
            return [seconds or 0.0] * len(texts)
        usual = usual_seconds(self._model.lengths, self._encoder(list(texts))[2])
        return [float(each) for each in np.clip(usual, MIN_SECONDS, self._model.window / FPS).round(1)]

    def _texts(
        self, texts: Sequence[str], seconds: float | None, seeds: Sequence[int], guidance: float | None
    ) -> list[Motion]:
        """Motions of texts that each say one thing."""
        if not texts:
            return []
        counts = [round(each * FPS) for each in self._usual(texts, seconds)]
        told = said.texts(self._encoder, texts)
        if self._alone:
            return self._whole(told, texts, counts, seeds, guidance)
        drawn = self._drawn(told, counts, seeds, guidance, turning(self._model, texts, counts))
        return [
            mended(x, text, partial(self._motion, text=text, seed=seed), self._mirrored, as_long=seconds is not None)
            for x, text, seed in zip(drawn, texts, seeds, strict=True)
        ]

    def _planned(
        self,
        text: str,
        plan: tuple[tuple[Piece, ...], ...],
        seconds: float | None,
        seed: int,
        guidance: float | None,
    ) -> Motion:
        """A motion of a text that says several things, by the timeline that it amounts to."""
        lasts = [max(self._usual([piece.text for piece in step], None)) for step in plan]
        ends = np.cumsum(lasts) * (1.0 if seconds is None else seconds / sum(lasts))
        starts = [0.0, *ends[:-1]]
        entries = [
            Entry(piece.text, float(start), float(end), piece.parts)
            for step, start, end in zip(plan, starts, ends, strict=True)
            for piece in step
        ]
        x = self._timeline(entries, seed, guidance)
        motion = partial(self._motion, text=text, seed=seed)
        bounds = np.round(np.array([*starts, ends[-1]]) * FPS).astype(int)
        x = np.concatenate(
            [
                counted(x[a:b], step[0].text, motion) if len(step) == 1 else x[a:b]
                for step, (a, b) in zip(plan, pairwise(bounds), strict=True)
            ]
        )
        return motion(x) if seconds is None else lasting(motion(x), (bounds[-1] - 1) / FPS)

    def generate_action(
        self, action: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """Motion of an action of the training data, as "wave-left", told by its number instead of words.

        A name that several begin with, as "wave", stands for one of them, by the seed. Raises PromptError for a length
        out of range, and for an unknown action, with the nearest.
        """
        count = _count(seconds)
        name = self._action(action, seed)
        told = said.action(self._model.actions.index(name))
        return self._whole(told, [name.replace("-", " ")], [count], [seed], guidance)[0]

    def generate_unconditioned(self, *, seconds: float | None = None, seed: int = 0) -> Motion:
        """Any motion at all. Raises PromptError for a length out of range."""
        return self._whole(self._nothing(), [""], [_count(seconds)], [seed], None)[0]

    def generate_timeline(self, entries: Sequence[Entry], *, seed: int = 0, guidance: float | None = None) -> Motion:
        """One motion in which each entry happens in its time, with its parts of the body; see `timeline`.

        Raises TimelineError where the entries leave a gap or are none, ValueError for unknown parts.
        """
        labels = tuple(Label(e.start_s, e.end_s, e.text, e.parts) for e in entries)
        return replace(self._motion(self._timeline(entries, seed, guidance), "", seed), labels=labels)

    def _timeline(self, entries: Sequence[Entry], seed: int, guidance: float | None) -> Floats:
        """Features (T, 140) of `generate_timeline`."""
        passes, count = passes_of(self._model, entries, self._encoder)
        return draw(self._model, passes, [count], [seed], self._how(guidance))[0, :count]

    def edit(
        self,
        clip: Motion,
        text: str | None = None,
        *,
        keep: str = "",
        parts: Sequence[str] = (),
        seed: int = 0,
        guidance: float | None = None,
    ) -> Motion:
        """`clip` with the frames outside `keep` ("0:1s,3s:"), or the named `parts` of the body, or those parts in those
        frames, drawn anew as `text` says, or as fits.

        What is kept comes out as it went in, in the world too. Raises RangeError, PromptError, ValueError for unknown
        parts or a skeleton without SMPL's 22 joints.
        """
        edit = edit_of(clip, keep, parts)
        told = self._nothing() if text is None else said.texts(self._encoder, [check_prompt(text)])
        out = edited(self._model, edit, told, seed, self._how(guidance))
        free = np.flatnonzero(edit.free) / clip.fps
        label = Label(float(free[0]), float(free[-1]), text or "", tuple(parts))
        source = replace(
            composed_of((clip, replace(clip, source=self._source(seed))), "+"), weights=self.digest, seed=seed
        )
        return replace(out, labels=(*clip.labels, label), source=source)

    def _whole(
        self, told: Said, texts: Sequence[str], counts: Sequence[int], seeds: Sequence[int], guidance: float | None
    ) -> list[Motion]:
        """One motion a condition, each `counts[i]` frames long."""
        drawn = self._drawn(told, counts, seeds, guidance)
        return [self._motion(*each) for each in zip(drawn, texts, seeds, strict=True)]

    def _drawn(
        self,
        told: Said,
        counts: Sequence[int],
        seeds: Sequence[int],
        guidance: float | None,
        constrain: Constraint | None = None,
    ) -> list[Floats]:
        """Normalised features (counts[i], 140) of one motion a condition."""
        x = draw(self._model, whole(self._model, told, max(counts)), counts, seeds, self._how(guidance), constrain)
        return [each[:count] for each, count in zip(x, counts, strict=True)]

    def _nothing(self) -> Said:
        """Nothing said; raises PromptError where the model was never trained without a text."""
        if not self._model.unconditioned:
            raise PromptError(f"the weights {self.digest} were trained with texts only; say what to do")
        return said.nothing()

    def _how(self, guidance: float | None) -> Drawing:
        scale = GUIDANCE if guidance is None else guidance
        if not math.isfinite(scale):
            raise ValueError(f"guidance must be a number, not {guidance}")
        return Drawing(self._sampler, self.passes, scale, self._lam_parts, self._own_bodies)

    def _action(self, name: str, seed: int) -> str:
        actions = self._model.actions
        if not actions:
            raise PromptError(f"the weights {self.digest} know no actions; say it in words")
        name = "-".join(name.lower().split())
        if name in actions:
            return name
        kinds = [action for action in actions if action.startswith(f"{name}-")]
        if kinds:
            return str(np.random.default_rng(seed).choice(kinds))
        like = self._encoder([name.replace("-", " "), *(a.replace("-", " ") for a in actions)])[2]
        best = np.argsort(-(like[1:] @ like[0]))[:5]
        raise PromptError(f"no action {name!r}; the nearest are {', '.join(actions[i] for i in best)}")

    def _source(self, seed: int) -> Source:
        return Source(self.name, self.digest, seed, self.licence)

    def _mirrored(self, x: Floats) -> Floats:
        model = self._model
        return (mirror(x * model.std + model.mean) - model.mean) / model.std

    def _motion(self, x: Floats, text: str, seed: int) -> Motion:
        model = self._model
        skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, model.offsets.astype(float), BANDAI_NAMCO.foot_height)
        features = finished((x * model.std + model.mean).astype(float), skeleton)
        label = Label(0.0, (len(x) - 1) / FPS, text)
        return features_to_motion(features, skeleton, labels=(label,), source=self._source(seed))


def _count(seconds: float | None) -> int:
    """Frames of a motion whose text does not say how long it is."""
    if seconds is not None:
        check_seconds(seconds)
    return round((UNSAID_S if seconds is None else seconds) * FPS)
