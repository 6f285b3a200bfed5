"""The page that says what is in a data set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from motiongen.data.dataset import Entry, Head, Skipped

_COUNTED = ("clips", "hours", "captions")


def report(head: Head, entries: Sequence[Entry], skipped: Sequence[Skipped]) -> str:
    """A Markdown page: sources and licences, splits, lengths, contents and styles, what was skipped and why."""
    low, middle, high = np.percentile([entry.seconds for entry in entries], [0, 50, 100])
    clips, hours, captions = _count(entries)
    parts = [
        "# Data set",
        f"{clips} clips, {hours} h, {captions} captions; mirror images, which have about as many again, are not "
        f"counted. Clips last {low:.1f} to {high:.1f} s, half of them under {middle:.1f} s.",
        "## Sources",
        "\n".join(f"- `{source}`" for source in head.sources),
        _table(("source", "licence", *_COUNTED), _counted(entries, lambda e: (e.source, e.licence))),
        "## Splits",
        _table(("split", *_COUNTED), _counted(entries, lambda e: (e.split,))),
    ]
    if named := [entry for entry in entries if entry.content]:
        parts += ["## Contents and styles", "Clips of each.", _contents(named)]
    if skipped:
        parts += ["## Skipped", "\n".join(f"- {clip.name}: {clip.why}" for clip in skipped)]
    return "\n\n".join(parts) + "\n"


def _counted(entries: Iterable[Entry], group: Callable[[Entry], tuple[str, ...]]) -> list[tuple[str, ...]]:
    groups: dict[tuple[str, ...], list[Entry]] = {}
    for entry in entries:
        groups.setdefault(group(entry), []).append(entry)
    return [(*name, *_count(members)) for name, members in sorted(groups.items())]


def _count(entries: Sequence[Entry]) -> tuple[str, str, str]:
    """Clips, hours and different captions, as text."""
    captions = {caption for entry in entries for caption in entry.captions}
    return str(len(entries)), f"{sum(entry.seconds for entry in entries) / 3600:.2f}", str(len(captions))


def _contents(entries: Sequence[Entry]) -> str:
    clips = Counter((entry.content, entry.style) for entry in entries)
    styles = sorted({entry.style for entry in entries})
    rows = [
        (content, *(str(clips[content, style] or "") for style in styles))
        for content in sorted({entry.content for entry in entries})
    ]
    return _table(("content", *(style or "no style" for style in styles)), rows)


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    cells = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in cells)
