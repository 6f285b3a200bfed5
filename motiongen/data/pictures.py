"""Stick figures of a few clips, drawn with Pillow alone: no rig, no physics, no OpenGL."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motiongen.data.dataset import Dataset, Entry
from motiongen.files import replacing
from motiongen.motion import Motion, Skeleton

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

POSES = 9  # a clip
CELL = (110, 130)  # pixels of one pose
TITLE = 22  # pixels over a row
PIXELS_PER_M = 62.0
SIDEWAYS = np.radians(35)  # the view: from ahead, turned this far to the figure's left
INK, LEFT, RIGHT, FLOOR = (34, 40, 52), (196, 84, 44), (44, 104, 176), (205, 210, 218)


def different(entries: Sequence[Entry], count: int) -> list[int]:
    """Numbers of at most `count` clips, of as many contents as there are, spread over them all, in order."""
    first: dict[str, int] = {}
    for number, entry in enumerate(entries):
        first.setdefault(entry.content or entry.name, number)
    kinds = list(first.values())
    return [kinds[i] for i in np.linspace(0, len(kinds) - 1, min(count, len(kinds))).round().astype(int)]


def draw_clips(dataset: Dataset, numbers: Sequence[int], path: Path) -> None:
    """Draw clips into the .png `path`, a row each: its first caption over poses evenly spaced in time.

    The left arm and leg are red, the right ones blue. Raises ModuleNotFoundError without Pillow, OSError where `path`
    cannot be written.
    """
    from PIL import Image, ImageDraw, ImageFont

    height = CELL[1] + TITLE
    picture = Image.new("RGB", (POSES * CELL[0], len(numbers) * height), "white")
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(13)
    for row, number in enumerate(numbers):
        top = row * height
        motion = dataset.motion(number)
        pen.text((8, top + 4), f"{motion.labels[0].text} ({motion.duration:.1f} s)", fill=INK, font=font)
        floor = top + height - 8
        pen.line([(0, floor), (picture.width, floor)], fill=FLOOR)
        for column, frame in enumerate(np.linspace(0, len(motion) - 1, POSES).round().astype(int)):
            foot = np.array([(column + 0.5) * CELL[0], floor])
            draw_figure(pen, motion.skeleton, foot + _seen(motion, int(frame)))
    with replacing(path) as unfinished:
        picture.quantize(32).save(unfinished, format="PNG", optimize=True)


def _seen(motion: Motion, frame: int) -> NDArray[np.float64]:
    """Joints (J, 2) of a frame in pixels, right and down, from where the pelvis stands on the floor."""
    at = motion.positions()[frame]
    return PIXELS_PER_M * in_view(at - [*at[0, :2], 0.0])


def in_view(at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (..., 3) in metres as they are seen: right and down (..., 2), from the origin."""
    x, y, z = np.moveaxis(at, -1, 0)
    return np.stack([y * np.cos(SIDEWAYS) + x * np.sin(SIDEWAYS), -z], axis=-1)


def draw_figure(pen: ImageDraw, skeleton: Skeleton, at: NDArray[np.float64], size: float = 1.0) -> None:
    """Lines between the joints at `at` (J, 2) in pixels, `size` times as thick as in a row of poses."""
    names, thick = skeleton.names, round(3 * size)
    for j, parent in enumerate(skeleton.parents):
        if parent >= 0:
            side = LEFT if names[j].startswith("left") else RIGHT if names[j].startswith("right") else INK
            pen.line([tuple(at[parent]), tuple(at[j])], fill=side, width=thick)
    x, y = at[names.index("head")]
    pen.ellipse([x - 6 * size, y - 9 * size, x + 6 * size, y + 4 * size], outline=INK, width=thick - 1)
