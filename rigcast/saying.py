"""Where a text becomes a take: one place for `say`, and for the line to type on its page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from motiongen.candidates import choose
from motiongen.generator import Generator, PromptError, check_prompt
from motiongen.motion import Motion
from retarget.rig import Mount, Rig
from retarget.shown import cannot_show
from rigcast.pipeline import Take, take
from rigcast.times import Times

Tell = Callable[[str], None]  # takes one line that whoever asked should read


class UnfamiliarError(PromptError):
    """A text that is far from everything that the generator was trained on."""


@dataclass(frozen=True)
class Saying:
    """How texts become takes: drawn by which generator, which goes by `name`, and how; on which rig and mount.

    With `strict` a text that is far from what the generator was trained on is refused, otherwise told of.
    """

    generator: Generator
    name: str
    rig: Rig
    mount: Mount | None
    seconds: float | None
    guidance: float | None
    candidates: int
    strict: bool
    fix: bool

    def say(self, text: str, seed: int, times: Times, tell: Tell) -> tuple[Take, dict[str, Any]]:
        """What comes of `text`, and what there is to say of how it was drawn, for JSON.

        Raises UnfamiliarError where strict, and what the generator, retargeting and physics raise: ValueError.
        """
        text = check_prompt(text)
        said = self.familiar([text], tell)
        with times.stage("generate"):
            kept = choose(
                self.generator,
                text,
                candidates=self.candidates,
                seconds=self.seconds,
                seed=seed,
                guidance=self.guidance,
            )
        if kept.drawn > 1:
            tell(str(kept))
        drawn = {"candidates": kept.drawn, "kept": kept.index + 1, "measured": kept.asked, "right": kept.right}
        return self.judged(kept.motion, times, tell), {"text": text, **said, **drawn}

    def familiar(self, texts: Sequence[str], tell: Tell) -> dict[str, Any]:
        """Whether the generator knows the like of all `texts`, and what comes nearest to the last one, for JSON.

        Raises UnfamiliarError.
        """
        found = [(text, self.generator.familiarity(text)) for text in texts]
        far = [
            f"{text!r} is far from what {self.name} was trained on; nearest: {', '.join(like.nearest)}"
            for text, like in found
            if not like.known
        ]
        if far and self.strict:
            raise UnfamiliarError("; ".join(far))
        for line in far:
            tell(line)
        return {"known": not far, "nearest": list(found[-1][1].nearest)} if found else {}

    def judged(self, motion: Motion, times: Times, tell: Tell) -> Take:
        """`motion` on the rig, through physics."""
        for note in cannot_show(motion, self.rig):
            tell(note)
        return take(motion, self.rig, self.mount, times, fix=self.fix)
