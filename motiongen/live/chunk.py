"""A live motion as pure functions: a state, the chunk that follows it, and the state after any frame of the chunk."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from motiongen.diffusion import mdm_run
from motiongen.diffusion.finish import slip, smoothed_over_five
from motiongen.diffusion.said import Said, with_nothing
from motiongen.diffusion.samplers import SAMPLERS, Denoiser, guided
from motiongen.diffusion.schedule import SCHEDULES, even_ratios
from motiongen.diffusion.weights import Weights
from motiongen.features import CONTACTS, FPS, HEIGHT, PLANAR, WIDTH, YAW, features_to_motion, root_path
from motiongen.live.reaching import Hands, reached
from motiongen.live.steering import ROOT, ROOT_GIVEN
from motiongen.motion import Label, Motion, Skeleton, Source
from motiongen.nn import Floats
from motiongen.rotation import quat_continuous, quat_mul, quat_rotate, yaw_quat

KEPT = 60  # frames of the past: more than any network's history
SEEN = 4  # of them, that smoothing looks at
HAND_OVER = 8  # frames in which a chunk comes from where the past leads to what was drawn
TAIL = 6  # frames at a chunk's end that are drawn for what comes before them, and drawn again
SAMPLER = "dpm-solver-2m"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """Where a live motion is before frame `frame`.

    `history` (n, 140): features of the last `KEPT` frames, or of as many as there were; `heading` in rad and `place`
    (2,) in m of the pelvis in frame `frame`.
    """

    frame: int
    heading: float
    place: Array
    history: Floats

    @property
    def cruise(self) -> float:
        """Forward speed in m/s over the history."""
        return float(self.history[:, PLANAR.start].mean()) if len(self.history) else 0.0


@dataclass(frozen=True)
class Chunk:
    """`features` (N, 140) of the frames from `start.frame` on; `headings` (N + 1,) in rad and `places` (N + 1, 2) in m
    of the pelvis in them and in the frame after; `turns` (N, 22, 4) of the joints as a Motion has them."""

    start: State
    features: Floats
    headings: Array
    places: Array
    turns: Array

    def __len__(self) -> int:
        return len(self.features)


@dataclass(frozen=True)
class Drawing:
    """How to draw: passes of the network and scale of guidance."""

    passes: int = 5
    guidance: float = 2.0


def begin(heading: float = 0.0, place: tuple[float, float] = (0.0, 0.0)) -> State:
    """Before anything has moved."""
    return State(0, heading, np.array(place), np.zeros((0, WIDTH), np.float32))


def next_chunk(
    model: Weights,
    skeleton: Skeleton,
    state: State,
    said: Said,
    steering: Floats,
    how: Drawing,
    seed: int,
    hands: Hands = Hands(),  # noqa: B008
) -> Chunk:
    """What follows `state` under the one text of `said` and `steering` (H + C, 12), the same for the same arguments.

    It begins where the history leads, is smoothed over five frames, its `hands` are led to their places, and the slip
    of planted feet is taken off the root's path. Raises FloatingPointError where the network gives numbers that are not
    finite.
    """
    history = int(model.sizes["history"])
    x = _drawn(model, state, said, steering, how, seed)
    features = x * model.std + model.mean
    past = state.history[-SEEN:]
    if not np.isfinite(features).all():
        raise FloatingPointError(f"the chunk of frame {state.frame} is not finite")
    known = len(past)
    features = smoothed_over_five(np.concatenate([past, handed_over(past, features)]).astype(float))
    features[:known] = past
    features[known:] = reached(features[known:], skeleton, hands)
    motion = features_to_motion(features, skeleton)
    features[known:, PLANAR] -= slip(motion, features[:, CONTACTS])[known:]  # what has been shown stays
    kept = slice(known, known + model.window - history - TAIL)
    features = features[kept].astype(np.float32)
    headings, places = _way(state, features)
    turns = motion.joint_quat[kept]
    begun = state.heading - past[:, YAW].sum() / FPS  # heading of the first frame of `motion`, which says it is 0
    turns[:, 0] = quat_mul(yaw_quat(np.array(begun)), turns[:, 0])
    return Chunk(state, features, headings, places, turns)


def _drawn(model: Weights, state: State, said: Said, steering: Floats, how: Drawing, seed: int) -> Floats:
    """Normalised features (C, 140) of a chunk."""
    history, window, width = int(model.sizes["history"]), model.window, len(model.mean)
    sizes = {name: int(model.sizes[name]) for name in ("patch", "heads")}
    frames = np.ones((2, window), bool)
    past = np.zeros((2, history, width), np.float32)
    if len(state.history):
        rows = np.arange(-history, 0).clip(-len(state.history))  # before the first frame all stood still
        past[:] = (state.history[rows] - model.mean) / model.std
    else:
        frames[:, :history] = False
    told = mdm_run.told(model.tensors, sizes, frames, with_nothing(said), np.stack([steering, steering]))

    def predict(x: Floats, t: float) -> Floats:
        made = mdm_run.estimate(model.tensors, sizes, np.concatenate([past, x], axis=1), t, told)[:, history:]
        return overwritten(made, steering[history:])

    noise = np.random.default_rng([seed, state.frame]).standard_normal((1, window - history, width), np.float32)
    schedule = SCHEDULES[model.schedule]
    denoise = guided(cast(Denoiser, predict), how.guidance)
    return cast(Floats, SAMPLERS[SAMPLER](denoise, lambda: noise, schedule, _times(model.schedule, how.passes))[0])


def overwritten(made: Floats, steering: Floats) -> Floats:
    """An estimate (…, C, 140), normalised, with yaw rate and velocity of the root as `steering` (C, 12) has them, where
    given (MDM, Sec. 3, Editing): what the network makes of hearing them alone is well off."""
    given = steering[:, ROOT_GIVEN] > 0
    made[..., given, ROOT] = steering[given, ROOT]
    return made


def handed_over(past: Floats, features: Floats) -> Floats:
    """`features` (C, 140) that begin where the last two frames of the `past` (n, 140) lead; what they are off there
    dies away by a cubic within `HAND_OVER` frames. As they are where there is no past; contacts always are."""
    if len(past) < 2:
        return features
    rate = (past[-1] - past[-2] + features[1] - features[0]) / 2
    off = past[-1] + rate - features[0]
    off[CONTACTS] = 0.0
    u = np.minimum(np.arange(len(features)) / HAND_OVER, 1.0)[:, None]
    return features + (off * (1 - 3 * u**2 + 2 * u**3)).astype(features.dtype)


@cache
def _times(schedule: str, passes: int) -> list[float]:
    return even_ratios(SCHEDULES[schedule], passes)


def _way(state: State, features: Floats) -> tuple[Array, Array]:
    """Heading and place of each frame and of the one after."""
    yaw, root = root_path(np.concatenate([features, features[-1:]]).astype(float))
    heading = state.heading + yaw
    turned = quat_rotate(yaw_quat(np.array(state.heading)), root * [1.0, 1.0, 0.0])
    return heading, state.place + turned[:, :2]


def after(chunk: Chunk, count: int) -> State:
    """The state once the first `count` frames of a chunk have been shown; raises ValueError for other counts."""
    if not 0 <= count <= len(chunk):
        raise ValueError(f"count must be 0 to the chunk's {len(chunk)} frames, not {count}")
    if count == 0:
        return chunk.start
    start = chunk.start
    rows = np.concatenate([start.history, chunk.features[:count]])[-KEPT:]
    return State(start.frame + count, float(chunk.headings[count]), chunk.places[count], rows)


def shown(chunk: Chunk, count: int, skeleton: Skeleton, source: Source, text: str) -> Motion:
    """The first `count` frames of a chunk in the world."""
    features = chunk.features[:count]
    return Motion(
        np.column_stack([chunk.places[:count], features[:, HEIGHT]]),
        quat_continuous(chunk.turns[:count]),
        FPS,
        skeleton,
        labels=(Label(0.0, (count - 1) / FPS, text),),
        source=source,
        contacts=features[:, CONTACTS] > 0.5,
    )
