"""Synthetic human motions with known answers: a skeleton of 1.66 m, standing, waving, squatting, walking, flailing.

And what several tests look at a motion with.
"""

from __future__ import annotations

import numpy as np

from motiongen.measure.clip import observe
from motiongen.motion import SMPL_JOINTS, SMPL_PARENTS, Label, Motion, Skeleton, Source
from motiongen.rotation import Array, axis_angle_to_quat, quat_mul, quat_rotate
from motiongen.text.claims import Asked, Claim, holds

FORWARD, LEFT, UP = np.eye(3)
THIGH, SHIN = 0.40, 0.41

_OFFSETS = {
    "left_hip": (0, 0.09, -0.04),
    "left_knee": (0, 0, -THIGH),
    "left_ankle": (0, 0, -SHIN),
    "left_foot": (0.14, 0, -0.06),
    "spine1": (0, 0, 0.10),
    "spine2": (0, 0, 0.14),
    "spine3": (0, 0, 0.06),
    "neck": (0, 0, 0.22),
    "head": (0, 0, 0.09),
    "left_collar": (0, 0.05, 0.12),
    "left_shoulder": (0, 0.13, 0),
    "left_elbow": (0, 0.27, 0),
    "left_wrist": (0, 0.25, 0),
}


def skeleton() -> Skeleton:
    """The canonical 22 joints; ankles 0.08 m and toes 0.02 m above the sole."""
    rows = []
    for name in SMPL_JOINTS:
        x, y, z = _OFFSETS.get(name.replace("right", "left"), (0, 0, 0))
        rows.append((x, -y if name.startswith("right") else y, z))
    return Skeleton(SMPL_JOINTS, SMPL_PARENTS, np.array(rows))


def motion(seconds: float, fps: float, turns: dict[str, Array], text: str, root: Array | None = None) -> Motion:
    """Arms hanging (T-pose turned down at the shoulders), with `turns` (T, 4) put in front of that joint by joint.

    `root` (T, 3) is the path of the pelvis; without it the lower ankle is kept at its standing height over the origin.
    """
    body = skeleton()
    count = round(seconds * fps) + 1
    quat = np.zeros((count, len(body.names), 4))
    quat[..., 0] = 1
    for side, sign in (("left", -1), ("right", 1)):
        quat[:, body.index(f"{side}_shoulder")] = axis_angle_to_quat(FORWARD, sign * 1.4)
    for name, turn in turns.items():
        quat[:, body.index(name)] = quat_mul(turn, quat[:, body.index(name)])
    pos = np.zeros((count, 3)) if root is None else np.array(root, float)
    draft = Motion(pos, quat, fps, body)
    low = draft.positions()[:, [body.index("left_ankle"), body.index("right_ankle")], 2].min(1)
    pos[:, 2] += body.foot_height[0] - low
    return Motion(pos, quat, fps, body, (Label(0.0, (count - 1) / fps, text),), Source("synthetic", seed=0))


def _times(seconds: float, fps: float) -> Array:
    return np.arange(round(seconds * fps) + 1) / fps


def stand(seconds: float = 1.0, fps: float = 30) -> Motion:
    """Standing still, arms hanging."""
    return motion(seconds, fps, {}, "stand")


def wave(side: str = "right", seconds: float = 4, fps: float = 30) -> Motion:
    """One upper arm lifted level to the side, its forearm up and swinging over ±0.4 rad at 1 Hz."""
    t = _times(seconds, fps)
    out = 1.0 if side == "left" else -1.0
    lift = np.clip(np.minimum(t, seconds - t) / 0.8, 0, 1)
    lift = lift * lift * (3 - 2 * lift)
    swing = 1.3 + 0.4 * np.sin(2 * np.pi * t)
    turns = {
        f"{side}_shoulder": axis_angle_to_quat(FORWARD, out * 1.4 * lift),
        f"{side}_elbow": axis_angle_to_quat(FORWARD, out * swing * lift),
    }
    return motion(seconds, fps, turns, f"wave with the {side} hand")


def squat(seconds: float = 3, fps: float = 30) -> Motion:
    """Down and up once with flat feet and arms stretched forward: shins and thighs turn by up to 0.9 rad."""
    bend = 0.45 * (1 - np.cos(2 * np.pi * _times(seconds, fps) / seconds))
    arms = np.clip(bend * 1.5, 0, 1.2)
    turns = {f"{side}_shoulder": axis_angle_to_quat(LEFT, -arms) for side in ("left", "right")}
    for side in ("left", "right"):
        turns[f"{side}_hip"] = axis_angle_to_quat(LEFT, -bend)
        turns[f"{side}_knee"] = axis_angle_to_quat(LEFT, 2 * bend)
        turns[f"{side}_ankle"] = axis_angle_to_quat(LEFT, -bend)
    return motion(seconds, fps, turns, "squat")


def walk(speed: float = 1.2, seconds: float = 4, fps: float = 30) -> Motion:
    """Walking forward at `speed` m/s: 1 s a stride, feet flat and still for just over half of it, arms swinging."""
    t = _times(seconds, fps)
    body = skeleton()
    stride = speed * 1.0
    root = np.stack([speed * t, 0.02 * np.sin(2 * np.pi * t), np.full_like(t, 0.93 - 0.06 * speed / 1.2)], 1)
    turns: dict[str, Array] = {}
    for side, phase, out in (("left", 0.0, 1), ("right", 0.5, -1)):
        step, u = np.divmod(t + phase, 1.0)
        swing = np.clip((u - 0.55) / 0.45, 0, 1)
        ease = swing * swing * (3 - 2 * swing)
        ankle = np.stack(
            [(step - phase + 0.275 + ease) * stride, np.full_like(t, 0.09 * out), 0.08 + 0.10 * np.sin(np.pi * ease)], 1
        )
        hip = root + body.offsets[body.index(f"{side}_hip")]
        turns |= _leg(side, ankle - hip)
        turns[f"{side}_shoulder"] = axis_angle_to_quat(LEFT, 0.35 * np.cos(2 * np.pi * (t + phase)))
    quat = motion(seconds, fps, turns, "").joint_quat
    return Motion(root, quat, fps, body, (Label(0.0, seconds, "walk forward"),), Source("synthetic", seed=0))


def _leg(side: str, reach: Array) -> dict[str, Array]:
    """Hip, knee and ankle turns for a sole that is level, the ankle at `reach` (T, 3) from the hip: law of cosines."""
    length = np.linalg.norm(reach, axis=1)
    knee = np.pi - np.arccos(np.clip((THIGH**2 + SHIN**2 - length**2) / (2 * THIGH * SHIN), -1, 1))
    lean = np.arctan2(reach[:, 1], -reach[:, 2])
    pitch = -np.arcsin(np.clip(reach[:, 0] / length, -1, 1)) - np.arctan2(
        SHIN * np.sin(knee), THIGH + SHIN * np.cos(knee)
    )
    hip = quat_mul(axis_angle_to_quat(FORWARD, lean), axis_angle_to_quat(LEFT, pitch))
    bent = axis_angle_to_quat(LEFT, knee)
    down = quat_mul(hip, bent)
    return {f"{side}_hip": hip, f"{side}_knee": bent, f"{side}_ankle": down * np.array([1.0, -1.0, -1.0, -1.0])}


def flail(seconds: float = 2, fps: float = 30, rate: float = 2.0) -> Motion:
    """Harsh: both arms whirl `rate` turns a second about the left axis, elbows pump, the head shakes."""
    t = _times(seconds, fps)
    whirl = axis_angle_to_quat(LEFT, 2 * np.pi * rate * t)
    pump = np.sin(6 * np.pi * rate * t) + 1
    turns = {"left_shoulder": whirl, "right_shoulder": whirl, "head": axis_angle_to_quat(UP, 2 * np.sin(9 * t))}
    turns |= {"left_elbow": axis_angle_to_quat(UP, -pump), "right_elbow": axis_angle_to_quat(UP, pump)}
    return motion(seconds, fps, turns, "flail")


def turned(clip: Motion, yaw: float, shift: Array) -> Motion:
    """The same clip facing another way from another place."""
    turn = axis_angle_to_quat(UP, yaw)
    quat = clip.joint_quat.copy()
    quat[:, 0] = quat_mul(turn, quat[:, 0])
    return Motion(quat_rotate(turn, clip.root_pos) + shift, quat, clip.fps, clip.skeleton, clip.labels, clip.source)


def a_motion(frames: int = 7, *, contacts: bool = True) -> Motion:
    """Random turns of every joint and a random walk of the root."""
    rng = np.random.default_rng(3)
    offsets = rng.normal(0, 0.2, (22, 3))
    offsets[0] = 0
    quat = rng.normal(size=(frames, 22, 4))
    quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
    return Motion(
        root_pos=rng.normal(size=(frames, 3)),
        joint_quat=quat,
        fps=30.0,
        skeleton=Skeleton(SMPL_JOINTS, SMPL_PARENTS, offsets, (0.11, 0.04)),
        labels=(Label(0.0, 0.2, "wäve", ("right_arm",)), Label(0.1, 0.2, 'say "hi", twice')),
        source=Source("mdm", "abc123", 7, "CC BY-NC 4.0"),
        contacts=rng.random((frames, 4)) < 0.5 if contacts else None,
    )


def at(motion: Motion, joint: str) -> Array:
    """World path (T, 3) of a joint."""
    return motion.positions()[:, motion.skeleton.index(joint)]


def excursions(signal: Array, high: float, low: float) -> int:
    """How often a signal rises over `high` after having been under `low`."""
    count, armed = 0, True
    for value in signal:
        if armed and value > high:
            count, armed = count + 1, False
        armed = armed or value < low
    return count


def does(asked: Asked | Claim, motion: Motion) -> bool:
    return holds(asked if isinstance(asked, Asked) else Asked((asked,)), observe(motion))
