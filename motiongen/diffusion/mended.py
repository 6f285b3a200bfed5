"""What a text asks for and a drawn motion does not do, as far as that can be measured and put right after drawing.

The wrong side is mirrored, a wrong count is made right by repeating cycles or leaving some out, and what should be slow
or quick is played so. Of a text that asks for several things, one after the other, only the counts are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from motiongen.diffusion.repeats import repeated
from motiongen.features import FPS
from motiongen.measure.clip import SIDES, observe
from motiongen.motion import Motion
from motiongen.nn import Floats
from motiongen.text.asking import asked_of, claim_of
from motiongen.text.claims import Asked, Claim, holds, slowness

PACES = {"slow": 1.25, "quick": 0.8}  # how many times as long as usual what is to be so then takes

ToMotion = Callable[[Floats], Motion]
Mirror = Callable[[Floats], Floats]


def mended(x: Floats, text: str, to_motion: ToMotion, mirror: Mirror, *, as_long: bool) -> Motion:
    """The motion of the drawn features `x` (T, 140), doing what `text` asks for as far as it can be made to.

    `as_long`: it is to last as long as it was drawn, so a pace is left alone and cycles share that time.
    """
    drawn = to_motion(x)
    asked = asked_of(text)
    if asked is None or len(asked.claims) > 1:
        return drawn
    (claim,) = asked.claims
    seen = observe(drawn)
    if claim.side in SIDES and not holds(_side_of(claim), seen):
        other = mirror(x)
        motion = to_motion(other)
        if holds(_side_of(claim), there := observe(motion)):
            x, drawn, seen = other, motion, there
    cycles = repeated(x, claim, seen)
    if cycles is not x:
        drawn = to_motion(cycles)
        if as_long:
            return lasting(drawn, (len(x) - 1) / FPS)
    if not claim.pace or as_long or holds(asked, seen) or not slowness(claim, seen):
        return drawn
    return lasting(drawn, drawn.duration * PACES[claim.pace] / slowness(claim, seen))


def counted(x: Floats, text: str, to_motion: ToMotion) -> Floats:
    """Features `x` (T, 140), drawn for `text`, with as many cycles as it counts, as far as they can be made so."""
    claim = claim_of(text)
    return x if claim is None or claim.count is None else repeated(x, claim, observe(to_motion(x)))


def lasting(motion: Motion, seconds: float) -> Motion:
    """`motion` played in `seconds`."""
    played = replace(motion, fps=motion.fps * motion.duration / seconds).resampled(motion.fps)
    return replace(played, labels=tuple(replace(each, end_s=played.duration) for each in motion.labels))


def _side_of(claim: Claim) -> Asked:
    """What `claim` asks for, but for how often, how far and how fast."""
    return Asked((Claim(claim.action, claim.side),))
