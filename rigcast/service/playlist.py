"""Admitted frames between the thread that makes them and the one that sends them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Condition

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Row:
    """A frame: `qpos` (7 + nj,), the id of the report that it passed in, what it shows."""

    qpos: Array
    report_id: str
    text: str


class Playlist:
    """Rows by number. One thread plays, one puts rows and may take back what was not played.

    Where rows run out, the player takes the way to rest that came with the last of them, and the maker is told so.
    """

    def __init__(self) -> None:
        self._changed = Condition()
        self._rows: deque[Row] = deque()
        self._next = 0  # number of the first row that is left
        self._way: tuple[Row, ...] = ()
        self._last: Row | None = None
        self._ran_out = False

    @property
    def done(self) -> bool:
        """Whether neither rows nor a way to rest are left."""
        with self._changed:
            return not self._rows and not self._way

    @property
    def playhead(self) -> int:
        """The number of the next row to be played."""
        with self._changed:
            return self._next

    @contextmanager
    def held(self) -> Iterator[int]:
        """The number of the next row to be played, which stays that within the context: no longer than a frame."""
        with self._changed:
            yield self._next

    def put(self, rows: list[Row], way: tuple[Row, ...], first: int | None = None) -> bool:
        """Add `rows` and the `way` to rest behind them, in the place of all from number `first` on, by default at the
        end. False, and nothing changes, where rows had `ran_out` or the first has been played."""
        with self._changed:
            if self._ran_out or (first is not None and first < self._next):
                return False
            while first is not None and self._next + len(self._rows) > first:
                self._rows.pop()
            self._rows.extend(rows)
            self._way = way
            return True

    def play(self) -> tuple[Row, Row] | None:
        """The row that is due and the one after it (or itself); None before the first rows."""
        with self._changed:
            if not self._rows and self._way:
                self._rows.extend(self._way)
                self._way, self._ran_out = (), True
            if self._rows:
                self._last = self._rows.popleft()
                self._next += 1
            self._changed.notify_all()
            return None if self._last is None else (self._last, self._rows[0] if self._rows else self._last)

    @property
    def ran_out(self) -> bool:
        """Whether rows ran out since `take_ran_out`."""
        with self._changed:
            return self._ran_out

    def take_ran_out(self) -> bool:
        """Whether rows ran out since the last call; what is put from then on follows the way to rest."""
        with self._changed:
            out, self._ran_out = self._ran_out, False
            return out

    def wait_below(self, rows: int, timeout_s: float, unless: Callable[[], bool] = lambda: False) -> bool:
        """Wait until fewer than `rows` wait; False after `timeout_s`, or where it is `unless`: see `wake`."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._rows) < rows or unless(), timeout_s)
            return len(self._rows) < rows and not unless()

    def wake(self) -> None:
        """Let whoever waits look again."""
        with self._changed:
            self._changed.notify_all()
