"""kill -9 of a driver at random moments, for every make of servo: how long until every servo of the rig is limp.

The servos are emulated behind a pty in this process; the driver, moving them, is a process of its own, and so is its
guard. The time runs from the kill to the last servo's torque off.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import sys
import time
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

from makes import MAKES, rig_of

from drivers.emulation.emulator import Emulator
from drivers.servos.connect import connect

SAFE_S = 0.3  # target
GIVEN_UP_S = 5.0
LAST_WORDS_S = 0.15  # The guard says them several times; the port must be there for so long.
TIMES, QUICK_TIMES = 200, 3


@dataclass(frozen=True)
class Row:
    """Seconds from the kill to limp: middle and longest of `kills`; `never`: how many were not limp in GIVEN_UP_S.

    `death_s`: the longest that a killed driver took to end, for on a busy machine it waits for its turn to. `lost`:
    drivers that did not get as far as moving the servos; others took their place.
    """

    protocol: str
    kills: int
    middle_s: float
    longest_s: float
    never: int
    death_s: float
    lost: int

    def __str__(self) -> str:
        times = f"{self.middle_s * 1e3:.0f} ms, {self.longest_s * 1e3:.0f} ms at most"
        deaths = f"a death took {self.death_s * 1e3:.0f} ms at most; {self.lost} drivers did not start"
        return f"{self.protocol:<12} {self.kills} kills: limp in {times}; never: {self.never}; {deaths}"


def main() -> int:
    """Print the table; exit 1 with `--gate` where the target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", choices=MAKES, help="one make of servo")
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where the target is missed")
    options = parser.parse_args()
    rows = []
    for protocol in [options.only] if options.only else MAKES:
        rows.append(killed(protocol, QUICK_TIMES if options.quick else TIMES))
        if not options.json:
            print(rows[-1], flush=True)
    if options.json:
        print(json.dumps([asdict(r) for r in rows], indent=2))
    missed = [r.protocol for r in rows if r.never or r.longest_s > SAFE_S]
    if options.gate and missed:
        print(f"not limp within {SAFE_S} s: {', '.join(missed)}")
        return 1
    return 0


def killed(protocol: str, times: int) -> Row:
    """Kill so many drivers of one make of servo; each time is told on stderr. Exits where most do not start."""
    processes = multiprocessing.get_context("forkserver")  # Drivers do not inherit the emulator.
    took: list[float] = []
    deaths: list[float] = []
    never = lost = 0
    while len(took) < times:
        hears, tells = processes.Pipe(duplex=False)
        with Emulator(rig_of(protocol)) as emulator:
            driver = processes.Process(target=drive, args=(protocol, emulator.port, tells))
            driver.start()
            tells.close()
            try:
                hears.recv()
            except EOFError:
                lost += 1  # Too busy a machine: it said why, and is limp.
                if lost > times:
                    raise SystemExit(f"{protocol}: {lost} drivers did not get as far as moving the servos") from None
                continue
            while driver.is_alive() and not all(emulator.torque().values()):
                time.sleep(0.001)  # An SSC-32U answers nothing, so its driver moves on before the board has heard it.
            time.sleep(random.uniform(0.0, 0.1))
            limp_s, death_s = kill(driver, emulator)
            took.append(limp_s)
            deaths.append(death_s)
            never += any(emulator.torque().values())
            print(f"{protocol} {len(took)}: limp in {limp_s * 1e3:.0f} ms", file=sys.stderr, flush=True)
            time.sleep(LAST_WORDS_S)
    return Row(protocol, len(took), sorted(took)[len(took) // 2], max(took), never, max(deaths), lost)


def kill(driver: BaseProcess, emulator: Emulator) -> tuple[float, float]:
    """Seconds until all servos are limp, GIVEN_UP_S at most, and until the driver has ended."""
    began = time.monotonic()
    driver.kill()
    limp_s = death_s = 0.0
    while not (limp_s and death_s):
        now = time.monotonic() - began
        if not limp_s and (now > GIVEN_UP_S or not any(emulator.torque().values())):
            limp_s = time.monotonic() - began
        if not death_s and not driver.is_alive():
            death_s = time.monotonic() - began
        time.sleep(0.001)
    return limp_s, death_s


def drive(protocol: str, port: str, tells: Connection) -> None:
    """Move the servos until killed; says when it begins to."""
    with connect(rig_of(protocol), port, guarded=True) as bus:
        bus.torque(True)
        start = bus.read().position
        tells.send("on")
        k = 0
        while True:
            k += 1
            bus.write(start + 0.01 * (k % 7))
            bus.read()
            time.sleep(0.01)


if __name__ == "__main__":
    sys.exit(main())
