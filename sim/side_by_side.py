"""A rig beside a human, both in a T-pose: what follows what, at a glance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from motiongen.files import replacing
from motiongen.gestures.catalogue import perform
from retarget.retarget import retarget
from retarget.rig import Rig, load_rig
from sim.canvas import Pixels, canvas
from sim.look import build_stage, follow


def render_t_pose(rig: Rig, path: Path, *, size: tuple[int, int] = (480, 480)) -> None:
    """Write a .png with `rig` on the left and the humanoid on the right, `size` pixels each, as retargeting has them.

    Raises RigError where the rig's model does not fit it; RuntimeError without OpenGL.
    """
    sheet = Image.new("RGB", (2 * size[0], size[1]), "white")
    for column, each in enumerate((rig, load_rig("humanoid"))):
        sheet.paste(Image.fromarray(_t_pose(each, size)), (column * size[0], 0))
    with replacing(path) as unfinished:
        sheet.save(unfinished, format="PNG")


def _t_pose(rig: Rig, size: tuple[int, int]) -> Pixels:
    shown = retarget(perform("t-pose"), rig)
    stage = build_stage(rig, width=size[0], height=size[1], fine=True)
    middle = shown.qpos[len(shown) // 2][None]
    with canvas(stage, size) as drawing:
        return np.asarray(drawing.draw(middle[0], follow(middle, shown.fps, stage)[0]))
