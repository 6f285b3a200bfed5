"""How far apart the clocks of two machines are, from messages that go there and back (as NTP does, RFC 5905 § 8)."""

from __future__ import annotations

from collections import deque

REMEMBERED = 64  # The least delayed of the last so many tells most: delays only ever add.


class Offset:
    """Their clock less ours. Times in nanoseconds, each of the clock of who took it."""

    def __init__(self) -> None:
        self._seen: deque[tuple[int, int]] = deque(maxlen=REMEMBERED)

    def note(self, sent: int, heard: int, answered: int, came: int) -> None:
        """We sent at `sent`, they had it at `heard` and answered at `answered`, which came at `came`.

        What cannot be so, as when a clock has stepped, is left out.
        """
        delay = (came - sent) - (answered - heard)
        if delay >= 0 and answered >= heard:
            self._seen.append((delay, ((heard - sent) + (answered - came)) // 2))

    @property
    def seconds(self) -> float:
        """Their clock less ours; 0.0 before anything was heard."""
        return min(self._seen)[1] * 1e-9 if self._seen else 0.0

    @property
    def error_s(self) -> float:
        """It cannot be off by more than this: half the time that was spent on the way; infinite at first."""
        return min(self._seen)[0] * 0.5e-9 if self._seen else float("inf")
