"""The stream against bare pyzmq, both in one run and in turn: throughput, latency, deadlines, damage and leaks.

Bare pyzmq is a PUB and a SUB with no option set and bytes that were made before. A listener is a process of its own.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import zmq
from zmq.utils import z85

from drivers.doorkeeper import Doorkeeper
from drivers.frame import MAX_BYTES, Frame, encode
from drivers.gate import Gate
from drivers.keys import Keys
from drivers.messages import Hello
from drivers.publisher import Publisher
from drivers.receiver import Receiver
from drivers.sockets import Curve, open_socket

JOINTS, RIG_HASH, REPORT = 30, 1, "0123456789abcdef"
NS = 1_000_000_000
TARGETS = {
    "throughput_ratio": (">=", 0.8),
    "validated_per_cpu_s": (">=", 20_000),
    "wrong_frames": ("<=", 0),
    "leaked_files": ("<=", 0),
    "leaked_bytes_per_frame": ("<=", 1.0),
}
TRIES = 5
RATES = (50, 200, 1000)
REPORT_EVERY = 100


def a_frame(seq: int, now: int, stream: int = 1) -> Frame:
    """A frame of 30 joints, made and due at `now` ns."""
    pos = np.full((1, JOINTS), 0.1, np.float32)
    root = np.array([[0, 0, 0.3, 1, 0, 0, 0]], np.float32)
    contacts = np.zeros(1, np.uint32)
    return Frame(stream, seq, RIG_HASH, REPORT, now, now, 20_000_000, pos, pos, root, contacts)


def a_hello() -> Hello:
    """The hello of such frames."""
    names = tuple(f"joint_{k}" for k in range(JOINTS))
    column = (1.0,) * JOINTS
    return Hello("bench", RIG_HASH, names, column, column, column, 50.0, 1, REPORT)


# --- throughput


def throughput(count: int, rounds: int) -> dict[str, float]:
    """Messages from one socket to another of this process, in a second of CPU of all its threads, best of all rounds.

    Bare, with our options and with CURVE, by turns. Wall time would measure what else runs on the machine.
    """
    keys = Keys(z85.decode(zmq.curve_keypair()[1]), {})
    best = {"bare": 0.0, "ours": 0.0, "curve": 0.0}
    for _ in range(rounds):
        for way in best:
            with tempfile.TemporaryDirectory() as room:
                best[way] = max(best[way], _moved_all(way, f"ipc://{room}/stream", keys, count))
    ratios = {"throughput_ratio": best["ours"] / best["bare"], "curve_ratio": best["curve"] / best["bare"]}
    return {**{f"{way}_per_cpu_s": rate for way, rate in best.items()}, **ratios}


def _moved_all(way: str, address: str, keys: Keys, count: int) -> float:
    """Messages a second, of a try in which none was lost: a machine that stalls for seconds breaks connections."""
    for _ in range(TRIES):
        with contextlib.suppress(zmq.Again):
            return _moved(way, address, keys, count)
    raise SystemExit(f"{TRIES} times in a row messages were lost ({way}): this machine is too busy")


def _moved(way: str, address: str, keys: Keys, count: int) -> float:
    data = encode(a_frame(0, 0))
    with _pair(way, address, keys) as (out, into):
        while True:  # until the subscription has arrived
            out.send(data)
            if into.poll(20):
                break
        while into.poll(50):
            into.recv()
        began, came = time.process_time(), 0
        for k in range(count):
            out.send(data)
            if k % 100 == 99:  # in step, so that nothing is dropped: a queue holds two of ours
                while came <= k:
                    into.recv()
                    came += 1
        return count / (time.process_time() - began)


@contextlib.contextmanager
def _pair(way: str, address: str, keys: Keys):
    sender, listener = zmq.Context(), zmq.Context()
    if way == "bare":
        out, into = sender.socket(zmq.PUB), listener.socket(zmq.SUB)
        out.bind(address)
        into.subscribe(b"")
        into.connect(address)
    else:
        ours = theirs = keeper = None
        if way == "curve":
            ours, theirs = Curve(keys.secret, "follow"), Curve(keys.secret, server=keys.public)
            keeper = Doorkeeper(sender, keys)
        options = {"max_bytes": MAX_BYTES, "queue": 1000}
        out = open_socket(sender, zmq.XPUB, address, bind=True, curve=ours, **options)
        if keeper is not None:
            keeper.start()
        into = open_socket(listener, zmq.SUB, address, bind=False, curve=theirs, **options)
    into.setsockopt(zmq.RCVTIMEO, 10_000)  # rather an error than a benchmark that hangs
    try:
        yield out, into
    finally:
        into.close(0)
        out.close(0)
        listener.term()
        sender.term()


def validated(count: int, rounds: int) -> float:
    """Frames that one core decodes and checks as a rig would in a second of CPU; the best of all rounds."""
    frames = [encode(a_frame(k, k * 1_000_000)) for k in range(count)]
    best = 0.0
    for _ in range(rounds):
        gate = Gate(RIG_HASH)
        began = time.process_time()
        for k, data in enumerate(frames):
            gate.check(data, k * 1_000_000)
        best = max(best, count / (time.process_time() - began))
        if gate.accepted != count:
            raise SystemExit(f"only {gate.accepted} of {count} frames were accepted: {gate.last_error}")
    return best


# --- latency


def latency(seconds: float, rates: tuple[int, ...]) -> dict[str, dict[str, float]]:
    """Milliseconds from making a frame to having it in another process, p50 and p99, bare and ours in turn."""
    found = {}
    for rate in rates:
        bare, ours = _heard("bare", rate, seconds), _heard("ours", rate, seconds)
        quantiles = {
            f"{way}_p{q}_ms": float(np.percentile(ms, q))
            for way, ms in (("bare", bare), ("ours", ours))
            for q in (50, 99)
        }
        found[str(rate)] = {**quantiles, "p50_ratio": quantiles["ours_p50_ms"] / quantiles["bare_p50_ms"]}
    return found


def _heard(way: str, rate: int, seconds: float) -> list[float]:
    with tempfile.TemporaryDirectory() as room:
        address = f"ipc://{room}/stream"
        command = [sys.executable, __file__, "--listen", way, "--address", address]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as listener:
            _send(way, address, rate, seconds)
            out, _ = listener.communicate(timeout=60)
    return json.loads(out)


def _send(way: str, address: str, rate: int, seconds: float) -> None:
    context: zmq.Context = zmq.Context()
    publisher = None
    if way == "ours":
        publisher = Publisher(a_hello(), address)
        publisher.wait_for_subscriber(60)
    else:
        out = context.socket(zmq.XPUB)
        out.bind(address)
        out.poll(60_000)
    began = time.monotonic_ns()
    for seq in range(round(rate * seconds) + 3):
        ending = seq >= round(rate * seconds)
        due = began + round(seq * NS / rate)
        time.sleep(max(0.0, (due - time.monotonic_ns()) / NS))
        now = time.monotonic_ns()
        if publisher is not None:
            publisher.send(replace(a_frame(seq, now), period_ns=1 if ending else 20_000_000))
        else:
            out.send(b"" if ending else now.to_bytes(8, "little") + bytes(400))  # as long as a frame of ours
    if publisher is not None:
        publisher.close()
    context.destroy(200)


def listen(way: str, address: str) -> list[float]:
    """The listening process: milliseconds of each message, until the sender says the end."""
    ms = []
    if way == "bare":
        with zmq.Context() as context, context.socket(zmq.SUB) as into:
            into.subscribe(b"")
            into.connect(address)
            while data := into.recv():
                ms.append((time.monotonic_ns() - int.from_bytes(data[:8], "little")) / 1e6)
        return ms
    with Receiver(address, rig_hash=RIG_HASH) as receiver:
        while True:
            receiver._frames.socket.poll(1000)
            if (frame := receiver.poll(time.monotonic_ns())) is not None:
                if frame.period_ns == 1:
                    return ms
                ms.append((time.monotonic_ns() - frame.capture_ns) / 1e6)


# --- deadlines


def deadlines(seconds: float, busy: int) -> dict[str, float]:
    """Late frames in 100,000 at 200 Hz, a frame being late that leaves over a millisecond after its deadline; beside
    them, second by second in turn, those of a bare PUB with bytes that were made before, and of the sleep alone."""
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(busy)]
    bare = zmq.Context.instance().socket(zmq.PUB)
    try:
        with tempfile.TemporaryDirectory() as room, Publisher(a_hello(), f"ipc://{room}/stream") as publisher:
            bare.bind(f"ipc://{room}/bare")
            made = encode(a_frame(0, 0))
            sends: dict[str, Callable[[int, int], object]] = {
                "": lambda seq, due: publisher.send(a_frame(seq, due)),
                "bare_": lambda seq, due: bare.send(made),
                "sleep_": lambda seq, due: None,
            }
            late: dict[str, list[float]] = {name: [] for name in sends}
            for second in range(round(seconds)):
                for name, send in sends.items():
                    late[name] += _late(send, 200 * second)
            load = os.getloadavg()[0]  # processes that wanted to run, this one and `busy` among them
    finally:
        bare.close(0)
        for burner in burners:
            burner.kill()
            burner.wait()
    found = {"load": load}
    for name, each in late.items():
        found[f"{name}late_per_100000"] = 1e5 * float(np.mean(np.array(each) > 1.0))
        found[f"{name}p50_ms"], found[f"{name}p99_ms"] = (float(x) for x in np.percentile(each, (50, 99)))
        found[f"{name}worst_ms"] = max(each)
    return found


def _late(send: Callable[[int, int], object], first: int) -> list[float]:
    """How late, in ms, each of 200 frames was away at 200 Hz."""
    began, late = time.monotonic_ns() + 5_000_000, []
    for k in range(200):
        due = began + k * 5_000_000
        time.sleep(max(0.0, (due - time.monotonic_ns()) / NS))
        send(first + k, due)
        late.append((time.monotonic_ns() - due) / 1e6)
    return late


# --- damage and leaks


def damage(count: int) -> dict[str, int]:
    """Frames with 1 to 32 flipped bits that were accepted, of `count`."""
    rng, gate = random.Random(1), Gate(RIG_HASH)
    data = encode(a_frame(0, 0))
    for k in range(count):
        bits = int.from_bytes(data, "little")
        for bit in rng.sample(range(8 * len(data)), rng.choice((1, 1, 2, 3, 4, 8, 32))):
            bits ^= 1 << bit
        gate.check(bits.to_bytes(len(data), "little"), k)
    return {"damaged_frames": count, "wrong_frames": gate.accepted}


def soak(count: int) -> dict[str, float]:
    """Growth of this process over `count` frames through real sockets, after the first tenth of them."""
    with tempfile.TemporaryDirectory() as room:
        address = f"ipc://{room}/stream"
        with Publisher(a_hello(), address) as publisher, Receiver(address, rig_hash=RIG_HASH) as receiver:
            publisher.wait_for_subscriber(10)
            at, sizes, files = [], [], []
            for seq in range(count):
                publisher.send(a_frame(seq, time.monotonic_ns()))
                receiver.poll(time.monotonic_ns())
                if seq % (count // REPORT_EVERY) == 0 and seq > count // 10:
                    at.append(seq)
                    sizes.append(_resident())
                    files.append(len(os.listdir("/proc/self/fd")))
    slope = float(np.polyfit(at, sizes, 1)[0])
    return {"frames": count, "leaked_bytes_per_frame": slope, "leaked_files": files[-1] - files[0]}


def _resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


# --- all of it


PARTS = ("throughput", "validation", "latency", "deadlines_idle", "deadlines_one_core_loaded", "damage", "soak")


def measure(quick: bool, wanted: Sequence[str] = PARTS) -> dict:
    """Every figure of the `wanted` parts, by part."""
    parts = {
        "throughput": lambda: throughput(2000, 15 if quick else 200),
        "validation": lambda: {"validated_per_cpu_s": validated(1000, 20 if quick else 200)},
        "latency": lambda: latency(2.0 if quick else 20.0, RATES),
        "deadlines_idle": lambda: deadlines(3.0 if quick else 250.0, 0),
        "deadlines_one_core_loaded": lambda: deadlines(3.0 if quick else 250.0, 1),
        "damage": lambda: damage(20_000 if quick else 1_000_000),
        "soak": lambda: soak(20_000 if quick else 360_000),
    }
    found = {}
    for name in wanted:
        print(f"{name} …", file=sys.stderr, flush=True)
        found[name] = parts[name]()
    return found


def shortfalls(found: dict) -> list[str]:
    """One line for each target that was missed."""
    flat = {name: value for part in found.values() for name, value in part.items()}
    return [
        f"{name} is {flat[name]:.4g}; the target is {sign} {target:g}"
        for name, (sign, target) in TARGETS.items()
        if name in flat and (flat[name] < target if sign == ">=" else flat[name] > target)
    ]


def main() -> int:
    """Print every figure; exit 1 with `--gate` where one falls short."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    parser.add_argument("--part", choices=PARTS, action="append", help="this one alone; may be said again")
    parser.add_argument("--listen", choices=("bare", "ours"), help=argparse.SUPPRESS)
    parser.add_argument("--address", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.listen:
        print(json.dumps(listen(options.listen, options.address)))
        return 0
    found = measure(options.quick, options.part or PARTS)
    print(json.dumps(found, indent=2) if options.json else text(found))
    short = shortfalls(found)
    if options.gate and short:
        print("short: " + "; ".join(short))
        return 1
    return 0


def text(found: dict) -> str:
    """The figures as lines, targets beside those that have one."""
    lines = []
    for part, figures in found.items():
        lines.append(part.replace("_", " "))
        for name, value in figures.items():
            if isinstance(value, dict):
                lines.append(f"  {name:>5} Hz  " + "  ".join(f"{k} {v:.3g}" for k, v in value.items()))
            else:
                target = f"  (target {TARGETS[name][0]} {TARGETS[name][1]:g})" if name in TARGETS else ""
                lines.append(f"  {name:<24} {value:,.4g}{target}")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
