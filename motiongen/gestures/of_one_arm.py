"""Gestures of one arm: signs to somebody else."""

from __future__ import annotations

import math

from motiongen.gestures.gesture import Gesture, Params
from motiongen.gestures.pose import STAND, Arm, Pose, Step, Vec, reach, straight, there_and_back

SIDES = ("right", "left")


def _wave(p: Params) -> list[Step]:
    def at(out: float) -> Pose:
        arm = Arm((0.25, 0.85, -0.20), (0.20, 0.15 + out * p.amplitude, 1.0))
        return Pose(right=arm, left=arm) if p.side == "both" else Pose(right=arm, spine=(0.03, 0, 0), head=(0.05, 0, 0))

    return [Step(0.75, at(0.5)), *[Step(0.30, at(-0.5)), Step(0.30, at(0.5))] * p.count, Step(0.8, STAND)]


def _raise_front(p: Params) -> list[Step]:
    return _held_up(p, (math.sin(p.angle), 0.08, -math.cos(p.angle)))


def _raise_side(p: Params) -> list[Step]:
    return _held_up(p, (0.0, math.sin(p.angle), -math.cos(p.angle)))


def _held_up(p: Params, way: Vec) -> list[Step]:
    arm = straight(way)
    pose = Pose(right=arm, left=arm) if p.side == "both" else Pose(right=arm, spine=(-0.03, 0, 0))
    return there_and_back(pose, reach_s=0.5 + 0.35 * p.amplitude, hold_s=1.2, back_s=0.6 + 0.35 * p.amplitude)


def _point(way: Vec, turn: float, pitch: float) -> list[Step]:
    """Through a bent elbow to the full stretch, as if throwing the hand there; the eyes go along."""
    x, y, z = way
    drawn = Pose(right=Arm((x, y, z - 0.7), (x + 0.3, y - 0.2, z + 0.3)), head=(0, pitch / 2, turn / 2))
    shown = Pose(right=straight(way), head=(0, pitch, turn), spine=(0, 0, turn * 0.25))
    return [Step(0.50, drawn, "launch"), Step(0.45, shown, "brake"), Step(1.1, shown), Step(1.05, STAND)]


def _point_side(p: Params) -> list[Step]:
    return _point((0.15, 1.0, 0.02), -0.6, 0.0)


def _point_forward(p: Params) -> list[Step]:
    return _point((1.0, 0.0, -0.02), 0.0, 0.0)


def _point_up(p: Params) -> list[Step]:
    return _point((0.18, 0.15, 1.0), 0.0, -0.4)


def _salute(p: Params) -> list[Step]:
    pose = Pose(right=reach((0.11, 0.14, 0.14), elbow=(0.25, 1.0, -0.15)), spine=(0, -0.04, 0))
    return there_and_back(pose, reach_s=0.6, hold_s=1.1, back_s=0.55)


def _stop(p: Params) -> list[Step]:
    arm = Arm((1.0, 0.22, -0.12), (1.0, -0.10, 0.10), wrist=(-1.2, 0.0))
    return there_and_back(Pose(right=arm, spine=(0, 0.02, 0.10)), reach_s=0.5, hold_s=1.3, back_s=0.8)


def _beckon(p: Params) -> list[Step]:
    out = Pose(right=Arm((0.75, 0.25, -0.65), (1.0, 0.05, 0.15)))
    near = Pose(right=Arm((0.60, 0.25, -0.80), (0.25, -0.10, 1.0), wrist=(0.5, 0.0)), head=(0, 0.06, 0))
    return [Step(0.65, out), *[Step(0.32, near), Step(0.36, out)] * p.count, Step(0.75, STAND)]


def _think(p: Params) -> list[Step]:
    pose = Pose(
        right=reach((0.15, 0.02, -0.02), elbow=(0.5, 0.1, -1.0)),
        left=reach((0.17, -0.11, -0.25), elbow=(-0.1, 0.6, -1.0)),
        head=(0.06, 0.14, -0.12),
        spine=(0, 0.05, 0),
    )
    lifted = Pose(right=pose.right, left=pose.left, head=(0.10, -0.10, 0.15), spine=(0, 0.02, 0))
    return [Step(0.9, pose), Step(1.1, pose), Step(0.8, lifted), Step(0.8, lifted), Step(0.9, STAND)]


def _facepalm(p: Params) -> list[Step]:
    pose = Pose(right=reach((0.20, 0.04, 0.10), elbow=(0.4, 0.5, -1.0)), head=(0, 0.40, 0), spine=(0, 0.10, 0))
    return [Step(0.6, pose), Step(1.0, pose), Step(0.8, STAND)]


def _heart(p: Params) -> list[Step]:
    pose = Pose(right=reach((0.17, 0.0, -0.14), elbow=(0, 0.7, -0.8)), head=(0, 0.12, 0))
    return there_and_back(pose, reach_s=0.75, hold_s=1.3, back_s=0.8)


def _listen(p: Params) -> list[Step]:
    hand = reach((0.03, 0.16, 0.16), elbow=(0.3, 1.0, -0.3))
    pose = Pose(right=hand, head=(0.14, 0.05, 0.35), spine=(0.10, 0.05, 0.1))
    return there_and_back(pose, reach_s=0.75, hold_s=1.3, back_s=0.8)


def _kiss(p: Params) -> list[Step]:
    lips = Pose(right=reach((0.21, 0.04, 0.05), elbow=(0.2, 0.5, -1.0)), head=(0, 0.08, 0))
    blown = Pose(right=Arm((0.75, 0.20, -0.35), (1.0, 0.10, 0.25)), head=(0, -0.05, 0), spine=(0, 0.05, 0))
    return [*[Step(0.7, lips), Step(0.25, lips), Step(0.5, blown)] * p.count, Step(0.4, blown), Step(0.8, STAND)]


def _watch(p: Params) -> list[Step]:
    pose = Pose(right=reach((0.24, -0.02, -0.12), elbow=(-0.1, 0.9, -0.6)), head=(0, 0.42, 0.05), spine=(0, 0.04, 0))
    return there_and_back(pose, reach_s=0.65, hold_s=1.1, back_s=0.75)


def _pump(p: Params) -> list[Step]:
    up = Pose(right=Arm((0.30, 0.45, 0.75), (0.15, 0.0, 1.0)), head=(0, -0.10, 0))
    down = Pose(right=Arm((0.30, 0.60, -0.70), (0.45, 0.05, 1.0)), spine=(0, 0.08, 0), head=(0, 0.05, 0))
    return [Step(0.45, down), *[Step(0.44, up), Step(0.42, down)] * p.count, Step(0.7, STAND)]


ONE_ARM = (
    Gesture(
        "wave", _wave, sides=("right", "left", "both"), repeats=True,
        verbs=("[wave] the {side} hand", "[wave] with the {side} hand", "[lift] the {side} arm and [wave]",
               "[wave] hello with the {side} hand", "[say] hello with the {side} hand"),
        both=("[wave] both hands", "[wave] with both hands", "[wave] both arms", "[wave] hello with both hands"),
        keywords=("wave", "hello", "goodbye", "greet"),
    ),
    Gesture(
        "raise-arm", _raise_front, sides=("right", "left", "both"), degrees=90, preposition="to", amplitudes=(0.3, 1.9),
        verbs=("[raise] and [hold] the {side} arm", "[raise] the {side} arm in front", "[lift] your {side} arm",
               "[hold] the {side} arm up"),
        both=("[raise] both arms in front", "[raise] and [hold] both arms", "[lift] both arms in front"),
        keywords=("raise arm", "raise hand", "lift arm", "hold arm up", "hand up", "hands up"),
    ),
    Gesture(
        "raise-arm-sideways", _raise_side, sides=("right", "left", "both"), degrees=90, preposition="to",
        amplitudes=(0.3, 1.85),
        verbs=("[raise] the {side} arm sideways", "[lift] the {side} arm out sideways",
               "[hold] the {side} arm out sideways"),
        both=("[raise] both arms sideways", "[lift] both arms out sideways", "[hold] both arms out sideways"),
        keywords=("raise arm sideways", "lift arm sideways", "arm sideways", "arm out to side", "hand sideways"),
    ),
    Gesture(
        "point", _point_side, sides=SIDES, amplitudes=(1, 1),
        verbs=("[point] to the {side}", "[point] {side}", "[point] over to the {side}", "[show] the way to the {side}"),
        keywords=("point", "show way"),
    ),
    Gesture(
        "point-forward", _point_forward, sides=SIDES, amplitudes=(1, 1),
        verbs=("[point] forward with the {side} hand", "[point] straight ahead with the {side} arm",
               "[point] at the viewer with the {side} hand", "[point] to the front with the {side} hand"),
        keywords=("point forward", "point ahead", "point viewer", "point at me", "point front"),
    ),
    Gesture(
        "point-up", _point_up, sides=SIDES, amplitudes=(1, 1),
        verbs=("[point] up with the {side} hand", "[point] at the sky with the {side} hand",
               "[point] upwards with the {side} arm", "[point] to the ceiling with the {side} hand"),
        keywords=("point up", "point sky", "point upwards", "point ceiling"),
    ),
    Gesture(
        "salute", _salute, sides=SIDES, amplitudes=(1, 1),
        verbs=("[salute] with the {side} hand", "[give] a salute with the {side} hand",
               "[salute] like a soldier with the {side} hand"),
        keywords=("salute",),
    ),
    Gesture(
        "stop-sign", _stop, sides=SIDES, amplitudes=(1, 1),
        verbs=("[signal] stop with the {side} hand", "[make] a stop sign with the {side} hand",
               "[hold] out the {side} palm to say stop", "[say] stop with the {side} hand"),
        keywords=("stop", "halt", "hold out palm"),
    ),
    Gesture(
        "beckon", _beckon, sides=SIDES, repeats=True, amplitudes=(1, 1),
        verbs=("[beckon] with the {side} hand", "[beckon] someone over with the {side} hand",
               "[say] come here with the {side} hand", "[call] someone over with the {side} hand"),
        keywords=("beckon", "come here", "call over", "come closer"),
    ),
    Gesture(
        "think", _think, sides=SIDES, amplitudes=(1, 1),
        verbs=("[think] with the {side} hand at the chin", "[put] the {side} hand to the chin and [think]",
               "[strike] a thinking pose with the {side} hand", "[ponder] with the {side} hand at the chin"),
        keywords=("think", "ponder", "hand chin", "wonder"),
    ),
    Gesture(
        "facepalm", _facepalm, sides=SIDES, amplitudes=(1, 1),
        verbs=("[facepalm] with the {side} hand", "[put] the {side} hand over the face",
               "[cover] the face with the {side} hand"),
        keywords=("facepalm", "hand face", "hand over face"),
    ),
    Gesture(
        "hand-on-heart", _heart, sides=SIDES, amplitudes=(1, 1),
        verbs=("[put] the {side} hand on the heart", "[lay] the {side} hand on the chest",
               "[place] your {side} hand over your heart"),
        keywords=("hand heart", "hand chest", "thank"),
    ),
    Gesture(
        "listen", _listen, sides=SIDES, amplitudes=(1, 1),
        verbs=("[listen] with the {side} hand at the ear", "[cup] the {side} hand behind the ear",
               "[put] the {side} hand to the ear to listen"),
        keywords=("listen", "hand ear"),
    ),
    Gesture(
        "blow-kiss", _kiss, sides=SIDES, repeats=True, amplitudes=(1, 1),
        verbs=("[blow] a kiss with the {side} hand", "[throw] a kiss with the {side} hand",
               "[send] a kiss with the {side} hand"),
        keywords=("kiss",),
    ),
    Gesture(
        "check-watch", _watch, sides=SIDES, amplitudes=(1, 1),
        verbs=("[look] at the watch on the {side} wrist", "[check] the time on the {side} wrist",
               "[check] the watch on the {side} arm"),
        keywords=("watch wrist", "check time", "check watch", "look at watch"),
    ),
    Gesture(
        "fist-pump", _pump, sides=SIDES, repeats=True, amplitudes=(1, 1),
        verbs=("[pump] the {side} fist", "[pump] the {side} fist in the air", "[do] a fist pump with the {side} arm"),
        keywords=("pump fist", "fist pump", "fist air"),
    ),
)  # fmt: skip
