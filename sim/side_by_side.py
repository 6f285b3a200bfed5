"""Rigs beside each other, all doing the same: what follows what, at a glance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from motiongen.files import replacing
from motiongen.motion import Motion
from retarget.retarget import retarget
from retarget.rig import Rig
from sim.canvas import Pixels, canvas
from sim.gallery import COLOURS, TITLE
from sim.look import build_stage, follow
from sim.render import INK


def render_side_by_side(
    rigs: Sequence[Rig], motion: Motion, path: Path, *, at: float = 0.5, size: tuple[int, int] = (240, 280)
) -> None:
    """Write a .png with each of `rigs` doing `motion`, `at` this share of its time, from left to right with its name.

    `size`: width and height of each in pixels. Raises ValueError for another suffix, no rigs or an `at` outside 0 to 1,
    RigError where a rig's model does not fit it, RuntimeError without OpenGL.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"cannot draw rigs into {str(path)!r}: the suffix must be .png")
    if not rigs or not 0 <= at <= 1:
        raise ValueError(f"at {at:g} of the time of {len(rigs)} rigs: should be 0 to 1 of at least one")
    sheet = Image.new("RGB", (len(rigs) * size[0], TITLE + size[1]), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    for column, rig in enumerate(rigs):
        pen.text((column * size[0] + 8, 4), rig.name, fill=INK, font=font)
        sheet.paste(Image.fromarray(_pose(rig, motion, at, size)), (column * size[0], TITLE))
    with replacing(path) as unfinished:
        sheet.quantize(COLOURS, dither=Image.Dither.NONE).save(unfinished, format="PNG", optimize=True)


def _pose(rig: Rig, motion: Motion, at: float, size: tuple[int, int]) -> Pixels:
    shown = retarget(motion, rig)
    row = shown.qpos[round(at * (len(shown) - 1))]
    stage = build_stage(rig, width=size[0], height=size[1], fine=True)
    with canvas(stage, size) as drawing:
        return np.asarray(drawing.draw(row, follow(row[None], shown.fps, stage)[0]))
