"""What a clip says by itself: counts, metres and degrees, measured from the motion without any network."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from motiongen.measure import arms, legs
from motiongen.measure.swings import Turning
from motiongen.motion import SMPL_JOINTS, Motion
from motiongen.rotation import Array

FPS = 30.0  # what every clip is measured at, so that its own rate changes nothing
SIDES = ("left", "right")


@dataclass(frozen=True)
class Measured:
    """What a motion shows.

    Units stand in the names. `path_m` runs along the pelvis's way, `net_m` straight from start to end; `turn_deg` is
    from start to end too, positive to the left. A wave is a swing of the hand in and out again; `perhaps` counts what
    might be one as well, so that where it differs the waves are not sure. A head shake is from side to side and back,
    counted in halves. `bow_deg` is the deepest bow, 0 without one, `chest_pitch_deg` the furthest that the chest leans
    forward; `jump_height_m` the pelvis's highest rise above standing, 0 without a jump.
    """

    duration_s: float
    left_steps: int
    right_steps: int
    path_m: float
    net_m: float
    mean_speed_m_s: float
    turn_deg: float
    left_waves: int
    right_waves: int
    left_perhaps: int
    right_perhaps: int
    left_raises: int
    right_raises: int
    nods: int
    head_shakes: float
    claps: int
    bows: int
    bow_deg: float
    chest_pitch_deg: float
    squats: int
    jumps: int
    jump_height_m: float

    @property
    def steps(self) -> int:
        """Steps of both feet."""
        return self.left_steps + self.right_steps


@dataclass(frozen=True)
class Event:
    """Something done once: `action` by `side` ("left", "right" or ""), around `at_s`.

    `seconds`: how long half of it takes, from which its tempo is told; 0 where nothing says. A head shake has one event
    for each swing to a side.
    """

    action: str
    side: str
    at_s: float
    seconds: float


@dataclass(frozen=True)
class Seen:
    """A motion measured in full: its totals, its events in order of time, and what cannot be cut into events.

    At 30 frames a second: `turned_deg` (T,) since the start, left positive, and `lifted_deg` (T, 2), by which the line
    from shoulder to wrist is off straight down, of (left, right) arm. Of (left, right), too: `hand_path_m`, the way of
    the hand as seen from the shoulder; `foot_high_m`, the furthest that the foot is off the floor. `ahead_m`: from
    start to end, forward and left of where the pelvis faced at first. `skate`: share of the time in which a foot is
    down that it slides.
    """

    totals: Measured
    events: tuple[Event, ...]
    turned_deg: Array
    lifted_deg: Array
    hand_path_m: tuple[float, float]
    foot_high_m: tuple[float, float]
    ahead_m: tuple[float, float]
    skate: float


def measure(motion: Motion) -> Measured:
    """Measure a motion that stands on the floor z = 0 or any other level one.

    Raises ValueError where the skeleton lacks one of the 22 joints of SMPL.
    """
    return observe(motion).totals


def observe(motion: Motion) -> Seen:
    """Measure a motion in full; raises as `measure` does."""
    if missing := [name for name in SMPL_JOINTS if name not in motion.skeleton.names]:
        raise ValueError(f"cannot measure a skeleton without {', '.join(missing)}")
    seconds = motion.duration
    motion = motion.resampled(FPS)
    at = motion.positions()
    pelvis = at[:, 0]
    feet = legs.feet(motion, at)
    taken = legs.steps(motion, feet)
    jumped, high = legs.jumps(motion, pelvis, feet)
    squatted = legs.squats(motion, pelvis, feet, jumped)
    low = np.quantile(pelvis[:, 2], 0.9) - pelvis[:, 2]
    bowed, pitch = arms.bows(motion, low, np.all(feet.still, axis=1))
    nodded, shaken = arms.head(motion)
    clapped = arms.claps(motion, at)
    waved = {side: arms.waves(motion, at, side) for side in SIDES}
    perhaps = {side: len(arms.perhaps_waves(motion, at, side)) for side in SIDES}
    raised = {side: arms.raises(motion, at, side) for side in SIDES}
    turned = legs.turned(motion)

    events = [
        *(_of_turning("squat", each) for each in squatted),
        *(_of_turning("bow", each) for each in bowed),
        *(_of_turning("nod", each) for each in nodded),
        *(_of_turning("clap", each) for each in clapped),
        *(_of_turning("wave", each, side) for side in SIDES for each in waved[side]),
        *(Event("raise", side, frame / FPS, 0.0) for side in SIDES for frame in raised[side]),
        *(Event("shake", "", frame / FPS, each_s) for frame, each_s in shaken),
        *(Event("jump", "", frame / FPS, 0.0) for frame in jumped),
        *(Event("step", SIDES[not left], (a + b) / 2 / FPS, (b - a + 1) / FPS) for a, b, left in taken),
    ]  # fmt: skip
    along, net = legs.way(pelvis)
    totals = Measured(
        duration_s=seconds, left_steps=sum(left for *_, left in taken), right_steps=sum(not left for *_, left in taken),
        path_m=along, net_m=net, mean_speed_m_s=along / seconds if seconds else 0.0, turn_deg=float(turned[-1]),
        left_waves=len(waved["left"]), right_waves=len(waved["right"]),
        left_perhaps=perhaps["left"], right_perhaps=perhaps["right"],
        left_raises=len(raised["left"]), right_raises=len(raised["right"]),
        nods=len(nodded), head_shakes=(len(shaken) + 1) / 2 if shaken else 0.0, claps=len(clapped),
        bows=len(bowed), bow_deg=float(np.degrees(max((t.depth for t in bowed), default=0.0))), chest_pitch_deg=pitch,
        squats=len(squatted), jumps=len(jumped), jump_height_m=high,
    )  # fmt: skip
    return Seen(
        totals,
        tuple(sorted(events, key=lambda event: event.at_s)),
        turned,
        lifted_deg=np.stack([arms.lifted(motion, at, side) for side in SIDES], axis=1),
        hand_path_m=_pair(lambda side: arms.hand_path(motion, at, side)),
        foot_high_m=_pair(lambda side: feet.clear[:, SIDES.index(side)].max()),
        ahead_m=legs.ahead(motion),
        skate=legs.skate(motion, at),
    )


def _of_turning(action: str, turning: Turning, side: str = "") -> Event:
    return Event(action, side, turning.frame / FPS, turning.seconds)


def _pair(of_side: Callable[[str], float]) -> tuple[float, float]:
    return float(of_side("left")), float(of_side("right"))


def mirrored(measured: Measured) -> Measured:
    """What the mirror image of a motion that was `measured` shows."""
    here = asdict(measured)
    there = {"left": "right", "right": "left"}
    sides = {name: here[name.replace(side, there[side])] for name in here for side in there if name.startswith(side)}
    return Measured(**{**here, **sides, "turn_deg": -measured.turn_deg})
