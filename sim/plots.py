"""Plots over time as SVG text, which a page holds without fetching anything."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Scale = Callable[[float], float]

LEFT, RIGHT, TOP, BOTTOM = 46, 8, 8, 18  # pixels around the plot, for the figures of its axes
MOST_POINTS = 400  # of a line: more than its pixels draw nothing else
TICKS = 5  # at most, on each axis
GRID, TEXT, ALARM = "#e3e7ec", "#5b6675", "#c62828"


@dataclass(frozen=True)
class Line:
    """`values` (T,), NaN where there is none; `dashed` for what is a limit rather than a finding."""

    name: str
    values: Array
    colour: str
    dashed: bool = False


@dataclass(frozen=True)
class Mark:
    """A moment that stands out, with the words that a pointer brings up."""

    at_s: float
    name: str


def plot(
    lines: Sequence[Line],
    fps: float,
    unit: str,
    *,
    marks: Sequence[Mark] = (),
    now_s: float | None = None,
    size: tuple[int, int] = (430, 110),
) -> str:
    """The `lines`, `fps` values a second, over seconds, as one <svg>; `marks` and `now_s` are upright lines.

    The vertical axis is in `unit` and shows 0. `size`: width and height in pixels. Raises ValueError where there are no
    lines, they differ in length, or nothing is finite.
    """
    if not lines or len({len(line.values) for line in lines}) != 1:
        raise ValueError(f"a plot needs lines of one length, not of {[len(line.values) for line in lines]}")
    everything = np.concatenate([line.values for line in lines])
    if not np.isfinite(everything).any():
        raise ValueError(f"a plot of {', '.join(line.name for line in lines)}: not one value is finite")
    width, height = size
    last = max((len(lines[0].values) - 1) / fps, 1 / fps)
    low, high = min(0.0, float(np.nanmin(everything))), max(0.0, float(np.nanmax(everything)))
    room = 0.06 * (high - low) or 1.0
    low, high = low - room * (low < 0), high + room

    def x(seconds: float) -> float:
        return LEFT + seconds / last * (width - LEFT - RIGHT)

    def y(value: float) -> float:
        return TOP + (high - value) / (high - low) * (height - TOP - BOTTOM)

    parts = [_grid(x, y, last, (low, high), unit, size)]
    for line in lines:
        parts.append(_path(line, fps, x, y))
    for mark in marks:
        where = f'x1="{x(mark.at_s):.1f}" x2="{x(mark.at_s):.1f}" y1="{TOP}" y2="{height - BOTTOM}"'
        parts.append(
            f'<line {where} stroke="{ALARM}" stroke-width="1.5"><title>{escape(f"{mark.name}, {mark.at_s:.2f} s")}'
            f'</title></line><circle cx="{x(mark.at_s):.1f}" cy="{TOP}" r="3" fill="{ALARM}"/>'
        )
    if now_s is not None:
        at = x(min(max(now_s, 0.0), last))
        parts.append(f'<line x1="{at:.1f}" x2="{at:.1f}" y1="{TOP}" y2="{height - BOTTOM}" stroke="#111"/>')
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="100%"'
    style = 'font-family="system-ui,sans-serif" font-size="10" role="img"'
    return f'{head} {style} aria-label="{escape(", ".join(line.name for line in lines))}">{"".join(parts)}</svg>'


def _grid(x: Scale, y: Scale, last: float, span: tuple[float, float], unit: str, size: tuple[int, int]) -> str:
    width, height = size
    parts = []
    for value in ticks(*span):
        at, strong = f"{y(value):.1f}", TEXT if value == 0 else GRID
        parts.append(
            f'<line x1="{LEFT}" x2="{width - RIGHT}" y1="{at}" y2="{at}" stroke="{strong}" stroke-width=".7"/>'
        )
        parts.append(f'<text x="{LEFT - 4}" y="{float(at) + 3:.1f}" text-anchor="end" fill="{TEXT}">{value:g}</text>')
    for value in ticks(0.0, last):
        at = f"{x(value):.1f}"
        parts.append(f'<text x="{at}" y="{height - 5}" text-anchor="middle" fill="{TEXT}">{value:g}</text>')
    parts.append(f'<text x="{width - RIGHT}" y="{height - 5}" text-anchor="end" fill="{TEXT}">s</text>')
    parts.append(f'<text x="2" y="{TOP + 3}" fill="{TEXT}">{escape(unit)}</text>')
    return "".join(parts)


def _path(line: Line, fps: float, x: Scale, y: Scale) -> str:
    drawn, pen_up = [], True
    for frame in thinned(line.values):
        value = float(line.values[frame])
        if not math.isfinite(value):
            pen_up = True
            continue
        drawn.append(f"{'M' if pen_up else 'L'}{x(frame / fps):.1f} {y(value):.1f}")
        pen_up = False
    dashes = ' stroke-dasharray="4 3"' if line.dashed else ""
    name = f"<title>{escape(line.name)}</title>"
    return f'<path d="{"".join(drawn)}" fill="none" stroke="{line.colour}" stroke-width="1.3"{dashes}>{name}</path>'


def thinned(values: Array) -> list[int]:
    """Frames of `values` (T,) that are enough to draw: of each stretch its first, lowest and highest, so peaks stay."""
    if len(values) <= MOST_POINTS:
        return list(range(len(values)))
    kept = []
    for stretch in np.array_split(np.arange(len(values)), MOST_POINTS // 3):
        piece = values[stretch]
        lowest, highest = np.argmin(np.nan_to_num(piece, nan=np.inf)), np.argmax(np.nan_to_num(piece, nan=-np.inf))
        kept += sorted({int(stretch[0]), int(stretch[lowest]), int(stretch[highest])})
    return kept


def ticks(low: float, high: float) -> list[float]:
    """Round numbers from `low` to `high`, TICKS at most: steps of 1, 2 or 5 times a power of ten."""
    raw = (high - low) / TICKS
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(factor * power for factor in (1, 2, 5, 10) if factor * power >= raw)
    return [round(k * step, 12) for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
