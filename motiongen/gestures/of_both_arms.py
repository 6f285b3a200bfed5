"""Gestures of both arms together."""

from __future__ import annotations

from motiongen.gestures.gesture import Gesture, Params
from motiongen.gestures.pose import STAND, Arm, Pose, Step, Vec, reach, straight, there_and_back


def _both(arm: Arm, head: Vec = (0, 0, 0), spine: Vec = (0, 0, 0), shrug: float = 0.0) -> Pose:
    return Pose(right=arm, left=arm, head=head, spine=spine, shrug=shrug)


def _clap(p: Params) -> list[Step]:
    apart = _both(reach((0.29, 0.06 + 0.11 * p.amplitude, -0.12), elbow=(-0.3, 0.7, -0.9)))
    together = _both(reach((0.31, 0.03, -0.12), elbow=(-0.3, 0.7, -0.9)))
    return [Step(0.65, apart), *[Step(0.17, together), Step(0.21, apart)] * p.count, Step(0.70, STAND)]


def _shrug(p: Params) -> list[Step]:
    open_hands = Arm((0.05, 0.35, -1.0), (0.75, 0.75, 0.05), wrist=(0.0, 1.0))
    up = _both(open_hands, head=(0.12, 0.02, 0), shrug=0.38 * p.amplitude)
    down = _both(Arm((0.05, 0.25, -1.0), (0.6, 0.5, -0.5)), shrug=0.02)
    return [*[Step(0.50, up), Step(0.45, up), Step(0.40, down)] * p.count, Step(0.45, STAND)]


def _hips(p: Params) -> list[Step]:
    pose = _both(reach((0.04, 0.19, -0.29), elbow=(-0.25, 1.0, 0.0)), spine=(0, -0.04, 0))
    return there_and_back(pose, reach_s=0.8, hold_s=1.6, back_s=0.8)


def _cross(p: Params) -> list[Step]:
    near, far = reach((0.19, -0.11, -0.19), elbow=(0.0, 0.6, -1.0)), reach((0.25, -0.09, -0.21), elbow=(0.0, 0.6, -1.0))
    opened = _both(Arm((0.35, 0.35, -0.9), (0.8, -0.1, 0.1)))
    folded = Pose(right=far, left=near, spine=(0, -0.03, 0), head=(0, 0.03, 0))
    return [Step(0.55, opened, "launch"), Step(0.55, folded, "brake"), Step(1.6, folded), Step(0.9, STAND)]


def _stretch(p: Params) -> list[Step]:
    up = _both(
        Arm((0.05, 0.22, 1.0), (0.0, 0.02, 1.0)), head=(0, -0.15, 0), spine=(0, -0.10 * p.amplitude, 0), shrug=0.3
    )
    aside = _both(Arm((0.05, 0.85, -0.05), (-0.05, 1.0, 0.05)), spine=(0, -0.05, 0))
    return [Step(1.3, up), Step(1.0, up), Step(1.0, aside), Step(0.8, STAND)]


def _celebrate(p: Params) -> list[Step]:
    high = _both(Arm((0.10, 0.55, 0.9), (0.10, 0.25, 1.0)), head=(0, -0.15, 0), spine=(0, -0.06, 0))
    low = _both(Arm((0.25, 0.75, 0.25), (0.15, 0.10, 1.0)), head=(0, -0.05, 0))
    dip = Pose(right=low.right, left=low.left, head=low.head, shift=(0, 0, -0.03 * p.amplitude))
    return [Step(0.75, high), *[Step(0.38, dip), Step(0.38, high)] * p.count, Step(0.4, high), Step(0.85, STAND)]


def _t_pose(p: Params) -> list[Step]:
    return there_and_back(_both(straight((0.0, 1.0, 0.0), (1, 0, 0))), reach_s=0.9, hold_s=1.5, back_s=0.9)


def _zombie(p: Params) -> list[Step]:
    pose = _both(Arm((1.0, 0.05, -0.05), (1.0, -0.03, 0.0)), head=(0.08, 0.05, 0))
    return there_and_back(pose, reach_s=0.9, hold_s=1.5, back_s=0.9)


def _flap(p: Params) -> list[Step]:
    up = _both(Arm((0.0, 1.0, 0.55 * p.amplitude), (0.45, 1.0, 0.15)), head=(0, -0.04, 0))
    down = _both(Arm((0.05, 0.8, -0.75 * p.amplitude), (0.45, 0.8, -0.45)), head=(0, 0.03, 0))
    return [Step(0.60, up), *[Step(0.40, down), Step(0.40, up)] * p.count, Step(0.75, STAND)]


def _conduct(p: Params) -> list[Step]:
    """Four in a bar: down, in, out, up."""

    def hands(out: float, up: float, nod: float) -> Step:
        arm = reach((0.30, 0.19 + 0.08 * out * p.amplitude, -0.10 + 0.12 * up * p.amplitude), elbow=(-0.3, 0.8, -0.9))
        return Step(0.38, _both(arm, head=(0, nod, 0)))

    bar = [hands(0.0, -1.0, 0.07), hands(-1.0, 0.0, 0.0), hands(1.2, 0.0, 0.0), hands(0.2, 1.3, -0.04)]
    return [hands(0.2, 1.3, 0.0), *bar * p.count, Step(0.75, STAND)]


def _rub(p: Params) -> list[Step]:
    def at(shift: float) -> Pose:
        right, left = (reach((0.27 + s, 0.03, -0.20), elbow=(-0.3, 0.8, -0.9)) for s in (shift, -shift))
        return Pose(right=right, left=left, head=(0, 0.12, 0), spine=(0, 0.05, 0))

    ahead, back = at(0.04 * p.amplitude), at(-0.04 * p.amplitude)
    return [Step(0.70, ahead), *[Step(0.20, back), Step(0.20, ahead)] * p.count, Step(0.75, STAND)]


def _pray(p: Params) -> list[Step]:
    pose = _both(reach((0.24, 0.025, -0.10), elbow=(-0.2, 0.9, -1.0)), head=(0, 0.30, 0), spine=(0, 0.06, 0))
    return there_and_back(pose, reach_s=0.9, hold_s=1.6, back_s=0.9)


def _welcome(p: Params) -> list[Step]:
    pose = _both(
        Arm((0.40, 0.75, -0.65), (0.60, 0.80, -0.05), wrist=(0.0, 1.2)), head=(0, -0.04, 0), spine=(0, -0.03, 0)
    )
    return there_and_back(pose, reach_s=0.8, hold_s=1.2, back_s=0.85)


def _swing(p: Params) -> list[Step]:
    ahead = Arm((0.75 * p.amplitude, 0.12, -1.0), (1.0 * p.amplitude, 0.05, -0.8))
    behind = Arm((-0.50 * p.amplitude, 0.14, -1.0), (-0.25 * p.amplitude, 0.10, -1.0))
    first = Pose(right=ahead, left=behind, spine=(0, 0, 0.12))
    second = Pose(right=behind, left=ahead, spine=(0, 0, -0.12))
    return [Step(0.45, first), *[Step(0.50, second), Step(0.50, first)] * p.count, Step(0.45, STAND)]


BOTH_ARMS = (
    Gesture(
        "clap", _clap, repeats=True,
        verbs=("[clap]", "[clap] the hands", "[clap] your hands", "[applaud] and [clap]"),
        keywords=("clap", "applaud"),
    ),
    Gesture(
        "shrug", _shrug, repeats=True,
        verbs=("[shrug]", "[shrug] the shoulders", "[shrug] your shoulders", "[lift] the shoulders in a shrug"),
        keywords=("shrug", "lift shoulders"),
    ),
    Gesture(
        "hands-on-hips", _hips, amplitudes=(1, 1),
        verbs=("[put] the hands on the hips", "[stand] with hands on hips", "[rest] both hands on the hips"),
        keywords=("hands hips", "akimbo"),
    ),
    Gesture(
        "cross-arms", _cross, amplitudes=(1, 1),
        verbs=("[cross] the arms", "[fold] the arms", "[cross] your arms over the chest", "[stand] with crossed arms"),
        keywords=("cross arms", "fold arms"),
    ),
    Gesture(
        "stretch", _stretch, amplitudes=(0.5, 1.4),
        verbs=("[stretch]", "[stretch] the arms overhead", "[do] a stretch", "[stretch] upwards"),
        keywords=("stretch",),
    ),
    Gesture(
        "celebrate", _celebrate, repeats=True,
        verbs=("[celebrate]", "[cheer] with both arms", "[throw] the arms up and [cheer]", "[celebrate] a win"),
        keywords=("celebrate", "cheer", "hooray", "victory"),
    ),
    Gesture(
        "t-pose", _t_pose, amplitudes=(1, 1),
        verbs=("[stand] in a T-pose", "[make] a T-pose", "[hold] a T-pose", "[go] into a T pose"),
        keywords=("t pose", "tpose"),
    ),
    Gesture(
        "arms-forward", _zombie, amplitudes=(1, 1),
        verbs=("[hold] both arms out like a zombie", "[stretch] the arms forward", "[hold] the arms out forward",
               "[reach] both arms forward"),
        keywords=("zombie", "arms forward", "arms stretch forward", "sleepwalk"),
    ),
    Gesture(
        "flap-arms", _flap, repeats=True, amplitudes=(0.5, 1.2),
        verbs=("[flap] the arms", "[flap] the arms like a bird", "[flap] your arms like wings"),
        keywords=("flap", "like bird", "wings"),
    ),
    Gesture(
        "conduct", _conduct, repeats=True, unit="bars",
        verbs=("[conduct]", "[conduct] an orchestra", "[conduct] the music", "[beat] time like a conductor"),
        keywords=("conduct", "conductor", "orchestra", "beat time"),
    ),
    Gesture(
        "rub-hands", _rub, repeats=True,
        verbs=("[rub] the hands", "[rub] the hands together", "[rub] your hands together"),
        keywords=("rub hands",),
    ),
    Gesture(
        "pray", _pray, amplitudes=(1, 1),
        verbs=("[pray]", "[fold] the hands in prayer", "[put] the palms together and [pray]", "[hold] hands in prayer"),
        keywords=("pray", "prayer", "palms together", "namaste"),
    ),
    Gesture(
        "welcome", _welcome, amplitudes=(1, 1),
        verbs=("[open] the arms in welcome", "[spread] the arms in welcome", "[welcome] someone with open arms"),
        keywords=("welcome", "open arms", "spread arms"),
    ),
    Gesture(
        "swing-arms", _swing, repeats=True,
        verbs=("[swing] the arms", "[swing] both arms back and forth", "[swing] your arms back and forth"),
        keywords=("swing arms",),
    ),
)  # fmt: skip
