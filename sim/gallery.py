"""One picture of many motions: a row each, several poses, what it is called."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from motiongen.files import replacing
from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from sim.canvas import canvas
from sim.look import build_stage, follow
from sim.render import INK

TITLE = 24  # pixels over a row
COLOURS = 64  # enough for one rig on one floor, and a fifth of the bytes


def render_gallery(
    rows: Sequence[tuple[str, Trajectory]],
    rig: Rig,
    path: Path,
    *,
    panels: int = 7,
    size: tuple[int, int] = (128, 140),
    mount: Mount | None = None,
) -> None:
    """A .png with a row for each title and trajectory of `rig`: `panels` poses evenly spaced in time.

    `size`: width and height of a pose in pixels. `mount` as in `render_sheet`. Raises ValueError for another suffix,
    no rows or no panels; RuntimeError without OpenGL.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"cannot draw a sheet into {str(path)!r}: the suffix must be .png")
    if not rows or panels < 1:
        raise ValueError(f"a sheet needs at least one row and panel, not {len(rows)} and {panels}")
    height = TITLE + size[1]
    sheet = Image.new("RGB", (panels * size[0], len(rows) * height), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    stage = build_stage(rig, mount, width=size[0], height=size[1], fine=True)
    with canvas(stage, size) as drawing:
        for row, (title, trajectory) in enumerate(rows):
            pen.text((8, row * height + 4), title, fill=INK, font=font)
            cameras = follow(trajectory.qpos, trajectory.fps, stage)
            frames = np.linspace(0, len(trajectory.qpos) - 1, panels).round().astype(int)
            for column, frame in enumerate(frames):
                pixels = drawing.draw(trajectory.qpos[frame], cameras[frame])
                sheet.paste(Image.fromarray(pixels), (column * size[0], row * height + TITLE))
    with replacing(path) as unfinished:
        sheet.quantize(COLOURS, dither=Image.Dither.NONE).save(unfinished, format="PNG", optimize=True)
