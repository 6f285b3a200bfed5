"""Servos before they are a rig: who is on the wire, a new id for one of them, all of a rig made limp."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from drivers.bus import BusError
from drivers.servos.family import MAX_ID, Family, Model
from drivers.servos.line import Line, Unit
from drivers.servos.port import Port, Wire
from drivers.servos.pwm_bus import BOARDS, PwmBus
from drivers.servos.table import FAMILIES, family_of
from retarget.rig import Rig

SCAN_PATIENCE_S = 0.02  # a USB adapter's 16 ms, and a little
TRIES = 3
PINGS = 2  # One lost byte hides nobody.


@dataclass(frozen=True)
class Found:
    """A servo that answered: which protocol, at which rate, with which id, and what it says that it is."""

    protocol: str
    baud: int
    id: int
    model: str


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
            with Port(wire, baud, patience_s=SCAN_PATIENCE_S) as port:
                for ident in range(highest_id + 1):
                    model = _model_at(port, family, ident)
                    if model is not None:
                        yield Found(family.name, baud, ident, model)


def set_id(wire: str | Wire, protocol: str, baud: int, old: int, new: int) -> Found:
    """Give servo `old` the id `new`; torque goes off first. Raises BusError where it is not there or `new` is taken."""
    if protocol not in FAMILIES:
        raise BusError(f"protocol {protocol!r} has no ids; these have: {', '.join(FAMILIES)}")
    family = FAMILIES[protocol]
    for ident in (old, new):
        if not 0 <= ident <= MAX_ID:
            raise BusError(f"id {ident}; it is in 0…{MAX_ID}")
    with Port(wire, baud) as port:
        name = _model_at(port, family, old)
        if name is None:
            raise BusError(f"no {protocol} servo {old} answers on {port.path} at {baud} baud")
        if _model_at(port, family, new) is not None:
            raise BusError(f"id {new} is taken: two servos with one id cannot be told apart")
        model = family.models.get(name) or next(iter(family.models.values()))
        line = Line(port, family, [Unit(i, "", model, name) for i in (old, new)])
        line.write("torque_enable", {old: 0})
        if "lock" in model.by_name:
            line.write("lock", {old: 0})  # Feetech servos forget what is written while they are locked.
        line.write("id", {old: new})
        if _model_at(port, family, new) is None:
            raise BusError(f"servo {old} does not answer as {new}")
        if "lock" in model.by_name:
            line.write("lock", {new: 1})
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


def _model_at(port: Port, family: Family, ident: int) -> str | None:
    """The model that servo `ident` says that it is; None where nobody answers."""
    if not any(port.ask(family.codec, family.codec.ping(ident)) for _ in range(PINGS)):
        return None
    numbers = []
    for name, model in family.models.items():
        number = Line(port, family, [Unit(ident, "", model, name)]).model_number(ident)
        if _is(model, number):
            return name
        numbers.append(number)
    return f"unknown ({numbers[0]})"


def _is(model: Model, number: int | None) -> bool:
    return model.number is None or number == model.number
