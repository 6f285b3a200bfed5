"""Endless motion that follows what is said: prompts and steering in, at any frame; chunks of motion out, one by one."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from motiongen.compose.combinations import EVEN_GAITS
from motiongen.diffusion import said
from motiongen.diffusion.draw import require_known
from motiongen.diffusion.lengths import usual_seconds
from motiongen.diffusion.said import Said
from motiongen.diffusion.weights import FOLDER, WeightsError, load_weights, nearest
from motiongen.features import FPS
from motiongen.generator import MAX_SECONDS, MIN_SECONDS, Familiarity, PromptError, check_prompt, check_seconds
from motiongen.live.chunk import Chunk, Drawing, State, after, begin, next_chunk, shown
from motiongen.live.reaching import Hands
from motiongen.live.steering import Area, Steer, signals
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Motion, Skeleton, Source
from motiongen.nn import in_panels
from motiongen.skeletons import BANDAI_NAMCO
from motiongen.text.encoder import TextEncoder

IDLE = "stand idle"  # what is done when nothing is asked for
MIXED = ("cmu", "composed")  # contents of the bank that are many things
PAST_S = 4.0  # that can be gone back
TEXTS = 64  # encoded texts that are kept
BORDER_S = 1.5  # s from the border of the floor, at the speed there is, at which the way turns back


@dataclass(frozen=True)
class Prompt:
    """`text` holds from frame `start` until frame `stop`, None: until the next one."""

    text: str
    start: int
    stop: int | None


@dataclass(frozen=True)
class _Turn:
    """`steer` holds from frame `start` on."""

    steer: Steer
    start: int


@dataclass(frozen=True)
class Kept:
    """All that a live generator had drawn and was told, to return to."""

    states: tuple[State, ...]
    chunks: tuple[Chunk, ...]
    prompts: tuple[Prompt, ...]
    turns: tuple[_Turn, ...]


class LiveGenerator:
    """Motion without end, drawn by the network in the weights file at `path`; the same for the same seed, prompts and
    frames at which they came. Raises WeightsError, ModuleNotFoundError."""

    def __init__(
        self,
        path: Path = FOLDER / "live.safetensors",
        *,
        seed: int = 0,
        how: Drawing = Drawing(),  # noqa: B008
        area: Area | None = None,
    ) -> None:
        """`area`: the floor that is not to be left."""
        self.name, self.how, self.area = path.stem, how, area
        weights = load_weights(path)
        require_known(weights, str(path))
        if not weights.sizes.get("history"):
            raise WeightsError(f"{path}: draws whole clips; a live generator needs weights with a history")
        rows = 2 * (1 + weights.window // int(weights.sizes["patch"]))  # tokens, with text and without
        self.weights = replace(weights, tensors=in_panels(weights.tensors, rows))
        self._encoder = TextEncoder()
        self._encoded: OrderedDict[str, Said] = OrderedDict()
        self.skeleton = Skeleton(
            SMPL_JOINTS, SMPL_PARENTS, self.weights.offsets.astype(float), BANDAI_NAMCO.foot_height
        )
        self.licence, self.digest = self.weights.licence, self.weights.digest
        self.restart(seed)

    def restart(self, seed: int) -> None:
        """Begin anew, at the origin and facing +x, with nothing said."""
        self.seed = seed
        self._states = [begin()]  # of the last chunks' starts, and of now
        self._chunks: list[Chunk] = []
        self._prompts = [Prompt(IDLE, 0, None)]
        self._turns = [_Turn(Steer(), 0)]

    @property
    def frame(self) -> int:
        """Number of the next frame, 30 a second."""
        return self._states[-1].frame

    @property
    def state(self) -> State:
        """Where the motion is before that frame."""
        return self._states[-1]

    def familiarity(self, text: str) -> Familiarity:
        """How close `text` is to the training captions; raises PromptError for a text that nobody could follow."""
        bank = self.weights.bank
        best = nearest(bank, self._said(check_prompt(text)).sentence[0])
        names = tuple(bank.contents[i].replace("-", " ") for _, i in best[:3])
        return Familiarity(best[0][0] >= bank.known, best[0][0], names)

    def usual_seconds(self, text: str) -> float:
        """How long motions that are called so last, within what can be asked for."""
        usual = float(usual_seconds(self.weights.lengths, self._said(text).sentence)[0])
        return min(max(usual, MIN_SECONDS), MAX_SECONDS)

    def say(
        self, text: str, at_frame: int | None = None, *, seconds: float | None = None, anyway: bool = False
    ) -> Familiarity:
        """Do `text` from a frame on, by default the next, for `seconds`, by default as long as such motions last, then
        stand idle; an even gait goes on until something else is said.

        A text far from all that was trained on changes nothing, but with `anyway`; the answer names the nearest. Frames
        from `at_frame` on that were drawn already are drawn anew. Raises PromptError for a text or a length that nobody
        could follow, or a frame too long ago.
        """
        text = check_prompt(text)
        if seconds is not None:
            check_seconds(seconds)
        found = self.familiarity(text)
        if found.known or anyway:
            start = self._go_back(at_frame)
            stop = start + round(seconds * FPS) if seconds is not None else self._usual_stop(text, start, found)
            self._prompts = [*(p for p in self._prompts if p.start < start), Prompt(text, start, stop)]
        return found

    def idle(self, at_frame: int | None = None) -> None:
        """Stop what is done and stand idle, from a frame on; raises PromptError as `say` does."""
        start = self._go_back(at_frame)
        self._prompts = [*(p for p in self._prompts if p.start < start), Prompt(IDLE, start, None)]

    def steer(self, steer: Steer, at_frame: int | None = None) -> None:
        """Go, turn and reach as `steer` says, from a frame on; `Steer()` ends it. Raises PromptError as `say` does, and
        where the path leaves the floor."""
        steer.require_within(self.area)
        start = self._go_back(at_frame)
        self._turns = [*(t for t in self._turns if t.start < start), _Turn(steer, start)]

    def kept(self) -> Kept:
        """What `return_to` needs."""
        return Kept(tuple(self._states), tuple(self._chunks), tuple(self._prompts), tuple(self._turns))

    def return_to(self, kept: Kept) -> None:
        """Be as it was then: what was said and drawn since has not been."""
        self._states, self._chunks = list(kept.states), list(kept.chunks)
        self._prompts, self._turns = list(kept.prompts), list(kept.turns)

    def next_chunk(self) -> Motion:
        """The next stretch, in the world, up to where something else is said; 30 frames a second."""
        state = self._states[-1]
        text, until = self._text_at(state.frame)
        turn = next(t for t in reversed(self._turns) if t.start <= state.frame)
        until = min([until, *(t.start for t in self._turns if t.start > state.frame)], default=until)
        steer = self._kept_inside(turn.steer)
        since = state.frame - turn.start
        told = signals(self.weights, steer, state.heading, state.place, state.cruise, since)
        hands = Hands(steer.left_hand, steer.right_hand, since)
        chunk = next_chunk(self.weights, self.skeleton, state, self._said(text), told, self.how, self.seed, hands)
        count = min(len(chunk), until - state.frame)
        self._chunks.append(chunk)
        self._states.append(after(chunk, count))
        self._forget(self.frame - round(PAST_S * FPS))
        return shown(chunk, count, self.skeleton, Source(self.name, self.digest, self.seed, self.licence), text)

    def _text_at(self, frame: int) -> tuple[str, int]:
        """What is to be done in a frame, and the frame until which that holds."""
        latest = max(i for i, p in enumerate(self._prompts) if p.start <= frame)
        prompt = self._prompts[latest]
        following = self._prompts[latest + 1].start if latest + 1 < len(self._prompts) else _NEVER
        if prompt.stop is None or frame < prompt.stop:
            return prompt.text, min(following, _NEVER if prompt.stop is None else prompt.stop)
        return IDLE, following

    def _usual_stop(self, text: str, start: int, found: Familiarity) -> int | None:
        kinds = [name.replace(" ", "-") for name in found.nearest if name not in MIXED]
        if kinds and kinds[0] in EVEN_GAITS:
            return None
        return start + round(self.usual_seconds(text) * FPS)

    def _go_back(self, at_frame: int | None) -> int:
        """Forget what was drawn from a frame on, and what was said for later; that frame."""
        at = self.frame if at_frame is None else at_frame
        if at < self._states[0].frame:
            raise PromptError(f"frame {at} is gone; the earliest that can still change is {self._states[0].frame}")
        while at < self._states[-1].frame:
            self._states.pop()
            chunk = self._chunks.pop()
            if at > chunk.start.frame:
                self._chunks.append(chunk)
                self._states.append(after(chunk, at - chunk.start.frame))
        return at

    def _forget(self, frame: int) -> None:
        """What was before a frame, but for what holds in it."""
        while self._states[1].frame <= frame:
            self._states.pop(0)
            self._chunks.pop(0)
        first = self._states[0].frame
        while len(self._prompts) > 1 and self._prompts[1].start <= first:
            self._prompts.pop(0)
        while len(self._turns) > 1 and self._turns[1].start <= first:
            self._turns.pop(0)

    def _kept_inside(self, steer: Steer) -> Steer:
        """`steer`, or where its way or its text leads off the floor, a turn back to the middle."""
        state, area = self._states[-1], self.area
        if area is None:
            return steer
        direction = np.array([np.cos(state.heading), np.sin(state.heading)])
        soon = state.place + direction * max(0.0, state.cruise) * BORDER_S
        if area.holds(soon) or steer.path:
            return steer
        back = (np.array(area.low) + np.array(area.high)) / 2 - state.place
        return replace(steer, heading=float(np.arctan2(back[1], back[0])))

    def _said(self, text: str) -> Said:
        if text not in self._encoded:
            self._encoded[text] = said.texts(self._encoder, [text])
            if len(self._encoded) > TEXTS:
                self._encoded.popitem(last=False)
        self._encoded.move_to_end(text)
        return self._encoded[text]


_NEVER = 1 << 62
