"""How a rig looks on screen: floor, sky, lights, what holds it, and where the camera stands."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from motiongen.rotation import yaw_of_quat, yaw_quat
from retarget.model import load_spec
from retarget.rig import Mount, Rig
from sim.scene import FLOOR, add_floor
from sim.thresholds import rig_size

Array = NDArray[np.float64]

STEEL = (0.42, 0.45, 0.50, 1.0)
HEMP = (0.80, 0.74, 0.60, 1.0)
TILE = 0.5  # m at human size, side of a floor tile
THREE_QUARTER = 150.0  # degrees: the camera stands ahead of the rig and to its right, where both hands are seen
DOWNWARD = -12.0  # degrees
FIELD_OF_VIEW = 32.0  # degrees, vertical: a portrait lens, so that near hands do not look large
MARGIN = 1.12  # picture height over figure height
FOLLOW_TIME = 1.0  # s over which the camera's path is averaged


@dataclass(frozen=True)
class Stage:
    """A model to look at: free root, the rig's joints, and a prop (post or rope) that goes where the root goes."""

    model: mujoco.MjModel
    rig: Rig

    def place(self, data: mujoco.MjData, qpos: ArrayLike) -> None:
        """Show the pose `qpos` (7 + nj,), root first."""
        row = np.asarray(qpos, float)
        data.qpos[:] = row
        if self.model.nmocap:
            data.mocap_pos[0] = row[:3]
            data.mocap_quat[0] = yaw_quat(yaw_of_quat(row[3:7]))
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_camlight(self.model, data)


def build_stage(
    rig: Rig, mount: Mount | None = None, *, width: int = 640, height: int = 480, fine: bool = False
) -> Stage:
    """The stage for `rig`, for pictures of up to `width` x `height` pixels.

    `fine` smooths edges and shadows, which takes three times as long where OpenGL runs in software.

    Raises RigError (from `load_spec`) where the model does not fit the rig.
    """
    spec, size = load_spec(rig), rig_size(rig)
    _light(spec, rig, size)
    _dress_floor(spec, size)
    held = rig.mount if mount is None else mount
    if held == "stand":
        _add_post(spec, rig, size)
    if held == "hung":
        _add_rope(spec, size)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.global_.fovy = FIELD_OF_VIEW
    spec.visual.global_.azimuth, spec.visual.global_.elevation = THREE_QUARTER, DOWNWARD
    spec.visual.quality.shadowsize = 4096 if fine else 1024
    spec.visual.map.shadowclip = 2.0  # extents around the key light; the floor shows dots beyond
    spec.visual.map.zfar = 12.0  # extents; the floor fades into the sky well before
    spec.visual.quality.offsamples = 4 if fine else 0
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 20, 12
    spec.stat.center = [0, 0, rig.nominal.height]
    spec.stat.extent = 2.0 * size
    return Stage(spec.compile(), rig)


def _light(spec: mujoco.MjSpec, rig: Rig, size: float) -> None:
    """A warm key light from ahead, which goes with the rig since shadows are sharp only near it, and a cool rim."""
    spec.visual.headlight.ambient = [0.38, 0.38, 0.40]
    spec.visual.headlight.diffuse = [0.22, 0.22, 0.22]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]
    spec.visual.rgba.haze = [0.80, 0.85, 0.90, 1]
    directional, track = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, mujoco.mjtCamLight.mjCAMLIGHT_TRACK
    key = spec.body(rig.root).add_light(name="key", type=directional, mode=track, castshadow=True)
    key.pos, key.dir = [1.1 * size, -0.9 * size, 2.1 * size], [-0.45, 0.37, -0.85]
    key.diffuse, key.specular = [0.62, 0.60, 0.56], [0.3, 0.3, 0.3]
    rim = spec.worldbody.add_light(name="rim", type=directional, castshadow=False)
    rim.pos, rim.dir = [-3 * size, 2 * size, 2 * size], [0.8, -0.5, -0.35]
    rim.diffuse, rim.specular = [0.20, 0.24, 0.30], [0.1, 0.1, 0.1]
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.50, 0.63, 0.78],
        rgb2=[0.86, 0.89, 0.92],
        width=256,
        height=256,
    )


def _dress_floor(spec: mujoco.MjSpec, size: float) -> None:
    texture = spec.add_texture(
        name=FLOOR,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=[0.62, 0.66, 0.70],
        rgb2=[0.57, 0.61, 0.66],
        markrgb=[0.70, 0.74, 0.78],
        width=512,
        height=512,
    )
    material = spec.add_material(name=FLOOR, texuniform=True, texrepeat=[0.5 / (TILE * size)] * 2)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name
    add_floor(spec).material = FLOOR


def _add_post(spec: mujoco.MjSpec, rig: Rig, size: float) -> None:
    """A foot plate and a post behind the rig, with an arm to its root."""
    back, down = -0.32 * size, -(rig.nominal.height + rig.stand_clearance)
    spec.add_material(name="prop", rgba=STEEL)
    prop = spec.worldbody.add_body(name="prop", mocap=True)
    _bar(prop, [back, 0, down], [back, 0, 0], 0.030 * size)
    _bar(prop, [back, 0, 0], [0, 0, 0], 0.030 * size)
    _bar(prop, [back / 2, 0, down], [back / 2, 0, down + 0.02 * size], 0.36 * size)


def _add_rope(spec: mujoco.MjSpec, size: float) -> None:
    """A rope that comes down behind the head to the back."""
    spec.add_material(name="prop", rgba=HEMP)
    prop = spec.worldbody.add_body(name="prop", mocap=True)
    _bar(prop, [-0.16 * size, 0, 0.25 * size], [-0.16 * size, 0, 3 * size], 0.008 * size)


def _bar(body: mujoco.MjsBody, start: list[float], end: list[float], radius: float) -> None:
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    ends = [*start, *end]
    body.add_geom(type=cylinder, size=[radius, 0, 0], fromto=ends, material="prop", contype=0, conaffinity=0, group=0)


def aim(camera: mujoco.MjvCamera, qpos: Array, stage: Stage) -> None:
    """Point `camera` at the rig in row 0 of `qpos` (T, 7 + nj), from ahead of where it faces, all rows fitting in."""
    top = _highest(qpos, stage)
    camera.azimuth = THREE_QUARTER + float(np.degrees(yaw_of_quat(qpos[0, 3:7])))
    camera.elevation = DOWNWARD
    camera.distance = 0.5 * MARGIN * top / np.tan(0.5 * np.radians(FIELD_OF_VIEW))
    camera.lookat[:] = [*qpos[0, :2], 0.5 * top]


def follow(qpos: Array, fps: float, stage: Stage) -> list[mujoco.MjvCamera]:
    """One camera per row of `qpos` (T, 7 + nj): aimed once, then carried along on a smoothed path of the root."""
    width = max(1, round(FOLLOW_TIME * fps))
    padded = np.pad(qpos[:, :2], ((width // 2, width - 1 - width // 2), (0, 0)), mode="edge")
    path = np.stack([np.convolve(padded[:, i], np.ones(width) / width, mode="valid") for i in range(2)], axis=1)
    first = mujoco.MjvCamera()
    aim(first, qpos, stage)
    cameras = [copy(first) for _ in path]
    for camera, place in zip(cameras, path, strict=True):
        camera.lookat[:2] = place
    return cameras


def _highest(qpos: Array, stage: Stage) -> float:
    """Height (m) of the highest point that any part of the rig reaches over all rows."""
    model, data, top = stage.model, mujoco.MjData(stage.model), 0.0
    parts = (model.geom_rbound > 0) & (model.body_mocapid[model.geom_bodyid] < 0)
    for row in qpos:
        stage.place(data, row)
        top = max(top, float((data.geom_xpos[parts, 2] + model.geom_rbound[parts]).max()))
    return top
