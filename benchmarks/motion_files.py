"""How exactly motion files come in and go out: HumanML3D's features against its authors', BVH round trips; with
`--corpus` (some ten minutes), what the build of data sets takes and how large the whole corpus is.

Needs RIGCAST_HUMANML3D (a folder with `new_joints-*.npy` and `new_joint_vecs-*.npy` of a clip) and RIGCAST_MOTION_DATA
(a folder with Bandai-Namco's and CMU's BVH files); what is not there is left out and said so.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from motiongen.bvh import read_bvh
from motiongen.bvh_write import write_bvh
from motiongen.data.dataset import Dataset, open_dataset
from motiongen.humanml import SMOOTHING, features_to_positions, positions_to_features

REACH = round(4 * SMOOTHING)  # frames at the end whose smoothed heading knows that the stored joints lack their last
CLIPS, QUICK_CLIPS = 200, 20
TARGETS = {
    "features, root and positions": 1e-5,
    "features, contacts that differ": 0,
    "features, positions, features": 1e-5,
    "BVH, motion, BVH, motion [m]": 1e-4,
}
JOBS = 2
CORPUS_TARGETS = {
    "data build, Bandai-Namco [s]": 300,
    "data build, memory of all processes [GB]": 2,
}
CORPUS_LEAST = {
    "whole corpus [h]": 10,
    "whole corpus [captions]": 20_000,
}
WHOLE = ("gestures:5000",)  # besides the motion capture


def main() -> int:
    """Print the largest errors; exit 1 with `--gate` where one is over its target or could not be measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--corpus", action="store_true", help="build the data sets too, from RIGCAST_MOTION_DATA")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    options = parser.parse_args()
    found: dict[str, float] = {}
    if folder := os.environ.get("RIGCAST_HUMANML3D"):
        found |= features(Path(folder))
    if folder := os.environ.get("RIGCAST_MOTION_DATA"):
        found["BVH, motion, BVH, motion [m]"] = round_trip(Path(folder), QUICK_CLIPS if options.quick else CLIPS)
    at_most, at_least = dict(TARGETS), {}
    if options.corpus and not options.quick:
        at_most, at_least = TARGETS | CORPUS_TARGETS, CORPUS_LEAST
        if folder:
            found |= corpus(Path(folder).expanduser())
    if options.json:
        print(json.dumps({"found": found, "at most": at_most, "at least": at_least}, indent=2))
    else:
        print(table(found, at_most, "at most"), table(found, at_least, "at least"), sep="\n" if at_least else "")
    short = [name for name, target in at_most.items() if not found.get(name, np.inf) <= target]
    short += [name for name, target in at_least.items() if not found.get(name, 0) >= target]
    if options.gate and short:
        print(f"short: {'; '.join(short)}")
        return 1
    return 0


def features(folder: Path) -> dict[str, float]:
    """Largest errors against the features of the data set's authors, and of our own round trip."""
    joints, theirs = (np.load(next(folder.glob(f"{kind}-*.npy"))) for kind in ("new_joints", "new_joint_vecs"))
    ours = positions_to_features(joints)
    theirs = theirs[: len(ours)].astype(float)
    again = positions_to_features(features_to_positions(theirs))
    inside = slice(0, len(joints) - REACH)
    return {
        "features, root and positions": float(np.abs(ours - theirs)[inside, :67].max()),
        "features, contacts that differ": float((ours[:, -4:] != theirs[:, -4:]).sum()),
        "features, positions, features": float(np.abs(again - theirs[:-1])[inside].max()),
    }


def round_trip(folder: Path, count: int) -> float:
    """Largest distance in metres of a joint from where it was, over `count` clips spread over both data sets."""
    pools = sorted(folder.rglob("dataset-*.bvh")), sorted(folder.rglob("subjects/*/*.bvh"))
    small = min(len(pools[1]), count // 2)
    clips = [*spread(pools[0], count - small), *spread(pools[1], small)]
    worst = 0.0
    with tempfile.TemporaryDirectory() as room:
        for clip in clips:
            motion = read_bvh(clip)
            write_bvh(motion, Path(room) / "clip.bvh")
            worst = max(worst, float(np.abs(read_bvh(Path(room) / "clip.bvh").positions() - motion.positions()).max()))
    return worst


def corpus(folder: Path) -> dict[str, float]:
    """Seconds and memory of a build of Bandai-Namco's clips; hours and captions of all clips, mirrors not counted."""
    with tempfile.TemporaryDirectory() as room:
        seconds, memory, _ = built([f"bandai-namco:{folder}"], Path(room) / "bandai-namco")
        _, more, whole = built([f"bandai-namco:{folder}", f"cmu:{folder}", *WHOLE], Path(room) / "whole")
        return {
            "data build, Bandai-Namco [s]": seconds,
            "data build, memory of all processes [GB]": max(memory, more),
            "whole corpus [h]": sum(entry.seconds for entry in whole.entries) / 3600,
            "whole corpus [captions]": len({caption for entry in whole.entries for caption in entry.captions}),
        }


def built(sources: list[str], out: Path) -> tuple[float, float, Dataset]:
    """Seconds of one build with two jobs, gigabytes at most (the largest process times their number), and what it made.

    Raises CalledProcessError where the build fails; its own line says why.
    """
    command = [sys.executable, "-m", "rigcast", "data", "build", *sources, "--out", str(out), "--jobs", str(JOBS)]
    began = time.monotonic()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.monotonic() - began
    if status:
        raise subprocess.CalledProcessError(os.waitstatus_to_exitcode(status), command)
    return seconds, usage.ru_maxrss * (JOBS + 1) / 1e6, open_dataset(out)


def spread(clips: list[Path], count: int) -> list[Path]:
    """`count` of the clips, evenly spread."""
    return [clips[i] for i in np.linspace(0, len(clips) - 1, min(count, len(clips))).astype(int)]


def table(found: dict[str, float], targets: dict[str, float], bound: str) -> str:
    """The figures as lines."""
    said = {name: f"{found[name]:.6g}" if name in found else "not measured: no data" for name in targets}
    return "\n".join(f"{name:<42} {said[name]:<22} target: {bound} {targets[name]:g}" for name in targets)


if __name__ == "__main__":
    sys.exit(main())
