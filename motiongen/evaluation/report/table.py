"""Results as rows of text: a row a figure, a column a subject, for the terminal, the report and the docs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from motiongen.evaluation.run.results import Figure, Results

BY_CONTENT = "content by content"  # long, and of little weight one by one
ARROW = {"more": " ↑", "less": " ↓", "": ""}


@dataclass(frozen=True)
class Row:
    """Cells of one row; a `heading` has the name of its group and no figures."""

    cells: tuple[str, ...]
    heading: bool = False


def headings(results: Results) -> tuple[str, ...]:
    """Names of the columns."""
    return ("measure", *(title(s.name, s.candidates) for s in results.subjects))


def title(name: str, candidates: int) -> str:
    """A subject's name, with how many were drawn for one where it is not one."""
    return name if candidates == 1 else f"{name}, best of {candidates}"


def groups(results: Results) -> dict[str, list[str]]:
    """Names of all figures by group, in the order in which subjects have them."""
    out: dict[str, list[str]] = {}
    for subject in results.subjects:
        for figure in subject.figures:
            names = out.setdefault(figure.group, [])
            if figure.name not in names:
                names.append(figure.name)
    return out


def table_rows(results: Results, *, every_content: bool = False) -> Iterator[Row]:
    """A heading for each group and a row for each figure; what was not measured is "–"."""
    blank = ("",) * len(results.subjects)
    for group, names in groups(results).items():
        if group == BY_CONTENT and not every_content:
            continue
        yield Row((group, *blank), heading=True)
        for name in names:
            found = [subject.figure(group, name) for subject in results.subjects]
            first = next(figure for figure in found if figure is not None)
            unit = f" [{first.unit}]" if first.unit else ""
            yield Row((name + unit + ARROW[first.better], *(cell(f) for f in found)))


def cell(figure: Figure | None) -> str:
    """A figure and half the width of its interval; shares in per cent."""
    if figure is None:
        return "–"
    half = (figure.high - figure.low) / 2
    if is_share(figure):
        return f"{figure.value:.0%} ± {100 * half:.0f}"
    digits = max(0, 2 - _magnitude(max(half, abs(figure.value) / 1000)))
    return f"{figure.value:.{min(digits, 4)}f} ± {half:.{min(digits, 4)}f}"


def is_share(figure: Figure) -> bool:
    """Whether a figure is a share that reads best in per cent."""
    return not figure.unit and figure.group in (BY_CONTENT, "content", "language", "gate")


def _magnitude(x: float) -> int:
    """Digits before the point: 0 for 0.5, 1 for 5, -1 for 0.05."""
    size = 0
    while x >= 1:
        x, size = x / 10, size + 1
    while 0 < x < 0.1 and size > -4:
        x, size = x * 10, size - 1
    return size
