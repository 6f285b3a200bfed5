"""The page that says what is in a data set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from motiongen.data.dataset import Dataset, Entry
from motiongen.text.say_numbers import says_number

LENGTHS = (0, 1, 2, 4, 8, 16, 32, np.inf)  # s
BAR, WIDEST = "█", 40  # characters
_COUNTED = ("clips", "hours", "captions")


def report(dataset: Dataset, pictured: bool) -> str:
    """A Markdown page: sources and licences, splits, lengths, contents and styles, what was skipped and why.

    `pictured`: whether `report.png` lies beside it.
    """
    entries = dataset.entries
    clips, hours, captions = _count(entries)
    numbered = sum(map(says_number, (caption for entry in entries for caption in entry.captions)))
    parts = [
        "# Data set",
        f"{clips} clips, {hours} h, {captions} different captions; {numbered} captions of clips have a number in them. "
        "Mirror images, which have about as many again, are not counted.",
        *(("![Some of the clips as stick figures](report.png)",) if pictured else ()),
        "## Sources",
        "\n".join(f"- `{source}`" for source in dataset.head.sources),
        _table(("source", "licence", *_COUNTED), _counted(entries, lambda e: (e.source, e.licence))),
        "## Splits",
        _table(("split", *_COUNTED), _counted(entries, lambda e: (e.split,))),
        "## Lengths",
        _lengths([entry.seconds for entry in entries]),
    ]
    if named := [entry for entry in entries if entry.content]:
        parts += ["## Contents and styles", "Clips of each.", _contents(named)]
    if dataset.skipped:
        parts += ["## Skipped", "\n".join(f"- {clip.name}: {clip.why}" for clip in dataset.skipped)]
    return "\n\n".join(parts) + "\n"


def _lengths(seconds: Sequence[float]) -> str:
    """A histogram; from the second row on each is twice as wide as the one before."""
    counts, _ = np.histogram(seconds, LENGTHS)
    spans = [f"{low:g} to {high:g} s" for low, high in pairwise(LENGTHS[:-1])] + [f"over {LENGTHS[-2]:g} s"]
    rows = [
        (span, str(count), BAR * round(WIDEST * count / max(counts)))
        for span, count in zip(spans, counts.tolist(), strict=True)
    ]
    return _table(("length", "clips", ""), rows)


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
