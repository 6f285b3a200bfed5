"""`rigcast say`, from process start to the first frame on the wire, against importing torch alone.

Both are started in turn in one run, so that a busy machine slows both; disk caches are warm. The frame is seen by a
subscriber that was there first, as a rig would be. The report is made, but need not pass for the stream to start.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import zmq

TARGET = 2.0  # times the import of torch
TEXT, SECONDS = "a person waves with the right hand", "4"
REPEATS, QUICK_REPEATS = 7, 2
PATIENCE_S = 120.0


@dataclass(frozen=True)
class Start:
    """Seconds from process start to the first frame, and how the process itself splits them."""

    first_frame_s: float
    split: dict[str, float]


def main() -> int:
    """Print the ratio and the split; exit 1 with `--gate` where the ratio is over the target."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where the target is missed")
    options = parser.parse_args()
    torch, said = [], []
    for _ in range(QUICK_REPEATS if options.quick else REPEATS):
        torch.append(import_torch())
        said.append(say())
    first, alone = statistics.median(s.first_frame_s for s in said), statistics.median(torch)
    ratio = first / alone
    split = {name: statistics.median(s.split[name] for s in said) for name in said[0].split}
    found = {"say_s": first, "import_torch_s": alone, "ratio": ratio, "target": TARGET, "split_s": split}
    print(json.dumps(found, indent=2) if options.json else text(found, len(said)))
    if options.gate and ratio > TARGET:
        print(f"short: first frame after {ratio:.2f} times the import of torch; the target is {TARGET:g}")
        return 1
    return 0


def import_torch() -> float:
    """Seconds that a process takes which imports torch and ends."""
    began = time.monotonic()
    subprocess.run([sys.executable, "-c", "import torch"], check=True)
    return time.monotonic() - began


def say() -> Start:
    """Start `rigcast say` and wait for its first frame, then for its end."""
    with tempfile.TemporaryDirectory() as room, zmq.Context() as context, context.socket(zmq.SUB) as frames:
        endpoint = f"ipc://{Path(room) / 'stream'}"
        frames.setsockopt(zmq.RECONNECT_IVL, 1)  # ms: the listener's own backoff is not what is measured
        frames.setsockopt(zmq.RECONNECT_IVL_MAX, 0)
        frames.setsockopt(zmq.LINGER, 0)
        frames.setsockopt(zmq.SUBSCRIBE, b"")
        frames.connect(endpoint)
        command = [sys.executable, "-m", "rigcast", "say", TEXT, "--seconds", SECONDS, "--publish", endpoint, "--json"]
        began = time.monotonic()
        with subprocess.Popen([*command, "--unchecked"], stdout=subprocess.PIPE, text=True) as process:
            heard = frames.poll(int(PATIENCE_S * 1000))
            first_frame_s = time.monotonic() - began
            out, _ = process.communicate(timeout=PATIENCE_S)
    if not heard or process.returncode:
        raise SystemExit(f"rigcast say sent no frame (exit code {process.returncode})")
    told = json.loads(out)
    within = told["published"]["first_frame_s"]
    stages = {name: spent for name, spent in told["seconds"].items() if name != "stream"}
    other = within - sum(stages.values())
    return Start(first_frame_s, {"python": first_frame_s - within, **stages, "between stages": other})


def text(found: dict, repeats: int) -> str:
    """The figures as lines."""
    split = "\n".join(f"  {name:<18} {spent:6.2f} s" for name, spent in found["split_s"].items())
    return (
        f"medians of {repeats}, in turn\n"
        f"rigcast say to first frame {found['say_s']:.2f} s\n{split}\n"
        f"import torch {found['import_torch_s']:.2f} s\n"
        f"ratio {found['ratio']:.2f} (target: at most {found['target']:g})"
    )


if __name__ == "__main__":
    sys.exit(main())
