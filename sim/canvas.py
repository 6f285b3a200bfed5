"""Draw MuJoCo scenes into arrays, without a screen and whatever was imported before.

`mujoco.Renderer` takes its OpenGL from the environment at the moment when mujoco is first imported, which other stages
do long before anyone knows that a picture will be wanted. This one picks it when it opens.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.look import Stage

Pixels = NDArray[np.uint8]
WAY_OUT = "install libegl1 or libosmesa6, or set MUJOCO_GL to egl, osmesa or glfw"


class Canvas:
    """Draws one stage at one size; use it through `canvas`, which gives the OpenGL context back."""

    def __init__(self, stage: Stage, size: tuple[int, int]) -> None:
        self.stage, self.data = stage, mujoco.MjData(stage.model)
        self._scene = mujoco.MjvScene(stage.model, maxgeom=2000)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = True
        self._option = mujoco.MjvOption()
        self._context = mujoco.MjrContext(stage.model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._view = mujoco.MjrRect(0, 0, *size)

    def draw(self, qpos: NDArray[np.float64], camera: mujoco.MjvCamera) -> Pixels:
        """The picture (height, width, 3) of the pose `qpos` (7 + nj,)."""
        self.stage.place(self.data, qpos)
        mujoco.mjv_updateScene(
            self.stage.model, self.data, self._option, None, camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        mujoco.mjr_render(self._view, self._scene, self._context)
        pixels = np.empty((self._view.height, self._view.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._view, self._context)
        return pixels[::-1]

    def free(self) -> None:
        """Give back what lies in graphics memory; needs the OpenGL context that it was made in."""
        self._context.free()


@contextmanager
def canvas(stage: Stage, size: tuple[int, int]) -> Iterator[Canvas]:
    """A canvas of `size` (width, height) pixels, at most those that the stage was built for.

    Raises RuntimeError where OpenGL cannot be had without a screen.
    """
    context = _open_gl(*size)
    try:
        context.make_current()
        drawing = Canvas(stage, size)
        try:
            yield drawing
        finally:
            drawing.free()
    finally:
        context.free()


def _open_gl(width: int, height: int) -> Any:
    """An OpenGL context of the kind that `MUJOCO_GL` names; on Linux without it, EGL or else OSMesa."""
    kind = os.environ.get("MUJOCO_GL", "").lower()
    if sys.platform == "linux" and not kind:
        kind = "egl" if _has_egl() else "osmesa"
    try:
        if kind == "egl":
            from mujoco.egl import GLContext
        elif kind == "osmesa":
            from mujoco.osmesa import GLContext
        else:
            from mujoco import GLContext
        return GLContext(width, height)
    except Exception as problem:  # each backend raises types of its own, from libraries of its own
        raise RuntimeError(f"cannot draw without a screen ({kind or 'glfw'}: {problem}); {WAY_OUT}") from None


def _has_egl() -> bool:
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    return True
