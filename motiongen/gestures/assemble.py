"""From steps to a `Motion`: channels to joints, life added, legs under it; and the mirror image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from motiongen.gestures import life
from motiongen.gestures.body import BODY, STANDING
from motiongen.gestures.legs import FORWARD, leg, touching
from motiongen.gestures.pose import Step
from motiongen.gestures.track import Track, length, play
from motiongen.motion import Motion
from motiongen.rotation import (
    Array,
    axis_angle_to_quat,
    quat_conj,
    quat_continuous,
    quat_mul,
    rotvec_to_quat,
    slerp,
)

# rad of drift of a joint; hands drift by what their arm does.
DRIFT = {"pelvis": 0.004, "spine": 0.006, "head": 0.015, "right_shoulder": 0.012, "left_shoulder": 0.012}
UNEVEN = 0.04  # people do not keep time to better than this share of a step


def assemble(
    steps: Sequence[Step], *, speed: float, fps: float, rng: np.random.Generator, seconds: float | None = None
) -> Motion:
    """`steps`, see `track.play`, as motion of the body, with breath, drift and uneven timing drawn from `rng`.

    `seconds`: stand on to the end until the motion is as long. Raises ValueError where the steps alone take longer, or
    ask for what no leg can reach.
    """
    uneven = [replace(step, seconds=step.seconds * rng.uniform(1 - UNEVEN, 1 + UNEVEN)) for step in steps]
    if seconds is not None:
        left = seconds - length(uneven, speed)
        if left < 0:
            raise ValueError(f"{seconds:g} seconds; this gesture takes {seconds - left:.2f}")
        uneven.append(Step(left * speed, uneven[-1].pose))
    track = play(uneven, speed, fps)
    count = len(track.shift)
    quat = np.zeros((count, len(BODY.names), 4))
    quat[..., 0] = 1

    breath = life.breath(count, fps, rng)
    sway = life.drift(count, fps, life.SWAY, rng) * [1.0, 1.0, 0.0]
    root = track.shift + sway + [0.0, 0.0, STANDING]
    _trunk(quat, track, breath, rng, fps)
    for i, (side, out) in enumerate((("right", -1.0), ("left", 1.0))):
        shrug = axis_angle_to_quat(FORWARD, out * (track.shrug + life.SHOULDERS * breath))
        quat[:, BODY.index(f"{side}_collar")] = shrug
        shoulder = _drifting(track.shoulder[i], f"{side}_shoulder", rng, fps)
        quat[:, BODY.index(f"{side}_shoulder")] = quat_mul(quat_conj(shrug), shoulder)
        quat[:, BODY.index(f"{side}_elbow")] = track.elbow[i]
        quat[:, BODY.index(f"{side}_wrist")] = track.wrist[i]
        names = (f"{side}_hip", f"{side}_knee", f"{side}_ankle", f"{side}_foot")
        for name, turn in zip(names, leg(side, root, quat[:, 0], track.feet[i]), strict=True):
            quat[:, BODY.index(name)] = turn
    contacts = np.stack([*touching(track.feet[1]), *touching(track.feet[0])], axis=1)
    return Motion(root, quat_continuous(quat), fps, BODY, contacts=contacts)


def mirrored(motion: Motion) -> Motion:
    """Left and right exchanged. Raises ValueError where a joint has no partner."""
    names = motion.skeleton.names
    partner = [motion.skeleton.index(_other(name)) for name in names]
    quat = motion.joint_quat[:, partner] * np.array([1.0, -1.0, 1.0, -1.0])
    contacts = None if motion.contacts is None else motion.contacts[:, [2, 3, 0, 1]]
    return replace(motion, root_pos=motion.root_pos * [1.0, -1.0, 1.0], joint_quat=quat, contacts=contacts)


def _other(name: str) -> str:
    for side, other in (("left_", "right_"), ("right_", "left_")):
        if name.startswith(side):
            return other + name.removeprefix(side)
    return name


def _trunk(quat: Array, track: Track, breath: Array, rng: np.random.Generator, fps: float) -> None:
    """Write pelvis, spine and head into `quat`: the spine's turn in thirds, the head's half in the neck."""
    still = np.array([1.0, 0.0, 0.0, 0.0])
    quat[:, 0] = _drifting(track.pelvis, "pelvis", rng, fps)
    spine = _drifting(track.spine, "spine", rng, fps)
    for name in ("spine1", "spine2", "spine3"):
        quat[:, BODY.index(name)] = slerp(still, spine, 1 / 3)
    inhaled = axis_angle_to_quat([0.0, 1.0, 0.0], -life.CHEST * breath)
    quat[:, BODY.index("spine3")] = quat_mul(quat[:, BODY.index("spine3")], inhaled)
    head = _drifting(track.head, "head", rng, fps)
    for name in ("neck", "head"):
        quat[:, BODY.index(name)] = slerp(still, head, 1 / 2)


def _drifting(turn: Array, name: str, rng: np.random.Generator, fps: float) -> Array:
    return quat_mul(rotvec_to_quat(life.drift(len(turn), fps, DRIFT[name], rng)), turn)
