"""A bus on which one byte in ten, or in a hundred, is corrupted, driven for 10,000 cycles with every make of servo.

Both ways are hurt. Where so many packets fail in a row that the bus gives up, at which a drive would let the rig go,
the line is made clean for one reading, and it goes on. Counted: answers that were damaged, those of them that pass the
checksum although they are wrong, positions that the driver took, and those that no servo could have got to.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from dataclasses import asdict, dataclass

import numpy as np
from makes import rig_of

from drivers.bus import BusError
from drivers.emulation.in_process import InProcess
from drivers.emulation.noise import Noise
from drivers.servos.connect import connect
from drivers.servos.family import Packet, Parser
from drivers.servos.packet_bus import FASTER, SLACK
from drivers.servos.table import family_of
from retarget.rig import Rig

CYCLES, QUICK_CYCLES = 10_000, 300
SHARES = (0.1, 0.01)
LETS_THROUGH = {"dynamixel2": 1 / 65536, "dynamixel1": 1 / 256, "feetech": 1 / 256, "lx16a": 1 / 256}


@dataclass(frozen=True)
class Row:
    """Of `cycles` driven with `corrupt` of the bytes: how often the bus gave up; answers damaged, wrong ones that pass
    the sum, and how many may (four standard deviations up); positions taken, and those that are faster than the servo.
    """

    protocol: str
    corrupt: float
    cycles: int
    gave_up: int
    damaged: int
    passed: int
    may_pass: float
    taken: int
    too_fast: int

    def __str__(self) -> str:
        sums = f"{self.damaged} answers damaged, {self.passed} pass the sum (at most {self.may_pass:.0f})"
        return (
            f"{self.protocol:<12} {self.corrupt:.0%}: gave up in {self.gave_up} of {self.cycles} cycles; {sums}; "
            f"{self.taken} positions taken, {self.too_fast} faster than the servo"
        )


class Listening(InProcess):
    """An emulated bus that compares what it answered with what the host hears."""

    def __init__(self, rig: Rig) -> None:
        super().__init__(rig, seed=1)
        self._codec = family_of(rig).codec
        self.damaged = self.passed = 0

    def exchange(self, data: bytes, arrived: float, host_baud: int) -> list[tuple[float, bytes]]:
        """As `EmulatedLine.exchange`, and counts."""
        bus, said = self.bus, []

        class Told:
            """The bus, whose answers are noted."""

            def exchange(self, data: bytes, now: float, baud: int) -> list[tuple[float, bytes]]:
                said.extend(bus.exchange(data, now, baud))
                return said[:]

        self.bus = Told()  # type: ignore[assignment]
        try:
            heard = super().exchange(data, arrived, host_baud)
        finally:
            self.bus = bus
        for (_, truth), (_, got) in zip(said, heard, strict=True):
            if truth != got:
                self.damaged += 1
                right = self._packets(truth)
                self.passed += any(packet not in right for packet in self._packets(got))
        return heard

    def _packets(self, data: bytes) -> list[Packet]:
        parser: Parser = self._codec.parser()
        return parser.feed(data)


def main() -> int:
    """Print the table; exit 1 with `--gate` where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=LETS_THROUGH, help="one make of servo")
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    options = parser.parse_args()
    rows = []
    for protocol in [options.only] if options.only else LETS_THROUGH:
        for corrupt in SHARES:
            rows.append(driven(protocol, QUICK_CYCLES if options.quick else CYCLES, corrupt))
            if not options.json:
                print(rows[-1], flush=True)
    if options.json:
        print(json.dumps([asdict(row) for row in rows], indent=2))
    missed = [row.protocol for row in rows if row.too_fast or row.passed > row.may_pass]
    if options.gate and missed:
        print(f"taken too fast, or more passes than the sum may let through: {', '.join(missed)}")
        return 1
    return 0


def driven(protocol: str, cycles: int, corrupt: float) -> Row:
    """Swing the servos of one make for so many cycles of 20 ms, `corrupt` of the bytes being wrong."""
    rig = rig_of(protocol)
    wire = Listening(rig)
    pace = FASTER * np.array([s.model.no_load_speed for s in rig.servos])
    gave_up = taken = too_fast = 0
    last: tuple[float, np.ndarray] | None = None
    with connect(rig, wire) as bus:
        bus.torque(True)
        start = bus.read().position
        for k in range(cycles):
            wire.noise = Noise(corrupt=corrupt)
            try:
                bus.write(start + 0.3 * math.sin(0.05 * k))
                position = bus.read().position
            except BusError:
                gave_up += 1
                wire.noise = Noise()
                last = wire.now(), bus.read().position
            else:
                if last is not None:
                    moved = np.abs(position - last[1])
                    taken += int((moved > 0).sum())
                    too_fast += int((moved > pace * (wire.now() - last[0]) + 2 * SLACK).sum())
                last = wire.now(), position
            wire.wait(0.02)
        wire.noise = Noise()
    share = LETS_THROUGH[protocol]
    may_pass = wire.damaged * share + 4 * math.sqrt(wire.damaged * share) + 1
    return Row(protocol, corrupt, cycles, gave_up, wire.damaged, wire.passed, may_pass, taken, too_fast)


if __name__ == "__main__":
    sys.exit(main())
