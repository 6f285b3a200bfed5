"""Gestures of the trunk, feet standing where they are."""

from __future__ import annotations

from math import sin

from motiongen.gestures.gesture import Gesture, Params
from motiongen.gestures.pose import STAND, Arm, Pose, Step, Vec, there_and_back

LEFT_RIGHT = ("right", "left")


def _bent(angle: float, head: float = 0.0, right: Arm = STAND.right, left: Arm = STAND.left) -> Pose:
    """Bent forward by `angle` radians, most of it in the hips, which go back to keep the weight over the feet."""
    shift = (-0.14 * sin(angle), 0.0, -0.02 * angle)
    return Pose(right, left, (0, head, 0), (0, 0.4 * angle, 0), (0, 0.6 * angle, 0), shift)


def _bow(p: Params) -> list[Step]:
    a = p.angle
    hanging = Arm(
        (sin(a), 0.12, -1.0), (sin(a) + 0.1, 0.06, -1.0)
    )  # hands stay near the thighs: they hang in the world
    low = _bent(a, head=0.1, right=hanging, left=hanging)
    return [Step(0.7 + 0.5 * a, low), Step(0.6, low), Step(0.9 + 0.5 * a, STAND)] * p.count


def _lean_forward(p: Params) -> list[Step]:
    return there_and_back(_bent(p.angle, head=-0.6 * p.angle), reach_s=0.9, hold_s=1.1, back_s=0.9)


def _lean_back(p: Params) -> list[Step]:
    a = p.angle
    pose = Pose(head=(0, 0.4 * a, 0), spine=(0, -0.65 * a, 0), pelvis=(0, -0.35 * a, 0), shift=(0.07 * a, 0, -0.06 * a))
    return there_and_back(pose, reach_s=0.9, hold_s=1.0, back_s=0.9)


def _lean(p: Params) -> list[Step]:
    a = p.angle
    pose = Pose(head=(-0.4 * a, 0, 0), spine=(0.8 * a, 0, 0), pelvis=(0.2 * a, 0, 0), shift=(0, 0.05 * a, -0.03 * a))
    return there_and_back(pose, reach_s=0.9, hold_s=1.1, back_s=0.9)


def _twist(p: Params) -> list[Step]:
    a = p.angle
    arm = Arm((0.35, 0.45, -0.9), (1.0, -0.25, 0.1))
    pose = Pose(arm, arm, head=(0, 0, -0.2 * a), spine=(0, 0, -0.75 * a), pelvis=(0, 0, -0.25 * a))
    return there_and_back(pose, reach_s=0.9, hold_s=0.9, back_s=0.9)


def _sway(p: Params) -> list[Step]:
    def to(way: float) -> Pose:
        far: Vec = (0, -0.06 * way * p.amplitude, -0.012 * p.amplitude)
        return Pose(
            head=(-0.04 * way, 0, 0), spine=(-0.06 * way, 0, 0), pelvis=(0.07 * way * p.amplitude, 0, 0), shift=far
        )

    return [Step(0.55, to(-1.0)), *[Step(0.75, to(1.0)), Step(0.75, to(-1.0))] * p.count, Step(0.6, STAND)]


def _idle(p: Params) -> list[Step]:
    """Weight from one leg to the other, a glance, back."""
    on_right = Pose(
        head=(-0.03, 0.03, 0.18), spine=(-0.02, 0.02, 0), pelvis=(-0.03, 0, 0.03), shift=(0, -0.035, -0.006)
    )
    on_left = Pose(head=(0.03, -0.03, -0.12), spine=(0.02, 0, 0), pelvis=(0.03, 0, -0.02), shift=(0.005, 0.03, -0.006))
    return [Step(1.2, on_right), Step(1.4, on_right), Step(1.5, on_left), Step(1.0, on_left), Step(1.2, STAND)]


TRUNK = (
    Gesture(
        "bow", _bow, repeats=True, degrees=40, amplitudes=(0.25, 1.75),
        verbs=("[bow]", "[take] a bow", "[bow] politely", "[bend] forward in a bow"),
        keywords=("bow",),
    ),
    Gesture(
        "lean-forward", _lean_forward, degrees=20, amplitudes=(0.5, 1.75),
        verbs=("[lean] forward", "[lean] to the front", "[lean] the body forward", "[lean] in"),
        keywords=("lean forward", "lean front", "lean in", "bend forward"),
    ),
    Gesture(
        "lean-back", _lean_back, degrees=12, amplitudes=(0.5, 1.5),
        verbs=("[lean] back", "[lean] backwards", "[lean] the body back"),
        keywords=("lean back", "lean backward", "lean backwards", "bend back"),
    ),
    Gesture(
        "lean", _lean, sides=LEFT_RIGHT, degrees=15, amplitudes=(0.5, 1.6),
        verbs=("[lean] to the {side}", "[lean] {side}", "[lean] over to the {side}", "[bend] sideways to the {side}"),
        keywords=("lean left", "lean right", "bend sideways", "bend left", "bend right", "lean"),
    ),
    Gesture(
        "twist", _twist, sides=LEFT_RIGHT, degrees=40, amplitudes=(0.4, 1.4),
        verbs=("[twist] to the {side}", "[twist] the body to the {side}", "[twist] {side}",
               "[turn] the upper body to the {side}"),
        keywords=("twist", "turn body", "turn upper body"),
    ),
    Gesture(
        "sway-hips", _sway, repeats=True,
        verbs=("[sway]", "[sway] the hips", "[sway] the hips from side to side", "[swing] your hips"),
        keywords=("sway", "swing hips"),
    ),
    Gesture(
        "idle", _idle, amplitudes=(1, 1),
        verbs=("[stand] idle", "[idle]", "[wait]", "[stand] and [wait]", "[stand] around", "[do] nothing"),
        keywords=("idle", "wait", "stand around", "nothing", "stand still", "stand"),
    ),
)  # fmt: skip
