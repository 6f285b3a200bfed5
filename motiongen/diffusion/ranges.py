"""Stretches of a clip by their ends: `0:1s,3s:` in seconds, `0:30,90:` in frames."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

SHORTEST_S = 0.1  # of a stretch that is drawn anew: a shorter one holds no movement


class RangeError(ValueError):
    """A range that the clip does not have; the message names it and what there is."""


def kept_frames(ranges: str, count: int, fps: float) -> NDArray[np.bool_]:
    """Which of `count` frames lie in `ranges`, `start:end` with commas between: `end` is the first not to be in it.

    A range is in seconds where an `s` is in it, else in frames; an end that is left out is that of the clip. Raises
    RangeError for what is no range, empty, outside the clip, overlapping another, or leaves nothing to draw.
    """
    kept = np.zeros(count, bool)
    for text in ranges.split(","):
        start, stop = _frames(text.strip(), count, fps)
        if kept[start:stop].any():
            raise RangeError(f"the range {text.strip()!r} overlaps another one of {ranges!r}")
        kept[start:stop] = True
    for start, stop in runs(~kept):
        if (stop - start) / fps < SHORTEST_S:
            raise RangeError(
                f"{ranges!r} leaves {(stop - start) / fps:.3g} s at {start / fps:.4g} s to draw; "
                f"at least {SHORTEST_S:g} s make a movement"
            )
    if kept.all():
        raise RangeError(f"{ranges!r} keeps all {count} frames; leave a stretch to draw")
    return kept


def runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Start and stop of every stretch of true `flags` (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _frames(text: str, count: int, fps: float) -> tuple[int, int]:
    ends = text.split(":")
    if len(ends) != 2:
        raise RangeError(f"{text!r} is no range; write start:end, as in 0:1s,3s: (seconds) or 0:30,90: (frames)")
    rate = fps if "s" in text else 1.0
    start, stop = (_frame(end, text, rate, open_end) for end, open_end in zip(ends, (0, count), strict=True))
    if not 0 <= start <= count or not 0 <= stop <= count:
        raise RangeError(f"the range {text!r} is outside the clip, which has {count} frames, {count / fps:.4g} s")
    if start >= stop:
        raise RangeError(f"the range {text!r} is empty: its end must come after its start")
    return start, stop


def _frame(end: str, text: str, rate: float, open_end: int) -> int:
    end = end.strip()
    if not end:
        return open_end
    try:
        value = float(end.removesuffix("s"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or (rate == 1.0 and not value.is_integer()):
        raise RangeError(f"{end!r} in the range {text!r} is no number of {'frames' if rate == 1.0 else 'seconds'}")
    return round(value * rate)
