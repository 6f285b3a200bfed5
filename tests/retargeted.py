"""The synthetic motions retargeted once for all tests, and where that puts a rig."""

from __future__ import annotations

from functools import cache

import motions
import mujoco
import numpy as np

from motiongen.motion import Motion
from motiongen.rotation import Array
from retarget.model import load_model
from retarget.retarget import retarget
from retarget.rig import Mount, load_rig
from retarget.trajectory import Trajectory

RIGS = ("puppet", "humanoid")
CLIPS = {
    "stand": motions.stand,
    "wave": motions.wave,
    "wave left": lambda: motions.wave("left"),
    "squat": motions.squat,
    "walk": motions.walk,
    "flail": motions.flail,
}


@cache
def done(rig: str, clip: str, mount: Mount | None = None) -> Trajectory:
    return retarget(CLIPS[clip](), load_rig(rig), mount=mount)


def sites(trajectory: Trajectory, *names: str) -> Array:
    """(T, len(names), 3) world positions of sites or, where there is no such site, body origins."""
    model = load_model(load_rig(trajectory.rig))
    data = mujoco.MjData(model)
    out = np.empty((len(trajectory), len(names), 3))
    for frame, q in enumerate(trajectory.qpos):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        for i, name in enumerate(names):
            is_site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name) >= 0
            out[frame, i] = data.site(name).xpos if is_site else data.body(name).xpos
    return out


def soles(trajectory: Trajectory) -> Array:
    """(T, feet, points, 3)."""
    feet = load_rig(trajectory.rig).feet
    points = sites(trajectory, *(s for foot in feet for s in foot.sites))
    return points.reshape(len(trajectory), len(feet), -1, 3)


def shown_at(clip: Motion, trajectory: Trajectory, seconds: float) -> int:
    """The frame of the trajectory that shows the clip at `seconds`, well inside it: the clip sits in the middle of the
    time that its label has, which is longer by the two halves of a 0.3 s ramp."""
    label = trajectory.labels[0]
    extra = (label.end_s - label.start_s - clip.duration) / 2
    return round((label.start_s + extra + seconds) * trajectory.fps)


def unit(v: Array) -> Array:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)
