"""What a mirror costs: how much later than a performer the rig moves, seen from outside, and of a core how much.

The command is the real one; a performer lifts an arm and lets it down again, 60 poses a second, and each time the rig's
joint has gone half of its way is set beside the performer's.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
from lines import Line, gate, text

from drivers.clock import MonotonicClock
from drivers.receiver import Receiver
from drivers.vmc import datagrams
from motiongen.motion import Motion
from motiongen.rotation import axis_angle_to_quat
from motiongen.smpl import SMPL_SKELETON
from retarget.rig import load_rig

RIG, JOINT, POSES_HZ = "puppet", "left_shoulder_roll", 60.0
MOVE_S, PAUSE_S = 0.8, 1.2  # of the arm, up or down, and between
WARM_S = 4.0  # until the mirror has begun
HANGING, LIFTED = -1.2, -0.2  # rad, the arm from level
NS = 1_000_000_000
MOST = {"delay_p50_s": 0.8, "delay_p95_s": 1.0, "refused_blocks": 0.0}


def performed(at_s: float) -> float:
    """The arm's angle at a time: a minimum jerk each MOVE_S + PAUSE_S, up and down in turn."""
    turn, since = divmod(at_s, MOVE_S + PAUSE_S)
    u = min(since / MOVE_S, 1.0)
    share = u**3 * (10 - 15 * u + 6 * u**2)
    return HANGING + (LIFTED - HANGING) * (share if turn % 2 == 0 else 1 - share)


def posed(angle: float) -> Motion:
    quat = np.tile([1.0, 0.0, 0.0, 0.0], (1, 22, 1))
    for side, sign in (("left", 1), ("right", -1)):
        quat[0, SMPL_SKELETON.index(f"{side}_shoulder")] = axis_angle_to_quat([1.0, 0, 0], sign * HANGING)
    quat[0, SMPL_SKELETON.index("left_shoulder")] = axis_angle_to_quat([1.0, 0, 0], angle)
    return Motion(np.array([[0, 0, 0.93]]), quat, POSES_HZ, SMPL_SKELETON)


def measure(moves: int) -> dict[str, float]:
    """Delays of `moves`, and what the command took of a core. Raises RuntimeError where the mirror does not begin."""
    port, address = _free_port(), f"ipc:///tmp/rigcast-mirror-{os.getpid()}"
    command = [sys.executable, "-m", "rigcast", "mirror", f"vmc://:{port}", address, "--rig", RIG]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as mirror:
        try:
            if mirror.stderr is None or "mirrors" not in (said := mirror.stderr.readline()):
                raise RuntimeError(f"no mirror: {said}")
            seen, began_ns, share = _watched(mirror.pid, port, address, moves)
            mirror.terminate()
            out, _ = mirror.communicate(timeout=60)
        finally:
            mirror.kill()
    delays = _delays(np.array(seen), began_ns, moves)
    refused = float(out.split(" blocks passed, ")[1].split()[0])
    return {
        "moves": moves,
        "moves_seen": len(delays),
        "delay_p50_s": float(np.percentile(delays, 50)),
        "delay_p95_s": float(np.percentile(delays, 95)),
        "share_of_a_core": share,
        "refused_blocks": refused,
        "load": os.getloadavg()[0],
    }


def _watched(pid: int, port: int, address: str, moves: int) -> tuple[list[tuple[int, float]], int, float]:
    """(time, angle) of each frame that came, when the first move began, and of a core how much the mirror took."""
    rig, clock = load_rig(RIG), MonotonicClock()
    joint, seen = rig.joint_names().index(JOINT), []
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth,
        Receiver(address, rig_hash=rig.hash, rig=rig.name) as receiver,
    ):
        start = clock.now_ns()
        began, spent = start + round(WARM_S * NS), _cpu_s(pid)
        for k in range(round((WARM_S + (moves + 1) * (MOVE_S + PAUSE_S)) * POSES_HZ)):
            due = start + round(k * NS / POSES_HZ)
            while clock.now_ns() < due:
                clock.sleep_until_ns(min(due, clock.now_ns() + 2_000_000))
                if (frame := receiver.poll(clock.now_ns())) is not None:
                    seen.append((clock.now_ns(), float(frame.pos[0, joint])))
            angle = HANGING if due < began else performed((clock.now_ns() - began) / NS)
            for data in datagrams(posed(angle), 0, k / POSES_HZ):
                mouth.sendto(data, ("127.0.0.1", port))
        return seen, began, (_cpu_s(pid) - spent) / ((clock.now_ns() - start) / NS)


def _delays(seen: np.ndarray, began_ns: int, moves: int) -> list[float]:
    """Seconds from half of the performer's way to half of the rig's, of each move that is seen."""
    low, high = np.percentile(seen[:, 1], [5, 95])
    crossed, found = (seen[:, 1] > (low + high) / 2).astype(int), []
    at_s = (seen[1:, 0][np.diff(crossed) != 0] - began_ns) / NS
    for k in range(moves):
        half = k * (MOVE_S + PAUSE_S) + MOVE_S / 2
        found += [float(t - half) for t in at_s if 0 < t - half < MOVE_S + PAUSE_S][:1]
    return found


def _cpu_s(pid: int) -> float:
    """Seconds of CPU that a process has had."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def main() -> int:
    """Print every figure; exit 1 with `--gate` where one falls short."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    options = parser.parse_args()
    found = measure(8 if options.quick else 60)
    lines = [Line("mirror", name, found[name], most, at_least=False) for name, most in MOST.items()]
    if options.json:
        print(json.dumps(found, indent=2))
    else:
        print(*(text(line) for line in lines), sep="\n")
        print(*(f"{'mirror':<10} {name:<58} {found[name]:>12.3g}" for name in found if name not in MOST), sep="\n")
    return gate(lines, options.gate)


if __name__ == "__main__":
    sys.exit(main())
