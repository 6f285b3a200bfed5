"""Gestures of the head: yes, no, and looking about."""

from __future__ import annotations

from motiongen.gestures.gesture import Gesture, Params
from motiongen.gestures.pose import STAND, Pose, Step, there_and_back


def _nod(p: Params) -> list[Step]:
    down, up = Pose(head=(0, 0.40 * p.amplitude, 0), spine=(0, 0.03, 0)), Pose(head=(0, -0.08 * p.amplitude, 0))
    return [Step(0.30, down), Step(0.32, up)] * p.count + [Step(0.30, STAND)]


def _shake(p: Params) -> list[Step]:
    left, right = (Pose(head=(0, 0.04, yaw * p.amplitude), spine=(0, 0, 0.04 * yaw)) for yaw in (0.55, -0.55))
    return [Step(0.34, left), Step(0.42, right)] * p.count + [Step(0.40, STAND)]


def _look(p: Params) -> list[Step]:
    turned = Pose(head=(0, 0, -0.75 * p.angle), spine=(0, 0, -0.2 * p.angle), pelvis=(0, 0, -0.05 * p.angle))
    return there_and_back(turned, reach_s=0.7, hold_s=1.0, back_s=0.7)


def _look_up(p: Params) -> list[Step]:
    return there_and_back(
        Pose(head=(0, -0.75 * p.angle, 0), spine=(0, -0.25 * p.angle, 0)), reach_s=0.8, hold_s=1.0, back_s=0.8
    )


def _look_down(p: Params) -> list[Step]:
    return there_and_back(
        Pose(head=(0, 0.8 * p.angle, 0), spine=(0, 0.2 * p.angle, 0)), reach_s=0.7, hold_s=1.0, back_s=0.8
    )


def _look_around(p: Params) -> list[Step]:
    def to(yaw: float, pitch: float) -> Pose:
        yaw *= p.amplitude
        return Pose(head=(0, pitch, 0.8 * yaw), spine=(0, 0, 0.25 * yaw), pelvis=(0, 0, 0.08 * yaw))

    one = [Step(0.8, to(0.9, 0.05)), Step(0.4, to(0.8, 0.0)), Step(1.2, to(-0.9, -0.05)), Step(0.4, to(-0.8, 0.05))]
    return one * p.count + [Step(0.8, STAND)]


def _tilt(p: Params) -> list[Step]:
    return there_and_back(Pose(head=(p.angle, 0.03, 0.1), spine=(0.04, 0, 0)), reach_s=0.6, hold_s=0.9, back_s=0.6)


HEAD = (
    Gesture(
        "nod", _nod, repeats=True,
        verbs=("[nod]", "[nod] the head", "[nod] yes", "[move] the head up and down", "[agree] with a nod"),
        keywords=("nod", "head up down", "say yes", "agree"),
    ),
    Gesture(
        "shake-head", _shake, repeats=True,
        verbs=("[shake] the head", "[shake] the head no", "[shake] your head", "[move] the head from side to side"),
        keywords=("shake head", "head side to side", "say no", "disagree"),
    ),
    Gesture(
        "look", _look, sides=("right", "left"), degrees=50, amplitudes=(0.3, 1.5),
        verbs=("[look] to the {side}", "[look] {side}", "[turn] the head to the {side}", "[glance] to the {side}"),
        keywords=("look left", "look right", "turn head", "glance"),
    ),
    Gesture(
        "look-up", _look_up, degrees=35, amplitudes=(0.4, 1.4),
        verbs=("[look] up", "[look] up at the sky", "[tip] the head back", "[raise] your eyes to the ceiling"),
        keywords=("look up", "tip head back", "eyes ceiling", "eyes sky"),
    ),
    Gesture(
        "look-down", _look_down, degrees=35, amplitudes=(0.4, 1.4),
        verbs=("[look] down", "[look] down at the floor", "[lower] the head", "[hang] your head"),
        keywords=("look down", "lower head", "hang head"),
    ),
    Gesture(
        "look-around", _look_around, repeats=True,
        verbs=("[look] around", "[take] a look around", "[look] all around", "[look] from one side to the other"),
        keywords=("look around", "look from side other", "search"),
    ),
    Gesture(
        "tilt-head", _tilt, sides=("right", "left"), degrees=20, amplitudes=(0.5, 1.6),
        verbs=("[tilt] the head to the {side}", "[tilt] your head {side}", "[tip] the head to the {side}",
               "[cock] the head to the {side}"),
        keywords=("tilt head", "tip head", "cock head"),
    ),
)  # fmt: skip
