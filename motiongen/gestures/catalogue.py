"""All gestures by name; performing one, and drawing performances for a corpus."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from motiongen.gestures.assemble import assemble, mirrored
from motiongen.gestures.gesture import Gesture, Params
from motiongen.gestures.of_both_arms import BOTH_ARMS
from motiongen.gestures.of_one_arm import ONE_ARM
from motiongen.gestures.of_the_feet import FEET
from motiongen.gestures.of_the_head import HEAD
from motiongen.gestures.of_the_legs import LEGS
from motiongen.gestures.of_the_trunk import TRUNK
from motiongen.motion import Label, Motion, Source

LICENCE = "Apache-2.0"
_ALL = {gesture.name: gesture for gesture in (*HEAD, *ONE_ARM, *BOTH_ARMS, *TRUNK, *LEGS, *FEET)}


def gestures() -> dict[str, Gesture]:
    """Every family by name."""
    return dict(_ALL)


def gesture(name: str) -> Gesture:
    """The family `name`; raises ValueError that lists the names."""
    if name not in _ALL:
        raise ValueError(f"unknown gesture {name!r}; known are {', '.join(_ALL)}")
    return _ALL[name]


def perform(
    name: str,
    *,
    side: str | None = None,
    count: int | None = None,
    speed: float = 1.0,
    amplitude: float = 1.0,
    seed: int = 0,
    fps: float = 30.0,
    seconds: float | None = None,
) -> Motion:
    """The gesture `name`, facing forward at first, from standing to standing, labelled with its first caption.

    `side`: "left", "right" or "both", and `count`, how often: the usual ones where None. `speed`, `amplitude`: factors
    of the usual; where the gesture has an angle, `amplitude` scales it. The same arguments give the same motion; `seed`
    draws breath, drift and uneven timing. `seconds`: stand on to the end until the motion is as long.

    Raises ValueError naming the bad value and the good ones.
    """
    family = gesture(name)
    if not math.isfinite(fps) or fps <= 0:
        raise ValueError(f"fps must be above 0, not {fps}")
    params = family.params(side=side, count=count, speed=speed, amplitude=amplitude)
    return _performed(family, params, seed, fps, seconds)


def sample(rng: np.random.Generator, *, fps: float = 30.0) -> tuple[Motion, tuple[str, ...]]:
    """A performance with everything drawn, and its captions: every family equally often, counts up to five."""
    family, params = draw(rng)
    return _performed(family, params, int(rng.integers(2**31)), fps), family.captions(params)


def draw(rng: np.random.Generator) -> tuple[Gesture, Params]:
    """What `sample` performs: the family and its values."""
    family = _ALL[str(rng.choice(list(_ALL)))]
    usual = rng.random(2) < 0.4  # people mostly do not say how fast and how far
    params = family.params(
        side=str(rng.choice(family.sides)) if family.sides else None,
        count=int(rng.integers(1, 6)) if family.repeats else None,
        speed=1.0 if usual[0] else float(rng.uniform(*family.speeds)),
        amplitude=1.0 if usual[1] else float(rng.uniform(*family.amplitudes)),
    )
    if family.named and rng.random() < 0.5:
        degrees = int(rng.choice(list(family.named)))
        params = replace(params, amplitude=degrees / family.degrees, angle=math.radians(degrees))
    return family, params


def _performed(family: Gesture, params: Params, seed: int, fps: float, seconds: float | None = None) -> Motion:
    steps = family.build(params)
    motion = assemble(steps, speed=params.speed, fps=fps, rng=np.random.default_rng(seed), seconds=seconds)
    if params.side == "left":
        motion = mirrored(motion)
    label = Label(0.0, motion.duration, family.captions(params)[0])
    return replace(motion, labels=(label,), source=Source(f"gesture {family.name}", seed=seed, licence=LICENCE))
