"""Rigs whose joints all swing about their nominal pose while the root goes about, and where that puts their bodies."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate
from retarget.goals import Goal
from retarget.loops import moved
from retarget.menagerie import menagerie_file
from retarget.rig import Follow, Rig

FPS = 50.0
has_models = pytest.mark.skipif(
    not menagerie_file("unitree_g1/g1.xml").is_absolute(), reason="no robot models: the extra rigcast[robots]"
)
RIGS = ("puppet", "humanoid", *(pytest.param(name, marks=has_models) for name in ("unitree_g1", "robotis_op3")))


def nominal(rig: Rig) -> Array:
    return np.array([0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)], float)


def wandering(rig: Rig, seconds: float, seed: int) -> Array:
    """(T, 7 + nj): every joint swings within its range, below its speed, while the root goes about and turns."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * FPS) + 1) / FPS
    qpos = np.tile(nominal(rig), (len(t), 1))
    for i, joint in enumerate(rig.joints):
        rate, swing = rng.uniform(1, 2), min(0.2 * (joint.upper - joint.lower), 0.6)
        swing = min(swing, 0.5 * joint.velocity / rate)
        middle = np.clip(qpos[0, 7 + i], joint.lower + 1.1 * swing, joint.upper - 1.1 * swing)
        qpos[:, 7 + i] = middle + swing * np.sin(rate * t + rng.uniform(0, 6))
    qpos[:, :3] += 0.1 * np.sin(t[:, None] * rng.uniform(0.5, 1.5, 3))
    turn = np.zeros((len(t), 6 + len(rig.joints)))
    turn[:, 3:6] = 0.3 * np.sin(t[:, None] * rng.uniform(0.5, 1.5, 3))
    return moved(qpos, turn)


def goals_from(qpos: Array, model: mujoco.MjModel, bodies: dict[str, str], base: str = "") -> dict[str, Goal]:
    """Where `qpos` has bodies, by MuJoCo itself, as goals for them: human joint → body; in the frame of `base`."""
    data = mujoco.MjData(model)
    place, turn = np.empty((2, len(bodies), len(qpos), 3)), np.empty((2, len(bodies), len(qpos), 4))
    for frame, q in enumerate(qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for i, body in enumerate(bodies.values()):
            for j, name in enumerate((body, base or "world")):
                place[j, i, frame], turn[j, i, frame] = data.body(name).xpos, data.body(name).xquat
    out = {}
    for i, (human, body) in enumerate(bodies.items()):
        back = quat_conj(turn[1, i])
        pos, quat = quat_rotate(back, place[0, i] - place[1, i]), quat_mul(back, turn[0, i])
        out[human] = Goal(Follow(body, human, 1.0, 1.0), "pelvis" if base else "", pos, quat, np.ones(len(qpos)))
    return out
