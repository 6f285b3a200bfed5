"""A body of its own for every part of the body that somebody speaks of.

In MotionDiffuse's Eq. 10 all estimates look at the one noisy motion. The one that is told "wave" then sees a walker,
and having learnt to wave on a stand, waves worse, or not at all. So the estimates of a part are made on a motion beside
the mixed one, from the same noise, that does nothing but what they say, and the mixture takes their part of it. Who
speaks of the whole body looks at the mixture, so that the walk goes along with the arm that waves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motiongen.diffusion import mixing
from motiongen.nn import Floats


@dataclass(frozen=True)
class Body:
    """The passes `voices` that a body follows, and how much of it is each one's: (stop − start, F) for each. What is
    left over is the mixture's."""

    voices: tuple[int, ...]
    share: tuple[Floats, ...]


def bodies_of(spans: Sequence[mixing.Span], fade: int) -> list[Body]:
    """A body for each part that some of `spans` speak of; those who speak of the same part in turn share it."""
    by_part: dict[bytes, list[int]] = {}
    for i, span in enumerate(spans):
        if not span.columns.all():
            by_part.setdefault(span.columns.tobytes(), []).append(i)
    total = max(span.stop for span in spans)
    whole = np.ones(len(spans[0].columns), bool)
    out = []
    for voices in by_part.values():
        there = [mixing.Span(spans[i].start, spans[i].stop, whole) for i in voices]
        share = mixing.shares([*there, mixing.Span(0, total, whole, told=False)], fade)
        out.append(Body(tuple(voices), tuple(share[:-1])))
    return out


def followed(body: Body, mixed: Floats, estimates: Sequence[Floats], spans: Sequence[mixing.Span]) -> Floats:
    """What `body` is to be (B, T, F): what its own `estimates` say, each in the frames of its span, else `mixed`."""
    out = mixed.copy()
    for i, share in zip(body.voices, body.share, strict=True):
        rows = slice(spans[i].start, spans[i].stop)
        out[:, rows] += share * (estimates[i] - mixed[:, rows])
    return out
