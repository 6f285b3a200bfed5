"""Who may say what the rig does: one sender at a time, for as long as it has something to say."""

from __future__ import annotations

NS = 1_000_000_000


class Lease:
    """Belongs to the first who asks, until `seconds` after the last that was done for it. Times: ns of one clock."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._owner = ""
        self._until_ns = 0

    def owner(self, now_ns: int) -> str:
        """Whose it is, "" where nobody's."""
        return self._owner if now_ns < self._until_ns else ""

    def objection(self, name: str, now_ns: int) -> str:
        """Why `name` may not say anything now; "" where it may."""
        owner = self.owner(now_ns)
        return "" if owner in ("", name) else f"{owner!r} has the rig, until {self._seconds:g} s after its last motion"

    def give(self, name: str, now_ns: int) -> None:
        """`name` has said something."""
        self._owner = name
        self.keep(now_ns)

    def keep(self, now_ns: int) -> None:
        """Something is done for the owner just now."""
        self._until_ns = now_ns + int(self._seconds * NS)
