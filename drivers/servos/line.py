"""Servos on an open port, by register name: reads with retries, and errors that name the servo and its joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.bus import BusError, ServoError
from drivers.servos.family import Block, Family, Model, Reply, Request
from drivers.servos.port import Port

TRIES = 5


@dataclass(frozen=True)
class Unit:
    """One servo on the line: its id, the joint that it turns, its model and that model's name."""

    id: int
    joint: str
    model: Model
    model_name: str

    def __str__(self) -> str:
        return f"servo {self.id} ({self.joint})" if self.joint else f"servo {self.id} ({self.model_name})"


class Line:
    """The `units` of one family behind `port`. Every method raises BusError where the port is lost."""

    def __init__(self, port: Port, family: Family, units: Sequence[Unit]) -> None:
        self.port, self.family = port, family
        self.units = {u.id: u for u in units}
        self._fast_failures = 0

    def model_number(self, ident: int) -> int | None:
        """What servo `ident` says that it is, 0 where the family has no such register; None where nobody answers."""
        reply = self._first(self.family.codec.ping(ident))
        if reply is None:
            return None
        if len(reply.data) == 3:  # protocol 2.0 tells it in the ping
            return int.from_bytes(reply.data[:2], "little")
        model = self.units[ident].model
        if "model_number" not in model.by_name:
            return 0
        register = model.by_name["model_number"]
        [request] = self.family.codec.read([ident], register.address, register.size, group=False, fast=False)
        number = self._first(request)
        return None if number is None else register.decode(number.data)

    def check_models(self) -> None:
        """Raises BusError where a servo is not there or is of another model than the rig names."""
        found = {i: self.model_number(i) for i in self.units}
        missing = [str(self.units[i]) for i, number in found.items() if number is None]
        if len(missing) == len(self.units):
            raise BusError(
                f"no {self.family.name} servo answers on {self.port.path} at {self.port.baud} baud: "
                "check power, cable, baud rate and protocol"
            )
        if missing:
            raise BusError(f"no answer on {self.port.path} from {', '.join(missing)}")
        for unit in self.units.values():
            expected = unit.model.number
            if expected is not None and found[unit.id] != expected:
                raise BusError(f"{unit}: model {found[unit.id]}; the rig names {unit.model_name}, {expected}")

    def read(self, name: str, idents: Sequence[int] | None = None, *, alerts: bool = True) -> dict[int, int]:
        """Register `name` of the servos `idents`, by default of all that have it, by id.

        Raises BusError naming the servos that do not answer or, with `alerts`, that have a hardware error; ServoError
        where it is one.
        """
        values: dict[int, int] = {}
        for model, ids in self._by_model(self.units if idents is None else idents, name):
            rows = self.read_block(model.block([name]), ids, group=model.group_read, alerts=alerts)
            values |= {i: row[name] for i, row in rows.items()}
        return values

    def read_block(
        self,
        block: Block,
        idents: Sequence[int],
        *,
        group: bool,
        alerts: bool = True,
        found: Mapping[int, Reply] | None = None,
    ) -> dict[int, dict[str, int]]:
        """The registers of `block` of each servo, by id and name; `found` are answers that came already."""
        codec, replies = self.family.codec, dict(found or {})
        for _ in range(TRIES):
            missing = [i for i in idents if i not in replies]
            if not missing:
                break
            for request in codec.read(missing, block.address, block.size, group=group, fast=False):
                replies |= self.port.ask(codec, request)
        if missing := [i for i in idents if i not in replies]:
            what = self._silence(missing)
            raise ServoError(what, self.units[missing[0]].joint) if len(missing) == 1 else BusError(what)
        if alerts:
            for ident in idents:
                self.check(replies[ident])
        return {i: block.decode(replies[i].data) for i in idents}

    def state_request(self, block: Block, idents: Sequence[int]) -> Request:
        """One request for `block` of all `idents`: the fast one, until it has failed several times in a row."""
        fast = self._fast_failures < TRIES
        [request] = self.family.codec.read(idents, block.address, block.size, group=True, fast=fast)
        return request

    def note(self, answered: bool) -> None:
        """Whether a request for the state was answered whole: after TRIES that were not, no fast one is sent again."""
        if self._fast_failures < TRIES:
            self._fast_failures = 0 if answered else self._fast_failures + 1

    def write(self, name: str, values: Mapping[int, int]) -> None:
        """Write register `name` of the servos in `values`, by id; those without such a register are left out."""
        for data in self.frames(name, values):
            self.port.send(data)

    def frames(self, name: str, values: Mapping[int, int]) -> list[bytes]:
        """The bytes that write register `name`."""
        out = []
        for model, ids in self._by_model(values, name):
            register = model.by_name[name]
            out.append(self.family.codec.write(register.address, [(i, register.encode(values[i])) for i in ids]))
        return out

    def check(self, reply: Reply) -> None:
        """Raises ServoError where the error byte of `reply` tells of the servo's health."""
        bits = reply.error & self.family.alerts
        if not bits:
            return
        unit = self.units[reply.id]
        if unit.model.error_register is not None:
            bits = self.read(unit.model.error_register, [unit.id], alerts=False)[unit.id]
        self.fail(unit, bits)

    def fail(self, unit: Unit, bits: int) -> None:
        """Raises ServoError with the names of the error `bits` of `unit`."""
        names = [name for bit, name in unit.model.errors.items() if bits >> bit & 1]
        raise ServoError(
            f"{unit}: hardware error: {', '.join(names) or f'unknown (0x{bits:02x})'}; "
            "remove the cause, then power it anew",
            unit.joint,
        )

    def _first(self, request: Request) -> Reply | None:
        for _ in range(TRIES):
            if replies := self.port.ask(self.family.codec, request):
                return next(iter(replies.values()))
        return None

    def _by_model(self, idents: Sequence[int] | Mapping[int, object], name: str) -> list[tuple[Model, list[int]]]:
        """Servos that have a register `name`, grouped by where it lies."""
        groups: dict[tuple[int, int, bool], tuple[Model, list[int]]] = {}
        for ident in idents:
            model = self.units[ident].model
            if name in model.by_name:
                register = model.by_name[name]
                groups.setdefault((register.address, register.size, model.group_read), (model, []))[1].append(ident)
        return list(groups.values())

    def _silence(self, missing: Sequence[int]) -> str:
        names = ", ".join(str(self.units[i]) for i in missing)
        if self.port.garbled:
            return f"garbled answers on {self.port.path} from {names}: two servos with one id, or a bad cable"
        return f"no answer on {self.port.path} from {names}"
