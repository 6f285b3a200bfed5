"""How long a live prompt takes to be answered, seen by a client: a process is typed to, its stream is followed."""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import zmq

from drivers.frame import decode
from retarget.rig import load_rig

PROMPTS = (("raise the right hand", "right"), ("raise the left hand", "left"))
IDLE_S, WATCH_S = 5.0, 3.0  # before a prompt, so that the last one is over; and after it
PERIOD_S = 0.02  # of the stream
SHARE = 0.1  # of the move
LEAST = 0.3  # rad: a smaller move was none
PATIENCE_S = 120.0


def answers(weights: Path, rig: str, count: int) -> list[float]:
    """Seconds from the newline of a prompt until the arm that it names has done a tenth of its move in the joints,
    infinitely many where it does not move."""
    names, rng = load_rig(rig).joint_names(), np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as room, zmq.Context() as context, context.socket(zmq.SUB) as frames:
        endpoint = f"ipc://{Path(room) / 'stream'}"
        frames.setsockopt(zmq.RECONNECT_IVL, 1)
        frames.setsockopt(zmq.LINGER, 0)
        frames.setsockopt(zmq.SUBSCRIBE, b"")
        frames.connect(endpoint)
        command = [sys.executable, "-m", "rigcast", "say", "--live", "--generator", str(weights), "--rig", rig]
        with subprocess.Popen(
            [*command, "--publish", endpoint], stdin=subprocess.PIPE, text=True, stdout=subprocess.DEVNULL
        ) as process:
            assert process.stdin is not None
            if not frames.poll(int(PATIENCE_S * 1000)):
                process.kill()
                raise SystemExit("rigcast say --live sent no frame")
            took = []
            for i in range(count):
                text, side = PROMPTS[i % len(PROMPTS)]
                arm = [k for k, name in enumerate(names) if name.startswith(side) and _is_arm(name)]
                _watched(frames, IDLE_S)
                time.sleep(rng.uniform(0.0, PERIOD_S))  # else every prompt would come as a frame does
                asked = time.monotonic()
                process.stdin.write(f"{text}\n")
                process.stdin.flush()
                at, pos = _watched(frames, WATCH_S)
                moved = np.abs(pos[:, arm] - pos[0, arm]).max(1)
                tenth = at[np.argmax(moved > SHARE * moved.max())] - asked
                took.append(float(tenth) if moved.max() > LEAST else math.inf)
            process.stdin.close()
            process.wait(PATIENCE_S)
    return took


def _is_arm(name: str) -> bool:
    return any(part in name for part in ("shoulder", "elbow", "arm", "wrist"))


def _watched(frames: zmq.Socket, seconds: float) -> tuple[np.ndarray, np.ndarray]:
    """When frames came within `seconds`, and their joints (n, nj)."""
    until, at, pos = time.monotonic() + seconds, [], []
    while (left := until - time.monotonic()) > 0:
        if frames.poll(int(left * 1000) + 1):
            frame = decode(frames.recv())
            at.append(time.monotonic())
            pos.append(frame.pos[0])
    if not pos:
        raise SystemExit(f"no frame came in {seconds:g} s")
    return np.array(at), np.array(pos)
