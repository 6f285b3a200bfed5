"""The servos that hear a packet: those at the host's baud rate, by the id that they answer to now.

Two may have one id. Then both do what they are told and both answer at once: on an open-collector line a 0 wins.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.emulation.servo import EmulatedServo
from drivers.servos.dynamixel2 import Fault
from drivers.servos.family import Register


@dataclass(frozen=True)
class Event:
    """A register write that a servo took: at `time` s (CLOCK_MONOTONIC), servo `id` set `name` to `value`."""

    time: float
    id: int
    name: str
    value: int


class Listeners:
    """Those of `servos` that hear; `events` takes the writes that they accept."""

    def __init__(self, servos: Sequence[EmulatedServo], events: deque[Event], now: float) -> None:
        self._events, self.now = events, now
        self._by_id: dict[int, list[EmulatedServo]] = {}
        for servo in servos:
            self._by_id.setdefault(servo.get("id"), []).append(servo)

    def ids(self) -> list[int]:
        """Ids that somebody answers to, in order."""
        return sorted(self._by_id)

    def at(self, ident: int) -> list[EmulatedServo]:
        """The servos with the id `ident`."""
        return self._by_id.get(ident, [])

    def write(self, servo: EmulatedServo, address: int, data: bytes) -> Fault:
        """Have `servo` take a write; its verdict."""
        ident, fault = servo.get("id"), servo.write(address, data)
        if not fault:
            names = [r.name for r in servo.covered(address, len(data))]
            self._events.extend(Event(self.now, ident, name, servo.get(name)) for name in names)
        return fault

    def take(self, servo: EmulatedServo, register: Register, data: bytes) -> None:
        """Have `servo` take a value of one register, where registers have no addresses that run on."""
        ident, value = servo.get("id"), register.decode(data)
        servo.accept(register.name, value)
        self._events.append(Event(self.now, ident, register.name, servo.get(register.name)))

    def write_at(self, ident: int, address: int, data: bytes) -> None:
        """Have all servos with the id `ident` take a write."""
        for servo in self.at(ident):
            self.write(servo, address, data)

    def together(self, ident: int, answer: Callable[[EmulatedServo], bytes]) -> bytes:
        """What the line carries when all servos with the id `ident` answer at once."""
        return collide([answer(servo) for servo in self.at(ident)])


def collide(answers: Sequence[bytes]) -> bytes:
    """What an open-collector line carries when all `answers` are sent at once: a 0 wins."""
    longest = max((len(a) for a in answers), default=0)
    line = b"\xff" * longest
    for each in answers:
        line = bytes(a & b for a, b in zip(line, each.ljust(longest, b"\xff"), strict=True))
    return line
