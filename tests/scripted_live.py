"""A live generator that plays gestures by heart, for tests of what is built around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from motiongen.generator import Familiarity, check_prompt, load_generator
from motiongen.live.steering import Area, Steer
from motiongen.motion import Label, Motion

CHUNK = 30
KNOWN = ("stand idle", "raise the right hand")


class Scripted:
    """The part of `LiveGenerator` that a line uses: `texts` tells what is shown from which frame on."""

    def __init__(self) -> None:
        gestures = load_generator("gestures")
        self._motions = {t: gestures.generate(t, seconds=8.0) for t in KNOWN}
        self.skeleton = self._motions["stand idle"].skeleton
        self.frame, self.texts = 0, {0: "stand idle"}
        self.steers: list[Steer] = []
        self.area: Area | None = None

    def next_chunk(self) -> Motion:
        since = max(f for f in self.texts if f <= self.frame)
        text, whole = self.texts[since], self._motions[self.texts[since]]
        rows = np.minimum(np.arange(CHUNK) + self.frame - since, len(whole) - 1)
        self.frame += CHUNK
        label = Label(0.0, (CHUNK - 1) / whole.fps, text)
        root, quat = whole.root_pos[rows], whole.joint_quat[rows]
        return replace(whole, root_pos=root, joint_quat=quat, contacts=None, labels=(label,))

    def familiarity(self, text: str) -> Familiarity:
        return Familiarity(check_prompt(text) in self._motions, 0.0, ("wave",))

    def say(self, text: str, at_frame: int, *, seconds: float | None = None) -> Familiarity:
        found = self.familiarity(text)
        if found.known:
            self.texts = {f: t for f, t in self.texts.items() if f < at_frame} | {at_frame: text}
            self.frame = at_frame
        return found

    def idle(self, at_frame: int) -> None:
        self.say("stand idle", at_frame)

    def steer(self, steer: Steer, at_frame: int) -> None:
        self.steers.append(steer)

    def kept(self) -> tuple[int, dict[int, str]]:
        return self.frame, dict(self.texts)

    def return_to(self, kept: tuple[int, dict[int, str]]) -> None:
        self.frame, self.texts = kept

    def usual_seconds(self, text: str) -> float:
        return 2.0
