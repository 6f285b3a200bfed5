"""Half an hour of the live service at 200 Hz: what it leaves behind in memory and in files.

The service, its sockets, a rig that follows and tells its state, and a sender that asks for a gesture every ten seconds
are the real ones; motions come from a drawer instead of from a maker, and time is a counter, or with `--real` the
machine's. Then strangers: a hundred thousand damaged requests.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import zmq

from drivers.caller import ControlLine
from drivers.clock import MonotonicClock, Ticker
from drivers.control import Rest, Say
from drivers.endpoint import endpoints
from drivers.frame import Frame
from drivers.messages import RigState, pack
from drivers.publisher import Publisher
from drivers.receiver import Receiver
from drivers.samples import hello_for
from motiongen.gestures.generator import GestureGenerator
from retarget.cut import cut_short
from retarget.files import load_trajectory, save_trajectory
from retarget.retarget import retarget
from retarget.rig import Rig, load_rig
from rigcast.service.desk import Settings
from rigcast.service.making import Cut, Job, Made
from rigcast.service.player import IDLE, part_of
from rigcast.service.service import Service

RATE = 200.0
NS = 1_000_000_000
REPORT = "0123456789abcdef"
ASK_EVERY_S = 10.0
REPORTS = 200
MOST = {"leaked_bytes_per_frame": 1.0, "leaked_files": 0, "uncounted": 0}


class Counter:
    """A clock that is where it is waited for."""

    def __init__(self) -> None:
        self.ns = time.monotonic_ns()

    def now_ns(self) -> int:
        return self.ns

    def sleep_until_ns(self, when_ns: int) -> None:
        self.ns = max(self.ns, when_ns)


class Drawer:
    """A maker that has every motion ready a second after it was asked."""

    starts = 1

    def __init__(self, folder: Path, rig: Rig, clock: Ticker) -> None:
        self.busy, self._folder, self._rig, self._clock = False, folder, rig, clock
        self._wave = retarget(GestureGenerator().generate("wave"), rig)

    def ask(self, job: Job) -> None:
        self.busy, self._job, self._ready_ns = True, job, self._clock.now_ns() + NS

    def done(self) -> Made | None:
        if self._clock.now_ns() < self._ready_ns:
            return None
        self.busy, job = False, self._job
        whole = load_trajectory(job.path) if isinstance(job, Cut) else self._wave
        made = cut_short(whole, job.frame, self._rig) if isinstance(job, Cut) else whole
        path = self._folder / f"{job.number}.npz"
        save_trajectory(made, path)
        return Made(job.number, ok=True, path=str(path), seconds=made.duration, report_id=REPORT)


def soak(frames: int, clock: Ticker) -> dict[str, float]:
    """Growth over `frames` cycles of the service, after the first fifth of them; how many frames of it left late."""
    rig = load_rig("puppet")
    with tempfile.TemporaryDirectory() as room:
        folder, address = Path(room), f"ipc://{room}/stream"
        save_trajectory(retarget(GestureGenerator().generate("stand idle", seconds=16.0), rig), folder / "idle.npz")
        idle = part_of(IDLE, folder / "idle.npz", REPORT, RATE)
        makers = Drawer(folder, rig, clock), Drawer(folder, rig, clock)
        with (
            Publisher(hello_for(idle.trajectory, rig, REPORT, 1), address, clock=clock) as publisher,
            Receiver(address, rig_hash=rig.hash) as receiver,
            ControlLine(address) as sender,
        ):
            publisher.wait_for_subscriber(10)
            service = Service(rig, publisher, idle, *makers, Settings(RATE, 10.0), clock)
            at, sizes, files = [], [], []
            for k in range(frames):
                service.cycle()
                frame = receiver.poll(clock.now_ns())
                if frame is not None and k % 4 == 0:
                    receiver.send_state(_state(rig, frame, clock.now_ns()))
                if k % round(ASK_EVERY_S * RATE) == 0:
                    sender.ask(Say(f"n{k}", "wave", replace=k % 3 == 0))
                while sender._line.socket.poll(0):
                    sender._line.socket.recv()
                if k % (frames // REPORTS) == 0 and k > frames // 5:
                    at.append(k)
                    sizes.append(_resident())
                    files.append(len(os.listdir("/proc/self/fd")) + len(os.listdir(room)))
    return {
        "frames": frames,
        "late": service.counts["late"],
        "played": service.outcomes["played"],
        "cuts": service.counts["cuts"],
        "followed": receiver.gate.accepted,
        "leaked_bytes_per_frame": float(np.polyfit(at, sizes, 1)[0]),
        "leaked_files": float(np.round(np.polyfit(at, files, 1)[0] * frames)),
    }


def _state(rig: Rig, frame: Frame, now: int) -> RigState:
    angles = tuple(frame.pos[0].tolist())
    return RigState(rig.name, rig.hash, "following", "", frame.seq, now, angles, run=1)


def strangers(count: int) -> dict[str, float]:
    """`count` damaged requests over a socket: each is counted, and none leaves anything behind."""
    rng, clock = random.Random(1), Counter()
    rig = load_rig("puppet")
    samples = [pack(Say("a", "wave")), pack(Rest("b"))]
    idle = retarget(GestureGenerator().generate("stand idle", seconds=8.0), rig)
    with tempfile.TemporaryDirectory() as room, zmq.Context() as context, context.socket(zmq.DEALER) as mouth:
        address = f"ipc://{room}/stream"
        with Publisher(hello_for(idle, rig, REPORT, 1), address, clock=clock) as publisher:
            mouth.setsockopt(zmq.LINGER, 0)
            mouth.connect(endpoints(address).control)
            sent = taken = refused = 0
            before = 0
            end = time.monotonic() + 600
            while taken + refused < count and time.monotonic() < end:
                with contextlib.suppress(zmq.Again):  # full: what is there has to be taken first
                    for _ in range(min(64, count - sent)):
                        data = bytearray(rng.choice(samples))
                        data[rng.randrange(len(data))] = rng.randrange(256)
                        mouth.send(bytes(data[: rng.randrange(1, len(data) + 1)]), zmq.NOBLOCK)
                        sent += 1
                clock.ns += NS // 100
                taken += len(publisher.requests())
                refused = sum(publisher.refused.values())
                if not before and sent > count // 5:
                    before = _resident()
            grown = _resident() - before
    return {
        "sent": count,
        "refused": refused,
        "taken": taken,
        "uncounted": count - taken - refused,
        "grown_bytes": grown,
    }


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def shortfalls(found: dict) -> list[str]:
    """One line for each target that was missed."""
    flat = {name: value for part in found.values() for name, value in part.items()}
    return [f"{name} is {flat[name]:.4g}; at most {most:g}" for name, most in MOST.items() if flat[name] > most]


def main() -> int:
    """Print every figure; exit 1 with `--gate` where one falls short."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    parser.add_argument("--real", action="store_true", help="in real time, which takes as long as it says")
    options = parser.parse_args()
    clock: Ticker = MonotonicClock() if options.real else Counter()
    found = {
        "soak": soak(36_000 if options.quick else 360_000, clock),
        "strangers": strangers(10_000 if options.quick else 100_000),
    }
    if options.json:
        print(json.dumps(found, indent=2))
    else:
        for part, figures in found.items():
            print(part, *(f"  {name} {value:g}" for name, value in figures.items()), sep="\n")
    short = shortfalls(found)
    if options.gate and short:
        print("short: " + "; ".join(short))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
