"""Figures with targets, as the benchmarks print and gate them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Line:
    """One figure and what it must be: at least, or at most, `target`; `found` is None where it was not measured."""

    table: str
    name: str
    found: float | None
    target: float
    at_least: bool

    @property
    def holds(self) -> bool:
        return self.found is not None and (self.found >= self.target if self.at_least else self.found <= self.target)


def text(line: Line) -> str:
    """A line of the table."""
    found = "not measured" if line.found is None else f"{line.found:.3g}"
    bound = "at least" if line.at_least else "at most"
    return f"{line.table:<10} {line.name:<58} {found:>12}   {bound} {line.target:g}{'' if line.holds else '   SHORT'}"


def gate(lines: Sequence[Line], asked: bool) -> int:
    """Exit status: 1 where `asked` and a line does not hold, and then the last thing printed says which."""
    short = [line.name for line in lines if not line.holds]
    if asked and short:
        print(f"short: {'; '.join(short)}")
        return 1
    return 0
