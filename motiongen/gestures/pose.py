"""The vocabulary gestures are written in: poses of a standing body, and steps that lead from one to the next.

All is written as for a right-hander: a gesture of the left side is the mirror image of that of the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from motiongen.gestures.body import FOREARM, SHOULDER, UPPER_ARM

Vec = tuple[float, float, float]
Ease = Literal["smooth", "launch", "brake", "flow"]
ZERO: Vec = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Arm:
    """An arm, seen from the chest: x forward, y *outward* (so both arms are written alike), z up.

    `upper`, `fore`: the way in which upper arm and forearm point, of any length. `hinge`: where the elbow would bend to
    if the arm is straight. `wrist`: radians of flexion (towards the palm) and of turning the palm up.
    """

    upper: Vec
    fore: Vec
    hinge: Vec = (1.0, 0.0, 0.3)
    wrist: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Foot:
    """A foot: `x` forward, `y` outward, `z` up in metres from where it stands at first; `pitch` in radians, toes down
    positive, and `yaw`, to the left positive, about the ankle.

    Toes down, it turns about the ball of the foot, as when the heel lifts; toes up, about the ankle.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0


def straight(upper: Vec, hinge: Vec = (1.0, 0.0, 0.3)) -> Arm:
    """An arm stretched along `upper`."""
    return Arm(upper, upper, hinge)


def reach(hand: Vec, elbow: Vec = (-0.3, 0.6, -1.0), wrist: tuple[float, float] = (0.0, 0.0)) -> Arm:
    """The arm whose wrist is at `hand`: metres from the point between the shoulders, x forward, y outward, z up.

    `elbow`: the way in which the elbow points off the line from shoulder to hand. Two bones, the law of cosines.
    Raises ValueError where the hand is out of reach.
    """
    x, y, z = hand[0], hand[1] - SHOULDER, hand[2]
    far = (x * x + y * y + z * z) ** 0.5
    if not abs(UPPER_ARM - FOREARM) < far < UPPER_ARM + FOREARM:
        raise ValueError(f"no arm reaches {hand}: {far:.2f} m from its shoulder")
    line = (x / far, y / far, z / far)
    along = sum(a * b for a, b in zip(line, elbow, strict=True))
    off = [e - along * a for e, a in zip(elbow, line, strict=True)]
    size = sum(o * o for o in off) ** 0.5
    foot = (far * far + UPPER_ARM**2 - FOREARM**2) / (2 * far)  # along the line, to below the elbow
    high = max(UPPER_ARM**2 - foot * foot, 0.0) ** 0.5
    bend = [foot * a + high * o / size for a, o in zip(line, off, strict=True)]
    return Arm((bend[0], bend[1], bend[2]), (x - bend[0], y - bend[1], z - bend[2]), wrist=wrist)


HANG = Arm((0.02, 0.16, -1.0), (0.22, 0.10, -1.0))


@dataclass(frozen=True)
class Pose:
    """The whole body. Turns are axis times angle in radians: (lean right, nose down, turn left).

    `shift`: the pelvis in metres (forward, left, up) from where it stands at first. `heading`: radians by which the
    body has turned to the left since, whole turns included. `pelvis` turns it from there, `spine` the chest on the
    pelvis, `head` the head on the chest. `shrug`: radians by which both shoulders are lifted.
    """

    right: Arm = HANG
    left: Arm = HANG
    head: Vec = ZERO
    spine: Vec = ZERO
    pelvis: Vec = ZERO
    shift: Vec = ZERO
    shrug: float = 0.0
    right_foot: Foot = Foot()
    left_foot: Foot = Foot()
    heading: float = 0.0


@dataclass(frozen=True)
class Step:
    """Reach `pose` in `seconds`: `smooth` from rest to rest (minimum jerk), or, for what is not to stop on the way,
    `launch` from rest up to speed and `brake` from speed to rest, both at an even acceleration. `flow` comes out of
    the flow before and goes on into the next, where each number stops only to turn round or where it stays: a foot on
    the floor does not move while the pelvis goes on."""

    seconds: float
    pose: Pose
    ease: Ease = "smooth"


STAND = Pose()


def there_and_back(pose: Pose, *, reach_s: float, hold_s: float, back_s: float) -> list[Step]:
    """Into a pose, hold it, and back to standing."""
    return [Step(reach_s, pose), Step(hold_s, pose), Step(back_s, STAND)]
