"""Dots with their 95 % intervals, a small plot for each figure, as SVG that takes its colours from the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from motiongen.evaluation.report.table import ARROW, cell, is_share
from motiongen.evaluation.run.results import Figure

COLOURS = 8  # --c0 … --c7 of the page
WIDTH, ROW, EDGE = 270.0, 18.0, 8.0
_LEFT, _RIGHT = 6.0, 92.0  # margins; the figures stand in the right one
_FAR_APART = 40.0  # times: from there on the axis is logarithmic


def plot(name: str, figures: Sequence[Figure | None]) -> str:
    """A figure element with one row a subject, in their order; None leaves the row without a dot."""
    there = [f for f in figures if f is not None]
    first = there[0]
    scale = _Scale(there)
    short = "{:.0%}".format if is_share(first) else "{:.3g}".format
    rows = "".join(_row(i, f, scale) for i, f in enumerate(figures))
    height = ROW * len(figures) + EDGE + 14
    zero = scale.at(0.0) if not scale.logarithmic and scale.low <= 0 <= scale.high else None
    axis = "" if zero is None else f'<line class="axis" x1="{zero:.1f}" x2="{zero:.1f}" y1="2" y2="{height - 16:.0f}"/>'
    ends = "".join(
        f'<text x="{scale.at(x):.1f}" y="{height - 2:.0f}" text-anchor="{anchor}">{short(x)}</text>'
        for x, anchor in ((scale.low, "start"), (scale.high, "end"))
    )
    note = " (log scale)" if scale.logarithmic else ""
    unit = f" [{first.unit}]" if first.unit else ""
    caption = escape(f"{name}{unit}{ARROW[first.better]}")
    said = escape(f"{name}: " + ", ".join(cell(f) for f in figures))
    return (
        f'<figure><figcaption>{caption}<span class="faint">{note}</span></figcaption>'
        f'<svg viewBox="0 0 {WIDTH:.0f} {height:.0f}" role="img" aria-label="{said}">{axis}{rows}{ends}</svg></figure>'
    )


class _Scale:
    """Where a value lies on the axis, which holds all intervals."""

    def __init__(self, figures: Sequence[Figure]) -> None:
        low, high = min(f.low for f in figures), max(f.high for f in figures)
        values = [f.value for f in figures]
        self.logarithmic = min(values) > 0 and max(values) / min(values) > _FAR_APART
        if is_share(figures[0]):
            low, high = 0.0, max(1.0, high)
        elif self.logarithmic:
            low = max(low, min(values) / 2)
        else:
            low = min(low, 0.0)
        self.low, self.high = low, high if high > low else low + 1.0

    def at(self, x: float) -> float:
        """Horizontal place of `x`, kept within the axis."""
        x = min(max(x, self.low), self.high)
        share = (
            math.log(x / self.low) / math.log(self.high / self.low)
            if self.logarithmic
            else (x - self.low) / (self.high - self.low)
        )
        return _LEFT + share * (WIDTH - _LEFT - _RIGHT)


def _row(i: int, figure: Figure | None, scale: _Scale) -> str:
    y = ROW * i + ROW / 2 + 2
    track = (
        f'<line class="axis" x1="{_LEFT}" x2="{WIDTH - _RIGHT}" y1="{y}" y2="{y}" stroke-dasharray="1 4"/>'
        f'<text class="value" x="{WIDTH - 2}" y="{y + 4}" text-anchor="end">{escape(cell(figure))}</text>'
    )
    if figure is None:
        return track
    colour = f"var(--c{i % COLOURS})"
    low, high, at = (f"{scale.at(x):.1f}" for x in (figure.low, figure.high, figure.value))
    return (
        f'{track}<line x1="{low}" x2="{high}" y1="{y}" y2="{y}" style="stroke:{colour}" stroke-width="2.5"/>'
        f'<circle cx="{at}" cy="{y}" r="4" style="fill:{colour}"/>'
    )
