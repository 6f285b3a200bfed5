"""Going by steps: where the feet come down, one after the other, and what the body does on the way.

A foot that is not lifted stands where it is. The pelvis goes over the standing foot and on to between both, the arms
swing against the legs, and the head is first to look where the body will face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, hypot, sin, sqrt

from motiongen.gestures.body import HIP, SHIN, SOFT_KNEES, STANCE, THIGH, TOES
from motiongen.gestures.pose import Arm, Foot, Pose, Step, Vec

LIFT = 0.07  # m that the ball of a swinging foot rises: puppets have no toes to lift
FULL_STRIDE = 0.4  # m from foot to foot at which arms, hips and heels do all that is written here
SWAY = 0.45  # share of the way to over the standing foot that the pelvis goes
STRETCHED = 0.99  # share of its length to which a leg stretches: a knee does not snap straight
LEAD = 0.5  # rad by which head and chest are turned further than the feet, at most
FIRST_S = 0.15  # s in which the weight goes over before the first step
SHARES = (0.22, 0.39, 0.39)  # of a step: heel off, foot up, foot down


@dataclass(frozen=True)
class Place:
    """Where a foot stands, or the pelvis is: `x` forward and `y` left in metres, `yaw` to the left in radians, all of
    the place between the feet where the gesture begins."""

    x: float
    y: float
    yaw: float = 0.0

    def towards(self, other: Place, share: float) -> Place:
        """The place `share` of the way to `other`."""
        return Place(*(a + share * (b - a) for a, b in ((self.x, other.x), (self.y, other.y), (self.yaw, other.yaw))))


def beside(middle: Place, side: str, aside: float = STANCE) -> Place:
    """Where the foot of `side` stands when the body is at `middle`."""
    out = aside if side == "left" else -aside
    return Place(middle.x - out * sin(middle.yaw), middle.y + out * cos(middle.yaw), middle.yaw)


def stepping(falls: Sequence[tuple[str, Place]], seconds: float) -> list[Step]:
    """The feet ("right" or "left") come down at these places one after the other, each in `seconds`, from standing on.

    The last pose stands where it has come to, so `falls` should leave the feet side by side or a little apart.
    """
    feet = {side: beside(Place(0, 0), side) for side in ("right", "left")}
    at = Place(0, 0)
    facing = falls[-1][1].yaw
    steps = []
    for i, (side, place) in enumerate(falls):
        old, standing = feet[side], feet["left" if side == "right" else "right"]
        comes_to = place.towards(standing, 0.5)
        passing = at.towards(comes_to, 0.5)
        over = passing.towards(Place(standing.x, standing.y, passing.yaw), SWAY)
        ahead, was_ahead = _ahead(place, standing), _ahead(old, standing)
        heel = 0.12 + 0.35 * max(0.0, ahead - was_ahead) / 2
        half_way = old.towards(place, 0.5)
        off_s, up_s, down_s = (share * seconds for share in SHARES)
        steps += [
            Step(off_s + (FIRST_S if i == 0 else 0.0),
                 _pose(at.towards(over, 0.3), feet, facing, 0.6 * was_ahead, side, pitch=heel), "flow"),
            Step(up_s, _pose(over, feet | {side: half_way}, facing, 0.0, side, LIFT, 0.5 * heel), "flow"),
        ]  # fmt: skip
        feet[side], at = place, comes_to
        steps.append(Step(down_s, _pose(at, feet, facing, ahead, side), "flow"))
    return [*steps, Step(0.45, _pose(at, feet, facing, 0.0, "right"))]


def _ahead(foot: Place, standing: Place) -> float:
    """How far a foot is ahead of the other, in full strides, as the other faces."""
    x, y = foot.x - standing.x, foot.y - standing.y
    return (x * cos(standing.yaw) + y * sin(standing.yaw)) / FULL_STRIDE


def _pose(
    at: Place, feet: dict[str, Place], facing: float, ahead: float, swinging: str, lift: float = 0.0, pitch: float = 0.0
) -> Pose:
    """The body with its pelvis at `at` and the foot `swinging` `ahead` full strides, `lift` metres up."""
    right_ahead = ahead if swinging == "right" else -ahead
    hip = 0.07 * right_ahead
    to_come = max(-LEAD, min(LEAD, facing - at.yaw))
    drop = 0.5 * lift if swinging == "right" else -0.5 * lift  # the free side of the pelvis hangs a little
    pitches = {side: pitch if side == swinging else 0.0 for side in feet}
    grounded = [side for side in feet if not lift or side != swinging]
    return Pose(
        right=_arm(-right_ahead),
        left=_arm(right_ahead),
        head=(0, 0.03, 0.7 * to_come),
        spine=(-drop, 0.02, 0.3 * to_come - 1.4 * hip),
        pelvis=(drop, 0, hip),
        shift=(at.x, at.y, min(_sink(beside(at, side, HIP), feet[side], pitches[side]) for side in grounded)),
        right_foot=_foot(feet["right"], -1.0, *((lift, pitch) if swinging == "right" else (0.0, 0.0))),
        left_foot=_foot(feet["left"], 1.0, *((lift, pitch) if swinging == "left" else (0.0, 0.0))),
        heading=at.yaw,
    )


def _sink(hip: Place, foot: Place, pitch: float) -> float:
    """Metres, 0 or less, by which a standing pelvis must sink for a leg to reach a foot on the floor, heel up by
    `pitch` radians."""
    ball, _, up = TOES
    forward = ball - ball * cos(pitch) - up * sin(pitch)  # by which the ankle goes about the ball of the foot
    rise = up + ball * sin(pitch) - up * cos(pitch)
    x, y = foot.x + forward * cos(foot.yaw) - hip.x, foot.y + forward * sin(foot.yaw) - hip.y
    leg = THIGH + SHIN
    return min(0.0, rise + sqrt((STRETCHED * leg) ** 2 - hypot(x, y) ** 2) - (leg - SOFT_KNEES))


def _foot(place: Place, out: float, lift: float, pitch: float) -> Foot:
    return Foot(place.x, out * place.y - STANCE, lift, pitch, place.yaw)


def _arm(ahead: float) -> Arm:
    """An arm swung forward by up to 1, or back by up to −1; elbows bend as the arm comes forward."""
    upper: Vec = (0.02 + 0.30 * ahead, 0.16, -1.0)
    fore: Vec = (0.22 + (0.45 if ahead > 0 else 0.22) * ahead, 0.10, -1.0)
    return Arm(upper, fore)
