"""A film of the benchmark's story, a stick figure with the line that is being told.

python benchmarks/story_film.py [--generator NAME] [--seed N] [--out docs/media/timeline.gif]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from editing import STORY
from parts import Options
from PIL import Image, ImageDraw, ImageFont

from motiongen.data.pictures import FLOOR, INK, draw_figure, in_view
from motiongen.diffusion.generator import DiffusionGenerator
from motiongen.files import replacing
from motiongen.measure.swings import smoothed
from motiongen.motion import Motion

SIZE = (360, 260)  # pixels
PIXELS_PER_M = 105.0
FLOOR_AT = 230  # pixels from the top
TICK_M = 0.5  # between marks on the floor, by which one sees it pass
FPS, COLOURS = 20, 16
CAMERA_S = 1.0  # over which the camera's way is averaged


def main() -> None:
    """Draw the story and film it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--generator", default="mdm", help="a diffusion generator's name, or a file of weights")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("docs/media/timeline.gif"))
    options = parser.parse_args()
    generator = DiffusionGenerator(Options(False, options.generator).weights)
    film(generator.generate_timeline(STORY, seed=options.seed), options.out)
    print(f"{options.out}: {options.out.stat().st_size / 1e6:.2f} MB")


def film(motion: Motion, path: Path) -> None:
    """`motion` as the .gif `path`, with the label of each moment above it."""
    seen = in_view(motion.positions()) * PIXELS_PER_M
    camera = smoothed(seen[:, 0, 0], motion.fps, CAMERA_S)
    pictures = []
    for frame in np.arange(0, len(motion), motion.fps / FPS).astype(int):
        picture = Image.new("RGB", SIZE, "white")
        pen = ImageDraw.Draw(picture)
        shift = np.array([SIZE[0] / 2 - camera[frame], FLOOR_AT])
        pen.line([(0, FLOOR_AT), (SIZE[0], FLOOR_AT)], fill=FLOOR, width=2)
        step = TICK_M * PIXELS_PER_M
        for x in np.arange(shift[0] % step, SIZE[0], step):
            pen.line([(x, FLOOR_AT), (x - 8, FLOOR_AT + 12)], fill=FLOOR, width=2)
        draw_figure(pen, motion.skeleton, seen[frame] + shift, size=1.6)
        told = [label.text for label in motion.labels if label.start_s <= frame / motion.fps < label.end_s]
        pen.text((10, 8), ", ".join(told), fill=INK, font=ImageFont.load_default(16))
        pictures.append(picture.quantize(COLOURS, dither=Image.Dither.NONE))
    first, *rest = pictures
    with replacing(path) as unfinished:
        first.save(unfinished, format="GIF", save_all=True, append_images=rest, duration=1000 // FPS, loop=0)


if __name__ == "__main__":
    main()
