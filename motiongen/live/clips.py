"""The live generator as one that draws clips: it does what is said from its first frame on, for as long as asked."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from motiongen.diffusion.weights import FOLDER
from motiongen.features import FPS
from motiongen.generator import MAX_SECONDS, Familiarity, check_prompt
from motiongen.live.chunk import Drawing
from motiongen.live.generator import LiveGenerator
from motiongen.motion import Label, Motion
from motiongen.rotation import quat_continuous


class LiveClips:
    """A `Generator` over a `LiveGenerator`; raises as that does."""

    def __init__(self, path: Path = FOLDER / "live.safetensors") -> None:
        self._live = LiveGenerator(path)
        self._how = self._live.how
        self.name, self.licence, self.digest = self._live.name, self._live.licence, self._live.digest

    def familiarity(self, text: str) -> Familiarity:
        """How close `text` is to the training captions; raises PromptError for a text that nobody could follow."""
        return self._live.familiarity(text)

    def generate(
        self, text: str, *, seconds: float | None = None, seed: int = 0, guidance: float | None = None
    ) -> Motion:
        """Motion for `text`; see `Generator`. Raises PromptError."""
        text, live = check_prompt(text, seconds), self._live
        live.how = self._how if guidance is None else Drawing(self._how.passes, guidance)
        live.restart(seed)
        count = round((live.usual_seconds(text) if seconds is None else seconds) * FPS)
        live.say(text, 0, seconds=MAX_SECONDS, anyway=True)
        parts: list[Motion] = []
        while live.frame < count:
            parts.append(live.next_chunk())
        root = np.concatenate([part.root_pos for part in parts])[:count]
        quat = quat_continuous(np.concatenate([part.joint_quat for part in parts])[:count])
        touch = [part.contacts for part in parts if part.contacts is not None]
        label = Label(0.0, (count - 1) / FPS, text)
        return replace(
            parts[0], root_pos=root, joint_quat=quat, labels=(label,), contacts=np.concatenate(touch)[:count]
        )
