"""What is drawn beside the rig: the pose that was asked for, feet that stand, support polygon and zero-moment point."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.look import Stage
from sim.preview import Preview
from sim.thresholds import rig_size

Array = NDArray[np.float64]
Colour = tuple[float, float, float, float]

TARGET: Colour = (0.15, 0.45, 0.95, 0.28)
EDGE: Colour = (0.10, 0.55, 0.25, 1.0)
INSIDE: Colour = (0.10, 0.65, 0.25, 1.0)
OUTSIDE: Colour = (0.85, 0.10, 0.10, 1.0)
CENTRE: Colour = (0.95, 0.65, 0.05, 1.0)
CONTACT: Colour = (0.98, 0.80, 0.10, 1.0)
ABOVE = 0.004  # m at human size, over the floor
POINT, LINE, SPOT = 0.022, 0.006, 0.016  # m at human size: radii of points and lines on the floor, and of contacts
PIN = 0.30  # m at human size: on its pin the zero-moment point is seen from above the feet that stand around it
APART = 0.04  # m at human size: a part that is nearer to its target hides it
IDENTITY = np.eye(3).ravel()


class Overlay:
    """Adds to MuJoCo scenes what `preview` has beside the rig; `stage` is the one that is drawn."""

    def __init__(self, preview: Preview, stage: Stage) -> None:
        self.preview, self.stage, self.size = preview, stage, rig_size(preview.rig)
        self._target = mujoco.MjData(stage.model)
        self._option, self._perturb = mujoco.MjvOption(), mujoco.MjvPerturb()

    def add(self, scene: mujoco.MjvScene, data: mujoco.MjData, frame: int) -> None:
        """Add what belongs to `frame`; `data` has the pose of the rig in it."""
        self._add_target(scene, data, frame)
        self._add_contacts(scene, data, frame)
        self._add_footing(scene, frame)

    def _add_target(self, scene: mujoco.MjvScene, data: mujoco.MjData, frame: int) -> None:
        """The pose asked for, as a ghost: those parts that are away from it."""
        model, target = self.stage.model, self._target
        self.stage.place(target, self.preview.asked[frame])
        away = np.linalg.norm(target.geom_xpos - data.geom_xpos, axis=1) > APART * self.size
        first = scene.ngeom
        mujoco.mjv_addGeoms(model, target, self._option, self._perturb, mujoco.mjtCatBit.mjCAT_DYNAMIC, scene)
        kept = first
        for k in range(first, scene.ngeom):
            geom = scene.geoms[k]
            prop = model.body_mocapid[model.geom_bodyid[geom.objid]] >= 0
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and away[geom.objid] and not prop:
                geom.rgba[:], geom.matid, geom.transparent = TARGET, -1, 1
                if kept != k:
                    _copy(geom, scene.geoms[kept])
                kept += 1
        scene.ngeom = kept

    def _add_contacts(self, scene: mujoco.MjvScene, data: mujoco.MjData, frame: int) -> None:
        for foot in self.preview.rig.feet:
            if foot.name in self.preview.touch and self.preview.touch[foot.name][frame]:
                for name in foot.sites:
                    self._point(scene, data.site_xpos[self.stage.model.site(name).id][:2], SPOT, CONTACT)

    def _add_footing(self, scene: mujoco.MjvScene, frame: int) -> None:
        footing = self.preview.footing
        if footing is None:
            return
        corners = footing.ground.polygon(frame)
        raised = np.column_stack([corners, np.full(len(corners), self.size * ABOVE)])
        for start, end in zip(raised, np.roll(raised, -1, axis=0), strict=True):
            self._line(scene, start, end, LINE, EDGE)
        self._point(scene, footing.com[frame], 0.7 * POINT, CENTRE)
        if np.isfinite(footing.zmp[frame]).all():
            colour = INSIDE if footing.zmp_margin[frame] >= 0 else OUTSIDE
            foot, head = (np.array([*footing.zmp[frame], self.size * z]) for z in (0.0, PIN))
            self._line(scene, foot, head, 0.7 * LINE, colour)
            _new(scene, mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, self.size * POINT), head, colour)

    def _point(self, scene: mujoco.MjvScene, at: Array, radius: float, colour: Colour) -> None:
        place, size = np.array([*at, self.size * ABOVE]), self.size * np.array([radius, radius, 0.3 * radius])
        _new(scene, mujoco.mjtGeom.mjGEOM_ELLIPSOID, size, place, colour)

    def _line(self, scene: mujoco.MjvScene, start: Array, end: Array, radius: float, colour: Colour) -> None:
        geom = _new(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3), colour)
        if geom is not None:
            mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, self.size * radius, start, end)


def _new(scene: mujoco.MjvScene, kind: mujoco.mjtGeom, size: Array, at: Array, colour: Colour) -> mujoco.MjvGeom | None:
    """One more geom of the scene; None where it is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, size, at, IDENTITY, np.array(colour, np.float32))
    scene.ngeom += 1
    return geom


def _copy(geom: mujoco.MjvGeom, to: mujoco.MjvGeom) -> None:
    """What makes up a geom of the ghost."""
    mujoco.mjv_initGeom(to, geom.type, geom.size, geom.pos, np.asarray(geom.mat).ravel(), geom.rgba)
    to.dataid, to.objtype, to.objid, to.category = geom.dataid, geom.objtype, geom.objid, geom.category
    to.matid, to.transparent, to.modelrbound = geom.matid, geom.transparent, geom.modelrbound
