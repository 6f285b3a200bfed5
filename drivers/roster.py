"""The rigs that follow a stream, as they last told: who is there, who is not well, whose clock is how far from ours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from drivers.messages import Mode, RigState
from drivers.offset import Offset

NS = 1_000_000_000
MOST_RIGS = 64  # Where no keys are used, anybody may claim to be one.
GONE_NS = NS  # A driver that was started anew: the run before it has been silent for so long.
UNWELL: tuple[Mode, ...] = ("tripped", "stopped", "safe")


@dataclass
class Member:
    """A rig that told `state` at `heard_ns`, our clock; `sender` is whose key it came with."""

    sender: str
    state: RigState
    heard_ns: int
    offset: Offset = field(default_factory=Offset)
    passed_ns: int = 0


class Roster:
    """The newest state of each run of each rig, of `MOST_RIGS` at most: who was silent longest is forgotten first."""

    def __init__(self) -> None:
        self._members: dict[tuple[str, str, int], Member] = {}

    def __iter__(self) -> Iterator[Member]:
        return iter(self._members.values())

    def note(self, sender: str, state: RigState, now_ns: int) -> None:
        """`state` came at `now_ns`, our clock, from the owner of the key `sender`, "" without keys."""
        key = (sender, state.rig, state.run)
        member = self._members.get(key)
        if member is None:
            self._forget_runs_before(key, now_ns)
            member = self._members[key] = Member(sender, state, now_ns)
        member.state, member.heard_ns = state, now_ns
        if state.heard_ns:
            member.offset.note(state.frame_ns, state.heard_ns, state.time_ns, now_ns)

    def unwell(self) -> str:
        """Which rig has tripped, was stopped or went safe, and why; "" where none has. It is well again once it says
        so: after somebody at the rig has started its driver anew.
        """
        for member in self:
            if member.state.mode in UNWELL:
                return f"{member.state.rig} is {member.state.mode}: {member.state.reason}"
        return ""

    def forget_unwell(self) -> None:
        """Go on without those that are not well."""
        self._members = {key: m for key, m in self._members.items() if m.state.mode not in UNWELL}

    def _forget_runs_before(self, key: tuple[str, str, int], now_ns: int) -> None:
        for other, member in list(self._members.items()):
            if other[:2] == key[:2] and now_ns - member.heard_ns > GONE_NS:
                del self._members[other]
        if len(self._members) >= MOST_RIGS:
            del self._members[min(self._members, key=lambda k: self._members[k].heard_ns)]
