"""Legs that stand where the feet are, wherever the pelvis goes: two bones, in closed form."""

from __future__ import annotations

import numpy as np

from motiongen.gestures.body import ANKLE_HEIGHT, BODY, SHIN, STANCE, THIGH, TOES
from motiongen.rotation import Array, axis_angle_to_quat, matrix_to_quat, quat_conj, quat_mul, quat_rotate, yaw_quat

FORWARD, LEFT = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def leg(side: str, pelvis: Array, pelvis_quat: Array, foot: Array) -> tuple[Array, Array, Array, Array]:
    """Local turns (T, 4) of hip, knee, ankle and toes of `side` that put the foot where it is to be.

    `pelvis` (T, 3) in metres and `pelvis_quat` (T, 4) in the world; `foot` (T, 5): x, y, z in metres from where the
    foot stands at first, pitch and yaw in radians, as in `pose.Foot` but with y to the left. The knee bends forward, as
    in Winter, Biomechanics and Motor Control of Human Movement (law of cosines). Raises ValueError where a foot is out
    of reach.
    """
    ankle, ankle_quat = _ankle(1.0 if side == "left" else -1.0, foot)
    hip = pelvis + quat_rotate(pelvis_quat, BODY.offsets[BODY.index(f"{side}_hip")])
    line = ankle - hip
    far = np.linalg.norm(line, axis=1)
    if far.max() > THIGH + SHIN:
        raise ValueError(f"the {side} foot is {far.max():.3f} m from its hip; the leg is {THIGH + SHIN:.3f} m long")
    line = line / far[:, None]
    knee = np.pi - np.arccos(np.clip((THIGH**2 + SHIN**2 - far**2) / (2 * THIGH * SHIN), -1.0, 1.0))
    lead = np.arctan2(SHIN * np.sin(knee), THIGH + SHIN * np.cos(knee))  # thigh before the line from hip to ankle

    # The leg's own frame: z up the line from ankle to hip, y across. The thigh is turned in it about y.
    across = _unit(np.cross(-line, _forward(pelvis_quat, foot[:, 4])))
    frame = matrix_to_quat(np.stack([np.cross(across, -line), across, -line], axis=-1))
    thigh = quat_mul(frame, axis_angle_to_quat(LEFT, -lead))
    bent = axis_angle_to_quat(LEFT, knee)
    shin = quat_mul(thigh, bent)
    toes = axis_angle_to_quat(LEFT, -np.maximum(foot[:, 3], 0.0))  # stay flat while the heel lifts
    return quat_mul(quat_conj(pelvis_quat), thigh), bent, quat_mul(quat_conj(shin), ankle_quat), toes


def touching(foot: Array) -> tuple[np.ndarray, np.ndarray]:
    """Booleans (T,) each: ankle and toes of a `foot` (T, 5), see `leg`, are as low as on a flat sole."""
    down = np.abs(foot[:, 2]) < 1e-4
    return down & (np.abs(foot[:, 3]) < 1e-3), down


def _ankle(out: float, foot: Array) -> tuple[Array, Array]:
    """World position (T, 3) and orientation (T, 4) of the ankle; toes-down pitch pivots on the ball of the foot."""
    yaw = yaw_quat(foot[:, 4])
    turn = quat_mul(yaw, axis_angle_to_quat(LEFT, foot[:, 3]))
    stands = np.array([0.0, out * STANCE, ANKLE_HEIGHT]) + foot[:, :3]
    ball = np.array(TOES)
    on_ball = stands + quat_rotate(yaw, ball) - quat_rotate(turn, ball)
    return np.where(foot[:, 3:4] > 0, on_ball, stands), turn


def _forward(pelvis_quat: Array, yaw: Array) -> Array:
    """(T, 3): forward half-way between the foot's and the pelvis's: knees follow both."""
    return _unit(quat_rotate(yaw_quat(yaw), FORWARD) + quat_rotate(pelvis_quat, FORWARD))


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
