"""The front desk of a service: who may say what the rig does, what was asked for, and whether the rigs are well."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from drivers.clock import Ticker
from drivers.control import Answer, Look, Rest, RigStatus, Say, Status
from drivers.publisher import Caller, Publisher
from rigcast.service.lease import Lease
from rigcast.service.orders import MOST, Order, Orders

NS = 1_000_000_000


@dataclass(frozen=True)
class Settings:
    """`rate_hz` frames a second; a sender has the rig for `lease_s` s after the last motion that was its own."""

    rate_hz: float = 50.0
    lease_s: float = 10.0
    generator: str = ""


class Desk:
    """Takes requests off the control socket of `publisher`; `orders` are the prompts that were taken.

    `leaving`: nothing more is taken. `unwell`: why nobody may go on with the rigs, "" where all is well.
    """

    def __init__(
        self,
        rig: str,
        publisher: Publisher,
        settings: Settings,
        clock: Ticker,
        tell: Callable[[Caller, Answer], None] | None = None,
    ) -> None:
        """`tell` answers a caller, by default over the control socket."""
        self._rig, self._publisher, self._settings, self._clock = rig, publisher, settings, clock
        self._lease = Lease(settings.lease_s)
        self.orders = Orders(tell or publisher.tell)
        self.leaving, self.unwell = False, ""

    def requests(self, status: Callable[[str], Status]) -> Iterator[tuple[Caller, Say | Rest]]:
        """What was asked for since the last call and may be, from then on by that caller alone; who asks how things
        stand is told the `status`, and who asks for what may not be, why."""
        now = self._clock.now_ns()
        for caller, request in self._publisher.requests():
            name = caller.name or "somebody"
            if isinstance(request, Look):
                self._publisher.tell(caller, status(request.id))
            elif objection := self.objection(request, name):
                self.orders.refuse(caller, request.id, objection)
            else:
                self._lease.give(name, now)
                if isinstance(request, Rest):
                    self._publisher.roster.forget_unwell()
                yield Caller(caller.key, name), request
        if len(self.orders):
            self._lease.keep(now)

    def objection(self, request: Say | Rest, name: str | None = None) -> str:
        """Why `name` may not ask for this now, "" where it may; None: somebody at the machine, for whom all wait."""
        if self.leaving:
            return "the service is ending"
        if self._publisher.stopped:
            return f"{self.unwell}; start the service again at its machine"
        if name is not None and (objection := self._lease.objection(name, self._clock.now_ns())):
            return objection
        if isinstance(request, Rest):
            return ""
        if self.unwell:
            return f"{self.unwell}; start its driver again at the rig, or go on without it by asking for rest"
        return f"{len(self.orders)} prompts are waiting; at most {MOST} do" if len(self.orders) >= MOST else ""

    def fell_ill(self) -> bool:
        """Whether the stream was stopped or a rig has tripped since the last call: nobody goes on with it."""
        stopped = self._publisher.stopped
        before, self.unwell = self.unwell, f"stopped: {stopped}" if stopped else self._publisher.roster.unwell()
        return bool(self.unwell) and not before

    def status(self, id: str, playing: Order | None, left_s: float) -> Status:
        """How things stand while `playing` is shown for `left_s` more seconds."""
        now = self._clock.now_ns()
        return Status(
            id=id,
            rig=self._rig,
            generator=self._settings.generator,
            mode=self._mode(playing is not None),
            reason=self.unwell,
            playing=playing.say.text if playing else "",
            left_s=left_s if playing else 0.0,
            waiting=self.orders.texts(),
            owner=self._lease.owner(now),
            rigs=tuple(
                RigStatus(
                    member.state.rig,
                    member.sender,
                    member.state.mode,
                    member.state.reason,
                    (now - member.heard_ns) / NS,
                    member.offset.seconds,
                    min(member.offset.error_s, 1e9),
                )
                for member in self._publisher.roster
            ),
        )

    def _mode(self, playing: bool) -> Literal["idle", "playing", "resting", "stopped"]:
        if self._publisher.stopped:
            return "stopped"
        if self.unwell:
            return "resting"
        return "playing" if playing else "idle"
