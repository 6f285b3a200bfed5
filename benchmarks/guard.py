"""kill -9 of a driver at random moments, for every make of servo: how long until every servo of the rig is limp.

The servos are emulated behind a pty in this process; the driver, moving them, is a process of its own, and so is its
guard. The time runs from the kill to the last servo's torque off.
"""

from __future__ import annotations

import argparse
import json
import random
import subprocess
import sys
import time
from dataclasses import asdict, dataclass, replace

from drivers.emulation.emulator import Emulator
from drivers.servos.connect import connect
from retarget.rig import Bus, Rig, load_rig
from retarget.servos import servo_models

SAFE_S = 0.3  # target
GIVEN_UP_S = 5.0
LAST_WORDS_S = 0.15  # The guard says them several times; the port must be there for so long.
TIMES, QUICK_TIMES = 200, 3
JOINTS = ("head_pan", "head_tilt", "left_elbow")
MODELS = {
    "dynamixel2": ("XM430-W350", 1_000_000),
    "dynamixel1": ("AX-12A", 1_000_000),
    "feetech": ("STS3215", 1_000_000),
    "lx16a": ("LX-16A", 115_200),
    "maestro": ("HS-645MG", 115_200),
    "ssc32": ("HS-645MG", 115_200),
}


@dataclass(frozen=True)
class Row:
    """Seconds from the kill to limp: middle and longest of `kills`; `never`: how many were not limp in GIVEN_UP_S."""

    protocol: str
    kills: int
    middle_s: float
    longest_s: float
    never: int

    def __str__(self) -> str:
        times = f"{self.middle_s * 1e3:.0f} ms, {self.longest_s * 1e3:.0f} ms at most"
        return f"{self.protocol:<12} {self.kills} kills: limp in {times}; never: {self.never}"


def main() -> int:
    """Print the table; exit 1 with `--gate` where the target is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where the target is missed")
    parser.add_argument("--drive", nargs=2, metavar=("PROTOCOL", "PORT"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.drive:
        return drive(*options.drive)
    rows = []
    for protocol in MODELS:
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
    """Kill so many drivers of one make of servo."""
    took: list[float] = []
    never = 0
    for _ in range(times):
        with Emulator(rig_of(protocol)) as emulator:
            command = [sys.executable, __file__, "--drive", protocol, emulator.port]
            with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as driver:
                if driver.stdout is None or driver.stdout.readline() != "on\n":
                    continue  # Too busy a machine: it said why, and is limp.
                time.sleep(random.uniform(0.0, 0.1))
                driver.kill()
                began = time.monotonic()
                while any(emulator.torque().values()) and time.monotonic() - began < GIVEN_UP_S:
                    time.sleep(0.001)
                took.append(time.monotonic() - began)
                never += any(emulator.torque().values())
                time.sleep(LAST_WORDS_S)
    return Row(protocol, len(took), sorted(took)[len(took) // 2], max(took), never)


def drive(protocol: str, port: str) -> int:
    """Move the servos until killed."""
    with connect(rig_of(protocol), port, guarded=True) as bus:
        bus.torque(True)
        start = bus.read().position
        print("on", flush=True)
        k = 0
        while True:
            k += 1
            bus.write(start + 0.01 * (k % 7))
            bus.read()
            time.sleep(0.01)


def rig_of(protocol: str) -> Rig:
    """Three joints of the puppet on servos of another make."""
    model, baud = MODELS[protocol]
    rig = load_rig("puppet")
    servos = tuple(replace(s, model=servo_models()[model]) for s in rig.servos if s.joint in JOINTS)
    return replace(rig, buses=(Bus("main", protocol, baud),), servos=servos)


if __name__ == "__main__":
    sys.exit(main())
