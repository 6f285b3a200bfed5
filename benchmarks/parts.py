"""What the parts of `generators.py` are given and what they hand back."""

from __future__ import annotations

from dataclasses import dataclass

from lines import Line


@dataclass(frozen=True)
class Options:
    """`quick`: all parts together under a minute on one core."""

    quick: bool


@dataclass(frozen=True)
class Part:
    """What one part found: `rows` to read, the first the columns' heads, and `lines` that are held to a target."""

    rows: tuple[tuple[str, ...], ...]
    lines: tuple[Line, ...]
