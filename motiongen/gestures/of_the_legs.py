"""Gestures of the legs: squatting, stepping, kicking, jumping; and the punch, which comes from the legs."""

from __future__ import annotations

from math import sqrt

from motiongen.gestures.gesture import Gesture, Params
from motiongen.gestures.pose import HANG, STAND, ZERO, Arm, Foot, Pose, Step, Vec, reach, there_and_back

SIDES = ("right", "left")
GRAVITY = 9.81  # m/s²
ON_LEFT: Vec = (0.0, 0.085, -0.02)  # the pelvis over the left foot


def _squat(p: Params) -> list[Step]:
    depth = p.amplitude
    arm = Arm((1.0, 0.08, 0.25), (1.0, -0.02, 0.45))
    low = Pose(
        arm, arm, (0, -0.45 * depth, 0), (0, 0.25 * depth, 0), (0, 0.45 * depth, 0), (-0.09 * depth, 0, -0.29 * depth)
    )
    return [Step(0.85, low), Step(0.15, low), Step(0.80, STAND)] * p.count + [Step(0.1, STAND)]


def _sit(p: Params) -> list[Step]:
    arm = Arm((0.45, 0.16, -0.9), (1.0, -0.05, -0.20))
    low = Pose(arm, arm, (0, -0.15, 0), (0, 0.12, 0), (0, 0.25, 0), (-0.22 * p.amplitude, 0, -0.36 * p.amplitude))
    return there_and_back(low, reach_s=1.2, hold_s=1.6, back_s=1.1)


def _march(p: Params) -> list[Step]:
    high = 0.20 * p.amplitude
    ahead, behind = Arm((0.45, 0.10, -1.0), (1.0, -0.05, -0.4)), Arm((-0.45, 0.14, -1.0), (-0.05, 0.08, -1.0))
    over: Vec = (0.0, 0.045, -0.015)
    right_up = Pose(behind, ahead, ZERO, (0, 0, -0.06), ZERO, over, right_foot=Foot(0.10, 0, high, 0.25))
    left_up = Pose(ahead, behind, ZERO, (0, 0, 0.06), ZERO, (0, -0.045, -0.015), left_foot=Foot(0.10, 0, high, 0.25))
    down = Pose(shift=(0, 0, -0.012))
    steps = []
    for i in range(p.count):
        steps += [Step(0.34, right_up if i % 2 == 0 else left_up), Step(0.26, down)]
    return [*steps, Step(0.4, STAND)]


def _one_leg(p: Params) -> list[Step]:
    """Stand on the left leg with the right foot up, as the gesture of the leg that is lifted."""
    out = Arm((0.10, 0.75, -0.8), (0.15, 0.9, -0.5))
    over = Pose(out, out, shift=(0, 0.075, -0.02), pelvis=(0.02, 0, 0))
    up = Pose(out, out, (0.02, 0, 0), (0.03, 0.0, 0), (0.02, 0, 0), ON_LEFT, right_foot=Foot(0.12, -0.03, 0.26, 0.35))
    return [Step(0.9, over), Step(0.7, up), Step(1.8, up), Step(0.7, over), Step(0.8, STAND)]


def _kick(p: Params) -> list[Step]:
    a = p.amplitude
    guard = reach((0.24, 0.10, -0.06), elbow=(-0.1, 0.6, -1.0))
    over = Pose(guard, guard, shift=(0, 0.06, -0.02))
    drawn = Pose(guard, guard, ZERO, (0, 0.10, 0), (0, -0.05, 0), ON_LEFT, right_foot=Foot(0.02, -0.03, 0.22, 0.5))
    out = Pose(Arm((-0.3, 0.4, -1.0), (0.1, 0.2, -1.0)), guard, ZERO, (0, 0.12, 0), (0, -0.15, 0), ON_LEFT,
               right_foot=Foot(0.64 * sqrt(a), -0.04, 0.40 * a, -0.45))  # fmt: skip
    once = [Step(0.35, drawn), Step(0.28, out), Step(0.08, out), Step(0.30, drawn), Step(0.35, over)]
    return [Step(0.5, over), *once * p.count, Step(0.6, STAND)]


def _punch(p: Params) -> list[Step]:
    low: Vec = (0.0, 0.0, -0.03)
    lead = reach((0.27, 0.08, -0.01), elbow=(-0.1, 0.5, -1.0))
    guard = Pose(
        reach((0.21, 0.08, -0.03), elbow=(-0.1, 0.5, -1.0)), lead, (0, 0.06, 0), (0, 0.04, -0.15), (0, 0, -0.1), low
    )
    hit = Pose(
        Arm((1.0, -0.10, 0.0), (1.0, -0.22, 0.02)),
        lead,
        (0, 0.06, -0.35),
        (0, 0.06, 0.45),
        (0, 0, 0.12),
        (0.03, 0, -0.035),
    )
    return [Step(0.55, guard), *[Step(0.32, hit), Step(0.06, hit), Step(0.32, guard)] * p.count, Step(0.7, STAND)]


def _jump(p: Params) -> list[Step]:
    """Down, off, and as long in the air as gravity has it: the push ends at the speed with which the flight begins."""
    high, deep = 0.10 * p.amplitude, 0.20
    flight = sqrt(2 * high / GRAVITY)  # s up, and as long down
    push = 2 * deep / (GRAVITY * flight)  # s from rest at an even acceleration to that speed
    back, up = Arm((-0.6, 0.15, -0.9), (-0.5, 0.1, -1.0)), Arm((0.75, 0.3, -0.2), (1.0, 0.1, 0.55))
    crouch = Pose(back, back, (0, -0.25, 0), (0, 0.22, 0), (0, 0.35, 0), (-0.06, 0, -deep))
    air = Foot(0, 0, high)
    top = Pose(up, up, ZERO, ZERO, ZERO, (0, 0, high), right_foot=air, left_foot=air)
    off = Pose(up, up)
    landed = Pose(HANG, HANG, (0, -0.10, 0), (0, 0.15, 0), (0, 0.22, 0), (-0.04, 0, -0.13))
    landing = 2 * 0.13 / (GRAVITY * flight)
    once = [
        Step(0.65, crouch), Step(push, off, "launch"), Step(flight, top, "brake"), Step(flight, off, "launch"),
        Step(landing, landed, "brake"), Step(0.6, STAND),
    ]  # fmt: skip
    return once * p.count + [Step(0.15, STAND)]


def _tiptoe(p: Params) -> list[Step]:
    pitch = 0.45 * p.amplitude
    foot = Foot(pitch=pitch)
    up = Pose(head=(0, -0.05, 0), shift=(0.045 * p.amplitude, 0, 0.035 * p.amplitude), right_foot=foot, left_foot=foot)
    return [Step(0.6, up), Step(0.5, up), Step(0.6, STAND)] * p.count + [Step(0.1, STAND)]


def _knee(p: Params) -> list[Step]:
    over = Pose(shift=(0, 0.065, -0.02))
    arm = Arm((0.25, 0.25, -1.0), (0.8, 0.1, -0.4))
    up = Pose(arm, arm, shift=ON_LEFT, right_foot=Foot(0.20, -0.02, 0.30 * p.amplitude, 0.2))
    return [Step(0.55, over), *[Step(0.55, up), Step(0.50, over)] * p.count, Step(0.55, STAND)]


LEGS = (
    Gesture(
        "squat", _squat, repeats=True, amplitudes=(0.4, 1.25),
        verbs=("[squat]", "[do] squats", "[squat] down and [stand] up", "[bend] the knees into a squat"),
        keywords=("squat", "knee bend", "bend knees"),
    ),
    Gesture(
        "sit", _sit, amplitudes=(0.5, 1.1),
        verbs=("[sit] down on nothing", "[crouch] as if on a chair", "[sit] down and [get] up again", "[sit] down"),
        keywords=("sit", "crouch", "chair"),
    ),
    Gesture(
        "march", _march, repeats=True, usual=4, unit="steps", amplitudes=(0.5, 1.3),
        verbs=("[march] in place", "[march] on the spot", "[walk] in place", "[step] in place"),
        keywords=("march", "walk place", "step place", "walk spot"),
    ),
    Gesture(
        "stand-on-one-leg", _one_leg, sides=SIDES, amplitudes=(1, 1),
        verbs=("[balance] on one leg with the {side} foot lifted", "[lift] the {side} foot and [balance]",
               "[stand] on one leg with the {side} foot up"),
        keywords=("one leg", "balance", "one foot", "stand leg"),
    ),
    Gesture(
        "raise-knee", _knee, sides=SIDES, repeats=True, amplitudes=(0.5, 1.2),
        verbs=("[raise] the {side} knee", "[lift] the {side} knee", "[pull] up the {side} knee"),
        keywords=("raise knee", "lift knee", "knee up", "raise leg", "lift leg"),
    ),
    Gesture(
        "kick", _kick, sides=SIDES, repeats=True, amplitudes=(0.5, 1.2), speeds=(0.5, 1.3),
        verbs=("[kick] with the {side} foot", "[kick] with the {side} leg", "[throw] a kick with the {side} leg"),
        keywords=("kick",),
    ),
    Gesture(
        "punch", _punch, sides=SIDES, repeats=True, amplitudes=(1, 1), speeds=(0.5, 1.2),
        verbs=("[punch] with the {side} fist", "[throw] a punch with the {side} hand", "[hit] with the {side} fist"),
        keywords=("punch", "box", "hit fist", "hit"),
    ),
    Gesture(
        "jump", _jump, repeats=True, amplitudes=(0.5, 1.5), speeds=(1.0, 1.0),
        verbs=("[jump]", "[jump] on the spot", "[jump] up and down", "[hop] with both feet"),
        keywords=("jump", "hop"),
    ),
    Gesture(
        "tiptoe", _tiptoe, repeats=True, amplitudes=(0.5, 1.2),
        verbs=("[rise] on tiptoe", "[stand] on tiptoe", "[go] up on the toes", "[lift] the heels"),
        keywords=("tiptoe", "up on toes", "lift heels", "stand on toes"),
    ),
)  # fmt: skip
