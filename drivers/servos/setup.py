"""Servos before they are a rig: who is on the wire, a new id for one of them, all of a rig made limp."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from drivers.bus import BusError
from drivers.servos.family import MAX_ID, Family, Register
from drivers.servos.line import Line, Unit
from drivers.servos.port import Port, Wire
from drivers.servos.pwm_bus import BOARDS, PwmBus
from drivers.servos.sdk import PINGS, SdkAsker, has_sdk
from drivers.servos.table import FAMILIES, family_of
from retarget.rig import Rig

SCAN_PATIENCE_S = 0.02  # a USB adapter's 16 ms, and a little
TRIES = 3


@dataclass(frozen=True)
class Found:
    """A servo that answered: which protocol, at which rate, with which id, and what it says that it is."""

    protocol: str
    baud: int
    id: int
    model: str


class Asker(Protocol):
    """Asks servos of one family at one rate that no rig names; a context manager. Raises BusError where the port fails.

    The maker's SDK on the serial paths of Dynamixel servos, this package's codecs on everything else.
    """

    def __enter__(self) -> Asker: ...

    def __exit__(self, *_: object) -> None: ...

    def present(self, highest_id: int) -> Iterator[tuple[int, str]]:
        """Each id from 0 to `highest_id` that answers, and its model."""
        ...

    def model(self, ident: int) -> str | None:
        """The model that servo `ident` says that it is; None where nobody answers."""
        ...

    def write(self, ident: int, register: Register, value: int) -> None:
        """Write a register of one byte."""
        ...


def asker(wire: str | Wire, family: Family, baud: int) -> Asker:
    """Who asks servos of `family` at `baud` on `wire`, not yet opened."""
    if isinstance(wire, str) and has_sdk(wire, family, baud):
        return SdkAsker(wire, family, baud)
    return CodecAsker(wire, family, baud)


class CodecAsker:
    """An `Asker` by the codec of `family`, one id at a time, on any wire."""

    def __init__(self, wire: str | Wire, family: Family, baud: int) -> None:
        self._port, self._family = Port(wire, baud, patience_s=SCAN_PATIENCE_S), family

    def __enter__(self) -> CodecAsker:
        self._port.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._port.__exit__()

    def present(self, highest_id: int) -> Iterator[tuple[int, str]]:
        """See `Asker`."""
        models = ((ident, self.model(ident)) for ident in range(highest_id + 1))
        yield from ((ident, model) for ident, model in models if model is not None)

    def model(self, ident: int) -> str | None:
        """See `Asker`: each model of the family is asked for its number as it would tell it."""
        codec = self._family.codec
        if not any(self._port.ask(codec, codec.ping(ident)) for _ in range(PINGS)):
            return None
        numbers = []
        for name, model in self._family.models.items():
            number = Line(self._port, self._family, [Unit(ident, "", model, name)]).model_number(ident)
            if model.number is None or number == model.number:
                return name
            numbers.append(number)
        return f"unknown ({numbers[0]})"

    def write(self, ident: int, register: Register, value: int) -> None:
        """See `Asker`."""
        self._port.send(self._family.codec.write(register.address, [(ident, register.encode(value))]))


def scan(
    wire: str | Wire,
    *,
    protocols: tuple[str, ...] = tuple(FAMILIES),
    bauds: tuple[int, ...] = (),
    highest_id: int = MAX_ID,
    told: Callable[[str, int], None] | None = None,
) -> Iterator[Found]:
    """Ask every id at every rate, by default all of each family; `told` hears which protocol and rate is next.

    Nothing is written and nothing moves. Raises BusError where the port fails or a protocol is unknown.
    """
    if unknown := [p for p in protocols if p not in FAMILIES]:
        raise BusError(f"protocol {unknown[0]!r} cannot be scanned; these can: {', '.join(FAMILIES)}")
    for family in (FAMILIES[p] for p in protocols):
        for baud in sorted(set(bauds or family.bauds) & set(family.bauds), reverse=True):
            if told is not None:
                told(family.name, baud)
            with asker(wire, family, baud) as servos:
                for ident, model in servos.present(highest_id):
                    yield Found(family.name, baud, ident, model)


def set_id(wire: str | Wire, protocol: str, baud: int, old: int, new: int) -> Found:
    """Give servo `old` the id `new`; torque goes off first. Raises BusError where it is not there or `new` is taken."""
    if protocol not in FAMILIES:
        raise BusError(f"protocol {protocol!r} has no ids; these have: {', '.join(FAMILIES)}")
    family = FAMILIES[protocol]
    for ident in (old, new):
        if not 0 <= ident <= MAX_ID:
            raise BusError(f"id {ident}; it is in 0…{MAX_ID}")
    with asker(wire, family, baud) as servos:
        name = servos.model(old)
        if name is None:
            where = wire if isinstance(wire, str) else wire.path
            raise BusError(f"no {protocol} servo {old} answers on {where} at {baud} baud")
        if servos.model(new) is not None:
            raise BusError(f"id {new} is taken: two servos with one id cannot be told apart")
        registers = (family.models.get(name) or next(iter(family.models.values()))).by_name
        servos.write(old, registers["torque_enable"], 0)
        lock = registers["lock"] if protocol == "feetech" else None  # What is written while it is on is forgotten.
        if lock is not None:
            servos.write(old, lock, 0)
        servos.write(old, registers["id"], new)
        if servos.model(new) is None:
            raise BusError(f"servo {old} does not answer as {new}")
        if lock is not None:
            servos.write(new, lock, 1)
    return Found(protocol, baud, new, name)


def relax(rig: Rig, wire: str | Wire) -> list[str]:
    """Torque off for every servo of `rig`, whatever else is wrong; the joints of those that did not confirm it."""
    if rig.buses and rig.buses[0].protocol in BOARDS:
        with PwmBus(rig, wire) as board:
            board.torque(False)
        return []
    family = family_of(rig)
    left = {s.id: s.joint for s in rig.servos}
    units = [Unit(s.id, s.joint, family.models[s.model.name], s.model.name) for s in rig.servos]
    with Port(wire, rig.buses[0].baud) as port:
        line = Line(port, family, units)
        for _ in range(TRIES):
            line.write("torque_enable", dict.fromkeys(left, 0))
            for ident in list(left):
                if _says_off(line, ident):
                    del left[ident]
    return list(left.values())


def _says_off(line: Line, ident: int) -> bool:
    unit = line.units[ident]
    register = unit.model.by_name["torque_enable"]
    [request] = line.family.codec.read([ident], register.address, register.size, group=False, fast=False)
    reply = line.port.ask(line.family.codec, request).get(ident)
    return reply is not None and register.decode(reply.data) == 0
