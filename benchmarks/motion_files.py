"""How exactly motion files come in and go out: HumanML3D's features against its authors', BVH round trips, what becomes
of damaged files; with `--corpus` (some ten minutes), what a build of data sets takes and how large the corpus is.

Needs RIGCAST_HUMANML3D (a folder with `new_joints-*.npy` and `new_joint_vecs-*.npy` of a clip) and RIGCAST_MOTION_DATA
(a folder with Bandai-Namco's and CMU's BVH files); what is not there is left out and said so.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from fuzz import FORMATS, fuzz

from motiongen.data.dataset import Dataset, open_dataset
from motiongen.formats.bvh import read_bvh
from motiongen.formats.bvh_write import write_bvh
from motiongen.formats.humanml import SMOOTHING, features_to_positions, positions_to_features

REACH = round(4 * SMOOTHING)  # frames at the end whose smoothed heading knows that the stored joints lack their last
CLIPS, QUICK_CLIPS = 200, 20
DAMAGED, QUICK_DAMAGED = 2000, 100  # files a format
PAGE = Path(__file__).parent.parent / "docs/files.md"
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
WHOLE = ("gestures:5000", "composed:2500")  # besides the motion capture


def main() -> int:
    """Print the largest errors; exit 1 with `--gate` where one is over its target or could not be measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--corpus", action="store_true", help="build the data sets too, from RIGCAST_MOTION_DATA")
    parser.add_argument("--json", action="store_true", help="one JSON document")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    parser.add_argument("--fuzz", type=int, metavar="N", help=f"damaged files a format, {DAMAGED} unless said")
    parser.add_argument("--write", action="store_true", help="put the figures into docs/files.md")
    options = parser.parse_args()
    found: dict[str, float] = {}
    tried = fuzz((QUICK_DAMAGED if options.quick else DAMAGED) if options.fuzz is None else options.fuzz)
    if folder := os.environ.get("RIGCAST_HUMANML3D"):
        found |= features(Path(folder))
    if folder := os.environ.get("RIGCAST_MOTION_DATA"):
        found["BVH, motion, BVH, motion [m]"] = round_trip(Path(folder), QUICK_CLIPS if options.quick else CLIPS)
    at_most, at_least = dict(TARGETS), {}
    if options.corpus and not options.quick:
        at_most, at_least = TARGETS | CORPUS_TARGETS, CORPUS_LEAST
        if folder:
            found |= corpus(Path(folder).expanduser())
    lines = "\n".join([*table(found, at_most, "at most"), *table(found, at_least, "at least"), *fuzz_table(tried)])
    document = {"found": found, "at most": at_most, "at least": at_least, "damaged": tried}
    print(json.dumps(document, indent=2) if options.json else lines)
    if options.write:
        write(lines)
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


def table(found: dict[str, float], targets: dict[str, float], bound: str) -> list[str]:
    """The figures as lines."""
    said = {name: f"{found[name]:.6g}" if name in found else "not measured: no data" for name in targets}
    return [f"{name:<42} {said[name]:<22} target: {bound} {targets[name]:g}" for name in targets]


def fuzz_table(tried: dict[str, Any]) -> list[str]:
    """What became of the damaged files, as lines."""
    said = [
        f"{f'damaged {suffix} files':<42} {sum(tried['files'][suffix].values())} tried, "
        f"{tried['files'][suffix].get('refused', 0)} refused in one line, {tried['files'][suffix].get('read', 0)} read"
        for suffix in FORMATS
    ]
    return [*said, f"{'memory that took at most':<42} {tried['peak_mb']} MB"]


def write(lines: str) -> None:
    """Put the figures, the day and the machine's kind into the block under `## Measured`."""
    before, mark, rest = PAGE.read_text(encoding="utf-8").partition("```text\n")
    if not mark:
        raise SystemExit(f"{PAGE}: no block ```text to put the figures into")
    when = f"{datetime.now(UTC):%Y-%m-%d}, {platform.machine()} {platform.system()}, {os.cpu_count()} cores"
    after = rest.partition("```")[2]
    PAGE.write_text(f"{before}{mark}{when}\n{lines}\n```{after}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
