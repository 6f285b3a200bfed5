"""What the servos of a line last said, kept fresh: in one packet where they can, in turn where they cannot.

Servos with indirect addressing are told to put torque, error and state side by side, so that one block holds them all.
Readings that a servo cannot have reached since its last are taken for damage and asked for again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.bus import ServoError
from drivers.servos.family import Block, Model, Register, Request
from drivers.servos.line import TRIES, Line, Unit

READ_S = 0.008  # Servos that answer one by one are read for so long in a cycle, in turn, and at least one.


class States:
    """Register values of every unit of `line`. `pace`, by id: ticks/s that the servo can make, and ticks of slack.

    Every method raises BusError where servos are silent, have a hardware error, or say what cannot be; ServoError where
    it is one.
    """

    def __init__(self, line: Line, pace: Mapping[int, tuple[float, float]]) -> None:
        self._line = line
        self._pace = dict(pace)
        self._values: dict[int, dict[str, int]] = {i: {} for i in line.units}
        self._kept: dict[int, dict[str, int]] = {i: {} for i in line.units}
        self._read_at: dict[int, float] = {}
        self._indirect: set[int] = set()
        self._plan()
        self._turn = self._slow_turn = 0
        self._asked: Request | None = None
        self.on = (
            False  # Torque is on: readings are held to what a servo can do, guarded registers to what was written.
        )

    def __getitem__(self, ident: int) -> dict[str, int]:
        """Values of servo `ident` by register name."""
        return self._values[ident]

    def read_all(self) -> None:
        """Everything of every servo, one after the other; garbled answers show here."""
        for unit in self._line.units.values():
            self._accept(unit, self._one(unit, self._blocks[unit.id]), self._line.port.asked_at)
            self._read_slow(unit)

    def keep(self, name: str, values: Mapping[int, int]) -> None:
        """Write what the servos must keep for as long as the torque is on."""
        self._line.write(name, values)
        for ident, value in values.items():
            self._kept[ident][name] = value

    def reset(self, *, on: bool) -> None:
        """The torque was switched: what was asked or known of the pace of things no longer counts."""
        self.on = on
        self._asked = None
        self._read_at.clear()

    def forget(self, ident: int) -> None:
        """The unit `ident` is no longer on the line: keep what it said last."""
        self._asked = None
        self._turn = self._slow_turn = 0
        self._indirect.discard(ident)
        self._plan()

    def ask(self, before: bytes) -> None:
        """Send `before` and the first group request behind it; `refresh` takes the answers."""
        if not self._groups:
            self._line.port.send(before)
            return
        self._asked = self._line.state_request(*self._groups[0])
        self._line.port.start(self._asked, before)

    def refresh(self) -> None:
        """Read all that are read together, as many of the others as there is time for, and one servo's slow values."""
        units = list(self._line.units.values())
        for block, ids in self._groups:
            self._read_group(block, ids)
        until = self._line.port.now() + READ_S
        for _ in self._singles:
            unit = self._singles[self._turn % len(self._singles)]
            self._turn += 1
            self._accept(unit, self._one(unit, self._blocks[unit.id]), self._line.port.asked_at)
            if self._line.port.now() > until:
                break
        self._read_slow(units[self._slow_turn % len(units)])
        self._slow_turn += 1

    def point(self) -> None:
        """Point the indirect addresses, where there are any, at torque, error and state; check that they do."""
        slots = {
            u.id: [r.address + k for r in _pointed(u.model) for k in range(r.size)]
            for u in self._line.units.values()
            if u.model.indirect is not None
        }
        self._indirect = set(slots)
        for k in range(max(map(len, slots.values()), default=0)):
            wanted = {i: s[k] for i, s in slots.items()}
            self._line.write(f"indirect_address_{k + 1}", wanted)
            said = self._line.read(f"indirect_address_{k + 1}", list(wanted))
            self._indirect -= {i for i in wanted if said[i] != wanted[i]}
        self._plan()

    def _plan(self) -> None:
        """What to read: a block for each servo, and which are read together."""
        units = self._line.units.values()
        self._blocks = {u.id: self._block(u) for u in units}
        self._singles = [u for u in units if not u.model.group_read]
        groups: dict[tuple[int, int], tuple[Block, list[int]]] = {}
        for unit in units:
            if unit.model.group_read:
                block = self._blocks[unit.id]
                groups.setdefault((block.address, block.size), (block, []))[1].append(unit.id)
        self._groups = list(groups.values())

    def _block(self, unit: Unit) -> Block:
        model = unit.model
        if unit.id not in self._indirect or model.indirect is None:
            return model.block(model.state)
        offsets, at = [], 0
        for register in _pointed(model):
            offsets.append((register, at))
            at += register.size
        return Block(model.indirect[1], at, tuple(offsets))

    def _read_group(self, block: Block, ids: Sequence[int]) -> None:
        port, codec = self._line.port, self._line.family.codec
        if self._asked is not None:
            found = port.collect(codec)
            self._asked = None
        else:
            found = port.ask(codec, self._line.state_request(block, ids))
        self._line.note(len(found) == len(ids))
        asked_at = port.asked_at
        rows = self._line.read_block(block, ids, group=True, found=found)
        for ident in ids:
            self._accept(self._line.units[ident], rows[ident], asked_at if ident in found else port.asked_at)

    def _one(self, unit: Unit, block: Block) -> dict[str, int]:
        return self._line.read_block(block, [unit.id], group=unit.model.group_read)[unit.id]

    def _read_slow(self, unit: Unit) -> None:
        for names in unit.model.slow:
            self._take(unit, self._one(unit, unit.model.block(names)))

    def _accept(self, unit: Unit, row: dict[str, int], asked_at: float) -> None:
        """Take `row`, which was asked for at `asked_at` s, once it says a position that the servo can have."""
        for _ in range(TRIES):
            if self._plausible(unit, row["present_position"], asked_at):
                break
            row, asked_at = self._one(unit, self._blocks[unit.id]), self._line.port.asked_at
        else:
            self._check_kept(unit, row)
            at = row["present_position"]
            raise ServoError(f"{unit}: says that it is at {at} ticks, where it cannot have got to", unit.joint)
        self._read_at[unit.id] = asked_at
        self._take(unit, row)

    def _plausible(self, unit: Unit, position: int, asked_at: float) -> bool:
        if not self.on or unit.id not in self._read_at:
            return True
        pace, slack = self._pace[unit.id]
        dt = asked_at - self._read_at[unit.id]
        return abs(position - self._values[unit.id]["present_position"]) <= pace * dt + slack

    def _take(self, unit: Unit, row: Mapping[str, int]) -> None:
        if bits := row.get(unit.model.error_register or "", 0):
            self._line.fail(unit, bits)
        self._check_kept(unit, row)
        self._values[unit.id] |= row

    def _check_kept(self, unit: Unit, row: Mapping[str, int]) -> None:
        for name, kept in self._kept[unit.id].items():
            if self.on and row.get(name, kept) != kept:
                fell = f"{name} fell from {kept} to {row[name]}"
                raise ServoError(f"{unit}: {fell}: it has rebooted (a dip of its supply?)", unit.joint)


def _pointed(model: Model) -> list[Register]:
    """What one block of indirect data holds."""
    names = ["torque_enable", *([model.error_register] if model.error_register else []), *model.state]
    return [model.by_name[n] for n in names]
