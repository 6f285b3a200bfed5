"""What was asked of the service and is not done yet: in turn, with the sender of each told what becomes of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.control import Event, Say, Told
from drivers.publisher import Caller
from rigcast.service.making import Made

MOST = 16


@dataclass
class Order:
    """A prompt that was taken; `event` is what its sender was told last."""

    number: int
    caller: Caller
    say: Say
    event: Event = "queued"


class Orders:
    """Orders by number, the oldest first; `tell` answers a caller, `outcomes` counts how they ended."""

    def __init__(self, tell: Callable[[Caller, Told], None]) -> None:
        self._tell = tell
        self._all: dict[int, Order] = {}
        self._last = 0
        self.outcomes: dict[Event, int] = {"played": 0, "rejected": 0, "dropped": 0, "refused": 0}

    def __len__(self) -> int:
        return len(self._all)

    def texts(self) -> tuple[str, ...]:
        """Of those that are not being played."""
        return tuple(order.say.text for order in self._all.values() if order.event != "playing")

    def new_number(self) -> int:
        """A number that no order and no other job has."""
        self._last += 1
        return self._last

    def refuse(self, caller: Caller, id: str, why: str) -> None:
        """Tell that nothing will come of it."""
        self.outcomes["refused"] += 1
        self._tell(caller, Told(id, "refused", why[:1000]))

    def add(self, caller: Caller, say: Say) -> Order:
        """Take a prompt."""
        order = Order(self.new_number(), caller, say)
        self._tell(caller, Told(say.id, "queued", f"{len(self._all)} before it"))
        self._all[order.number] = order
        return order

    def get(self, number: int) -> Order | None:
        """The order of that number; None where it was dropped since."""
        return self._all.get(number)

    def next_to_make(self) -> Order | None:
        """The oldest that nobody has begun with."""
        return next((order for order in self._all.values() if order.event == "queued"), None)

    def came_to(self, order: Order, event: Event, detail: str = "", made: Made | None = None) -> None:
        """Tell the sender; with "played", "rejected" and "dropped" it is done with."""
        order.event = event
        if event in self.outcomes:
            self.outcomes[event] += 1
            del self._all[order.number]
        said = Told(order.say.id, event, detail[:1000])
        if made is not None:
            said = Told(order.say.id, event, detail[:1000], made.seconds, made.report_id, made.checks)
        self._tell(order.caller, said)

    def drop(self, why: str, keep: Order | None = None) -> None:
        """Let go of all of them, or of all but one."""
        for order in list(self._all.values()):
            if order is not keep:
                self.came_to(order, "dropped", why)
