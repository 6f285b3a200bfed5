"""Cycles of a servo bus against the limit of its own wire: 20 Dynamixel X servos at 1 Mbps, goals out and state back.

The limit is the bytes of one cycle over the baud rate. Two ways to look at it:

- The wire emulated on its own clock, plus the processor time that the driver really spends: what a machine with
  nothing else to do would reach. Beside it the same with a USB adapter that keeps answers back for 1 and for 16 ms.
- A pty to an emulator in a process of its own, our driver and the maker's SDK in turn, with the same bytes: what this
  machine reaches now, and the share of a core that it takes.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from drivers.emulation.in_process import InProcess
from drivers.servos.packet_bus import PacketBus
from drivers.servos.port import BITS_PER_BYTE
from drivers.servos.x_series import X_SERIES
from retarget.rig import load_rig

RIG, RATE_HZ = "puppet", 100
WIRE_SHARE, CORE_SHARE = 0.90, 0.15  # targets
CYCLES, QUICK_CYCLES = 2000, 200
STATE_ADDRESS, STATE_SIZE = 224, 11
LATENCIES_S = (0.0, 1e-3, 16e-3)


@dataclass(frozen=True)
class Row:
    """Cycles a second, their share of the wire's limit, and the share of a core that RATE_HZ cycles a second take."""

    what: str
    rate: float
    of_limit: float
    core: float


def main() -> int:
    """Print the table; exit 1 with `--gate` where a target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    options = parser.parse_args()
    cycles = QUICK_CYCLES if options.quick else CYCLES
    limit = wire_limit()
    rows = [emulated(latency, cycles, limit) for latency in LATENCIES_S] + on_a_pty(cycles, limit)
    if options.json:
        print(json.dumps({"wire_limit": limit, "rows": [asdict(r) for r in rows]}, indent=2))
    else:
        print(f"20 servos at 1 Mbps: the wire allows {limit:.1f} cycles/s")
        for row in rows:
            print(f"{row.what:<44} {row.rate:7.1f}/s {row.of_limit:6.1%} of it, {row.core:6.1%} of a core at 100 Hz")
    first = rows[0]
    if options.gate and (first.of_limit < WIRE_SHARE or first.core > CORE_SHARE):
        print(
            f"short: {first.of_limit:.1%} of the wire's limit (at least {WIRE_SHARE:.0%}), "
            f"{first.core:.1%} of a core (at most {CORE_SHARE:.0%})"
        )
        return 1
    return 0


def wire_limit() -> float:
    """Cycles a second that the bytes of one cycle allow: goals, request, and one packet from all servos together."""
    rig = load_rig(RIG)
    ids, codec = [s.id for s in rig.servos], X_SERIES.codec
    goals = codec.write(116, [(i, bytes(4)) for i in ids])
    [request] = codec.read(ids, STATE_ADDRESS, STATE_SIZE, group=True, fast=True)
    return rig.buses[0].baud / ((len(goals) + len(request.data) + request.reply_bytes) * BITS_PER_BYTE)


class Metered(InProcess):
    """An emulated bus that knows how much processor time it took itself."""

    own_s = 0.0

    def write(self, data: bytes) -> int:
        """As `InProcess.write`."""
        began = time.process_time()
        try:
            return super().write(data)
        finally:
            self.own_s += time.process_time() - began


def emulated(latency_s: float, cycles: int, limit: float) -> Row:
    """Cycles one after the other on the emulated clock, to which the driver's own processor time is added."""
    rig = load_rig(RIG)
    wire = Metered(rig, latency_s=latency_s)
    with PacketBus(rig, wire) as bus:
        bus.torque(True)
        goal = bus.read().position
        bus.write(goal)
        own, cpu, wire_s = wire.own_s, time.process_time(), wire.now()
        for _ in range(cycles):
            bus.read()
            bus.write(goal)
        host_s = (time.process_time() - cpu - (wire.own_s - own)) / cycles
        cycle_s = (wire.now() - wire_s) / cycles + host_s
    what = "ours, emulated clock" + (f", {latency_s * 1e3:.0f} ms of USB latency" if latency_s else "")
    return Row(what, 1 / cycle_s, 1 / cycle_s / limit, host_s * RATE_HZ)


def on_a_pty(cycles: int, limit: float) -> list[Row]:
    """Our driver and the SDK on a pty, with the emulator in a process of its own."""
    rig = load_rig(RIG)
    command = [sys.executable, "-m", "rigcast", "bus", "emulate", "--rig", RIG]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        assert emulator.stdout is not None
        port = emulator.stdout.readline().strip()
        try:
            with PacketBus(rig, port, watchdog_s=2.0) as bus:
                bus.torque(True)
                goal = np.array(bus.read().position)

                def ours() -> None:
                    bus.read()
                    bus.write(goal)

                ours()
                rows = [_timed("ours, pty", ours, cycles, limit)]
            rows.append(_timed("dynamixel_sdk, pty", sdk_cycle(port, [s.id for s in rig.servos]), cycles, limit))
        finally:
            emulator.terminate()
    return rows


def sdk_cycle(path: str, ids: list[int]) -> Callable[[], None]:
    """A cycle of the same bytes with the maker's SDK."""
    from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PacketHandler, PortHandler

    port, handler = PortHandler(path), PacketHandler(2.0)
    if not port.setBaudRate(1_000_000):
        raise SystemExit(f"the SDK cannot open {path}")
    read = GroupSyncRead(port, handler, STATE_ADDRESS, STATE_SIZE)
    for ident in ids:
        read.addParam(ident)

    def cycle() -> None:
        write = GroupSyncWrite(port, handler, 116, 4)
        for ident in ids:
            write.addParam(ident, (2048).to_bytes(4, "little"))
        write.txPacket()
        if read.fastSyncRead() == COMM_SUCCESS:
            for ident in ids:
                read.getData(ident, STATE_ADDRESS + 4, 4)

    return cycle


def _timed(what: str, cycle: Callable[[], None], cycles: int, limit: float) -> Row:
    cpu, began = time.process_time(), time.monotonic()
    for _ in range(cycles):
        cycle()
    rate = cycles / (time.monotonic() - began)
    return Row(what, rate, rate / limit, (time.process_time() - cpu) / cycles * RATE_HZ)


if __name__ == "__main__":
    sys.exit(main())
