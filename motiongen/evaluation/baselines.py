"""What any model has to beat: the training clip with the nearest caption, and nobody moving at all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress

from motiongen.data.dataset import Dataset
from motiongen.data.texts import data_texts
from motiongen.features import CONTACTS, FPS, PLANAR, YAW, features_to_motion
from motiongen.generator import Familiarity, PromptError, check_prompt
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source
from motiongen.text.encoder import TextEncoder

KNOWN = 0.50  # cosine from which a text counts as known, as for the model in the tree
USUAL_S = 4.0


class Retrieval:
    """The clip of the training split, or its mirror image, of which a caption is nearest to the text by MiniLM cosine.

    Where several clips have that caption, the seed draws one. Raises PromptError where the training split is empty.
    """

    name = "retrieval"

    def __init__(self, dataset: Dataset) -> None:
        self._dataset, self._encoder = dataset, TextEncoder()
        self._clips: dict[str, list[tuple[int, bool]]] = {}
        for i, entry in enumerate(dataset.entries):
            if entry.split == "train":
                for mirrored in (False, True):
                    for caption in dataset.captions(i, mirrored):
                        self._clips.setdefault(caption, []).append((i, mirrored))
        if not self._clips:
            raise PromptError(f"{dataset.folder}: no clips in its training split to find one among")
        self._captions = sorted(self._clips)
        with Progress(console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task("reading captions")
            texts = data_texts(
                dataset, self._captions, progress=lambda done, of: bar.update(task, completed=done, total=of)
            )
        self._vectors = texts.sentences(self._captions)
        self.licence = "; ".join(sorted({entry.licence for entry in dataset.entries}))

    def familiarity(self, text: str) -> Familiarity:
        """How near the nearest caption is; raises PromptError for a text that nobody could follow."""
        cosine = self._cosine(check_prompt(text))
        best = np.argsort(-cosine)[:3]
        return Familiarity(
            bool(cosine[best[0]] >= KNOWN), float(cosine[best[0]]), tuple(self._captions[i] for i in best)
        )

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """The clip as it is; neither `seconds` nor `guidance` changes anything. Raises PromptError."""
        cosine = self._cosine(check_prompt(text, seconds))
        found = self._clips[self._captions[int(cosine.argmax())]]
        clip, mirrored = found[int(np.random.default_rng(seed).integers(len(found)))]
        return self._dataset.motion(clip, mirrored)

    def _cosine(self, text: str) -> NDArray[np.float32]:
        return self._vectors @ self._encoder([text])[2][0]


class MeanPose:
    """The mean of all features of a data set, standing still, whatever the text says."""

    name = "mean"

    def __init__(self, dataset: Dataset) -> None:
        self._mean = np.array(dataset.head.mean)
        self._mean[YAW], self._mean[PLANAR], self._mean[CONTACTS] = 0.0, 0.0, 1.0
        entry = dataset.entries[0]
        self._skeleton = Skeleton(SMPL_JOINTS, SMPL_PARENTS, np.array(entry.offsets), entry.foot_height)
        self.licence = "; ".join(sorted({entry.licence for entry in dataset.entries}))

    def familiarity(self, text: str) -> Familiarity:
        """Nothing is ever known; raises PromptError for a text that nobody could follow."""
        check_prompt(text)
        return Familiarity(False, 0.0, ())

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """The pose for `seconds`, or 4; neither `seed` nor `guidance` changes anything. Raises PromptError."""
        text = check_prompt(text, seconds)
        frames = np.tile(self._mean, (round((seconds or USUAL_S) * FPS) + 1, 1))
        label = Label(0.0, (len(frames) - 1) / FPS, text)
        return features_to_motion(
            frames, self._skeleton, labels=(label,), source=Source(self.name, seed=seed, licence=self.licence)
        )
