"""How often somebody may send: so many messages a second, and as many at once after a silence."""

from __future__ import annotations

NS = 1_000_000_000


class Rate:
    """At most `per_s` messages a second from each sender, on average; up to `per_s` at once after a second's silence.

    It remembers each sender that it has seen: they must be few, as those are whose keys were allowed.
    """

    def __init__(self, per_s: int) -> None:
        self._each_ns = NS // per_s
        self._free_ns: dict[str, int] = {}

    def allows(self, sender: str, now_ns: int) -> bool:
        """Whether the message that `sender` sends at `now_ns` is within the rate; one that is not costs nothing."""
        free = max(self._free_ns.get(sender, 0), now_ns - NS)
        if free + self._each_ns > now_ns:
            return False
        self._free_ns[sender] = free + self._each_ns
        return True
