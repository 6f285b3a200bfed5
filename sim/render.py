"""Pictures without a screen: films (.mp4, .gif) and contact sheets (.png) of a rig in motion."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from motiongen.files import replacing
from retarget.rig import Mount, Rig
from sim.canvas import Pixels, canvas
from sim.look import build_stage, follow

Array = NDArray[np.float64]

FILM_FPS = {".mp4": 25.0, ".gif": 20.0}  # frames a second at most; 25 shows every second row of 50 without judder
GIF_TICK = 10  # ms, the clock of the format
INK = (34, 40, 52)
GIF_COLOURS = 192


def render_video(
    qpos: Array,
    fps: float,
    rig: Rig,
    path: Path,
    *,
    size: tuple[int, int] = (640, 480),
    speed: float = 1.0,
    title: str = "",
    mount: Mount | None = None,
) -> int:
    """Film `qpos` (T, 7 + nj), `fps` rows a second, into `path`, .mp4 (H.264, plays in browsers) or .gif.

    `size`: width and height in pixels, even. `speed`: 0.5 is slow motion. `mount` (the rig's own by default) says what
    is drawn to hold the rig. Returns the number of frames in the film.

    Raises ValueError for another suffix, odd sizes, or fps or speed not above 0; RuntimeError without OpenGL.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FILM_FPS:
        raise ValueError(f"cannot film into {str(path)!r}: the suffix must be {' or '.join(FILM_FPS)}")
    if fps <= 0 or speed <= 0:
        raise ValueError(f"fps and speed must be above 0, not {fps} and {speed}")
    if size[0] % 2 or size[1] % 2 or min(size) < 16:
        raise ValueError(f"size must be two even numbers of pixels, 16 or more, not {size}")
    film_fps = _film_fps(fps * speed, suffix)
    count = max(1, round(len(qpos) * film_fps / (fps * speed)))
    rows = np.minimum((np.arange(count) * fps * speed / film_fps).astype(int), len(qpos) - 1)
    drawn = pictures(qpos, fps, rows, rig, mount, size, title)
    with replacing(path) as unfinished:
        if suffix == ".mp4":
            _write_mp4(unfinished, drawn, film_fps, size)
        else:
            _write_gif(unfinished, drawn, film_fps)
    return count


def render_sheet(
    qpos: Array,
    fps: float,
    rig: Rig,
    path: Path,
    *,
    panels: int = 8,
    columns: int = 4,
    size: tuple[int, int] = (320, 320),
    title: str = "",
    mount: Mount | None = None,
) -> None:
    """A contact sheet .png: `panels` poses evenly spaced over `qpos` (T, 7 + nj), each `size` pixels with its time.

    Raises ValueError for another suffix or fewer than one panel or column; RuntimeError without OpenGL.
    """
    if Path(path).suffix.lower() != ".png":
        raise ValueError(f"cannot draw a sheet into {str(path)!r}: the suffix must be .png")
    if panels < 1 or columns < 1:
        raise ValueError(f"a sheet needs at least one panel and column, not {panels} and {columns}")
    rows = np.linspace(0, len(qpos) - 1, panels).round().astype(int)
    columns = min(columns, panels)
    head = 40 if title else 0
    sheet = Image.new("RGB", (columns * size[0], head + -(-panels // columns) * size[1]), "white")
    for i, pixels in enumerate(pictures(qpos, fps, rows, rig, mount, size, fine=True)):
        panel = Image.fromarray(pixels)
        _write_text(panel, f"{rows[i] / fps:.2f} s", (10, 8), size[1] // 20)
        sheet.paste(panel, (i % columns * size[0], head + i // columns * size[1]))
    _write_text(sheet, title, (12, 9), 18)
    with replacing(path) as unfinished:
        sheet.save(unfinished, format="PNG")


def _film_fps(fps: float, suffix: str) -> float:
    fastest = min(fps, FILM_FPS[suffix])
    if suffix == ".mp4":
        return fastest
    return 1000 / (GIF_TICK * max(1, round(1000 / GIF_TICK / fastest)))


def pictures(
    qpos: Array,
    fps: float,
    rows: NDArray[np.int_],
    rig: Rig,
    mount: Mount | None,
    size: tuple[int, int],
    title: str = "",
    fine: bool = False,
) -> Iterator[Pixels]:
    """The given `rows` of `qpos` (T, 7 + nj) as pictures (height, width, 3), by a camera that follows the whole of it.

    Raises RuntimeError without OpenGL.
    """
    stage = build_stage(rig, mount, width=size[0], height=size[1], fine=fine)
    cameras = follow(qpos, fps, stage)
    with canvas(stage, size) as drawing:
        for row in rows:
            picture = Image.fromarray(drawing.draw(qpos[row], cameras[row]))
            _write_text(picture, title, (14, 10), max(12, size[1] // 26))
            yield np.asarray(picture)


def _write_text(picture: Image.Image, text: str, at: tuple[int, int], height: int) -> None:
    ImageDraw.Draw(picture).text(at, text, fill=INK, font=ImageFont.load_default(height))


def _write_mp4(path: Path, pictures: Iterator[Pixels], fps: float, size: tuple[int, int]) -> None:
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        str(path),
        size,
        fps=fps,
        codec="libx264",
        pix_fmt_out="yuv420p",
        quality=None,
        macro_block_size=2,
        output_params=["-crf", "20", "-preset", "veryfast", "-movflags", "+faststart", "-f", "mp4"],
    )
    writer.send(None)
    try:
        for picture in pictures:
            writer.send(np.ascontiguousarray(picture))
    finally:
        writer.close()


def _write_gif(path: Path, pictures: Iterator[Pixels], fps: float) -> None:
    frames = [Image.fromarray(p).quantize(GIF_COLOURS, dither=Image.Dither.NONE) for p in pictures]
    frames[0].save(
        path, format="GIF", save_all=True, append_images=frames[1:], duration=round(1000 / fps), loop=0, optimize=True
    )
