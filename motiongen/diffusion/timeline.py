"""Timelines: what happens when, with which parts of the body; a line of the file is `text # start # end # parts`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motiongen.compose.parts import PARTS, joints_of
from motiongen.diffusion import said
from motiongen.diffusion.draw import FADE, Pass, passes_over, patched, whole
from motiongen.diffusion.weights import Weights
from motiongen.features import CONTACTS, FPS, TURNS, WIDTH
from motiongen.generator import check_prompt
from motiongen.motion import FOOT_JOINTS, SMPL_JOINTS

MOST_ENTRIES, MOST_S = 100, 600.0
SHORTEST_S = 0.5


class TimelineError(ValueError):
    """A timeline that cannot be followed; the message names the line or the time and what would do."""


@dataclass(frozen=True)
class Entry:
    """`text` from `start_s` to `end_s`, in seconds, with the `parts` of the body, none for the whole.

    Raises TimelineError for impossible times, PromptError for an impossible text, ValueError for unknown parts.
    """

    text: str
    start_s: float
    end_s: float
    parts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "text", check_prompt(self.text))
        if not (math.isfinite(self.start_s) and math.isfinite(self.end_s)) or self.start_s < 0:
            raise TimelineError(f"{self.text!r} from {self.start_s:g} to {self.end_s:g} s: times start at 0")
        if self.end_s - self.start_s < SHORTEST_S:
            raise TimelineError(
                f"{self.text!r} from {self.start_s:g} to {self.end_s:g} s: it must end {SHORTEST_S:g} s or more "
                "after its start"
            )
        if self.end_s > MOST_S:
            raise TimelineError(f"{self.text!r} ends at {self.end_s:g} s; a timeline lasts at most {MOST_S:g} s")
        if self.parts:
            joints_of(self.parts)


def read_timeline(path: Path) -> tuple[Entry, ...]:
    """Entries of a file: `text # start # end` or `text # start # end # parts`, parts with commas between; blank
    lines and such as begin with `#` are skipped.

    Raises TimelineError that names the line, OSError where the file cannot be opened.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise TimelineError(f"{path}: not a text file in UTF-8") from None
    said = [
        (number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")
    ]
    if len(said) > MOST_ENTRIES:
        raise TimelineError(f"{path}: {len(said)} entries; at most {MOST_ENTRIES} are taken")
    entries = []
    for number, line in said:
        try:
            entries.append(_entry(line))
        except ValueError as error:
            raise TimelineError(f"{path}, line {number}: {error}") from None
    try:
        require_whole(entries)
    except TimelineError as error:
        raise TimelineError(f"{path}: {error}") from None
    return tuple(entries)


def _entry(line: str) -> Entry:
    fields = [field.strip() for field in line.split("#")]
    if len(fields) not in (3, 4):
        raise TimelineError(f"{line.strip()!r}; write: text # start # end, or text # start # end # parts")
    parts = tuple(part.strip() for part in fields[3].split(",") if part.strip()) if len(fields) == 4 else ()
    return Entry(fields[0], _seconds(fields[1]), _seconds(fields[2]), parts)


def _seconds(text: str) -> float:
    try:
        return float(text.removesuffix("s"))
    except ValueError:
        raise TimelineError(f"{text!r} is no number of seconds") from None


def require_whole(entries: Sequence[Entry]) -> None:
    """Raise TimelineError where there are no entries, too many, or a time from 0 on at which nothing is said."""
    if not entries:
        raise TimelineError("no entries; a line is: text # start # end # parts")
    if len(entries) > MOST_ENTRIES:
        raise TimelineError(f"{len(entries)} entries; at most {MOST_ENTRIES} are taken")
    until = 0.0
    for entry in sorted(entries, key=lambda e: e.start_s):
        if entry.start_s > until + 0.5 / FPS:
            raise TimelineError(f"nothing is said between {until:g} and {entry.start_s:g} s; let the entries meet")
        until = max(until, entry.end_s)


def passes_of(model: Weights, entries: Sequence[Entry], encoder: said.Encoder) -> tuple[list[Pass], int]:
    """Passes of the network for a timeline, and its length in frames (MotionDiffuse, Eq. 10 and 11 together).

    Each entry is a pass over its own frames and some on either side. Where nobody speaks of a part of the body, there
    is one that is told nothing. Raises TimelineError.
    """
    require_whole(entries)
    count = round(max(entry.end_s for entry in entries) * FPS)
    passes = [each for entry in entries for each in _passes(model, entry, patched(model, count), encoder)]
    if not _all_said(entries, count):
        passes += whole(model, said.nothing(), count)
    return passes, count


def _passes(model: Weights, entry: Entry, total: int, encoder: said.Encoder) -> list[Pass]:
    start = max(0, round(entry.start_s * FPS) - FADE // 2)
    length = patched(model, min(total, round(entry.end_s * FPS) + FADE // 2) - start)
    start = min(start, total - length)
    return passes_over(model, said.texts(encoder, [entry.text]), start, start + length, columns_of(entry.parts))


def _all_said(entries: Sequence[Entry], count: int) -> bool:
    """Whether somebody speaks of the whole body at all times."""
    at = np.arange(count) / FPS
    said_of = np.zeros((count, WIDTH), bool)
    for entry in entries:
        said_of[(entry.start_s <= at) & (at < entry.end_s)] |= columns_of(entry.parts)
    return bool(said_of.all())


def columns_of(parts: Sequence[str]) -> NDArray[np.bool_]:
    """(140,): the features that `parts` of the body have a say in, none for all.

    The way that the pelvis goes is with the pelvis, and with both legs. Raises ValueError for unknown parts.
    """
    joints = set(joints_of(parts or ("whole_body",)))
    out = np.zeros(WIDTH, bool)
    for joint in joints:
        out[TURNS.start + 6 * joint :][:6] = True
    out[: TURNS.start] = 0 in joints or joints >= set(PARTS["legs"])
    out[CONTACTS] = [SMPL_JOINTS.index(name) in joints for name in FOOT_JOINTS]
    return out
