"""Retargeting of captured clips: how many converge, and which are the worst.

    RIGCAST_MOTION_DATA=FOLDER python benchmarks/captured_clips.py [--quick] [--json] [--gate] [--picture PNG] [RIG ...]

A clip converges where every planted foot moves less than a millimetre and every joint keeps to its range, speed and
acceleration. Clips are spread evenly through each data set, a folder each (Bandai-Namco's two count as one); a set of
fewer gives all that it has.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from lines import Line, gate, text
from retargeting import FPS, SOUND, at_once, clip_of, here, measured

from motiongen.formats.reading import read_motion
from motiongen.motion import Motion
from motiongen.rotation import Array
from retarget.kinematics import tree_of
from retarget.rig import Rig
from retarget.trajectory import Trajectory

DATA = "RIGCAST_MOTION_DATA"
RIGS = ("puppet", "humanoid")
CLIPS, QUICK_CLIPS = 200, 6
WORST = 5


@dataclass(frozen=True)
class Found:
    """One clip on one rig: distance from its goals, mean, and how far a planted foot moves, at most, in metres; the
    share of samples beyond a limit; `qpos` (T, nq).
    """

    name: str
    position_m: float
    planted_moves_m: float
    beyond: float
    qpos: Array

    @property
    def converges(self) -> bool:
        return self.planted_moves_m < SOUND and self.beyond == 0.0


def clips_in(folder: Path, count: int) -> list[Path]:
    """`count` .bvh files, as many of each data set as of the others where it has them."""
    sets: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(folder.rglob("*.bvh")):
        sets[path.relative_to(folder).parts[0].split("-")[0]].append(path)
    out: list[Path] = []
    for i, files in enumerate(sorted(sets.values(), key=len)):
        share = min(len(files), (count - len(out)) // (len(sets) - i))
        out += [files[k] for k in np.linspace(0, len(files) - 1, share).round().astype(int)]
    return out


def found(name: str, motion: Motion, rig: Rig, model: mujoco.MjModel) -> Found:
    clip = clip_of(motion, rig, model)
    qpos = at_once(rig, model, clip)
    row = measured(rig, tree_of(model), clip, qpos)
    beyond = row["over_range"] + row["over_speed"] + row["over_acceleration"]
    return Found(name, row["position_m"], row["planted_moves_m"], beyond, qpos)


def said(row: Found) -> str:
    end = "" if row.converges else f"   DOES NOT CONVERGE: {row.beyond:.1e} beyond limits"
    moves = f"planted feet move {1e3 * row.planted_moves_m:6.3f} mm"
    return f"{1e3 * row.position_m:6.1f} mm, {moves}   {len(row.qpos)} frames{end}"


def draw(worst: list[Found], rig: Rig, path: Path) -> None:
    from sim.gallery import render_gallery

    rows = [
        (f"{f.name}: {1e3 * f.position_m:.0f} mm", Trajectory(f.qpos, FPS, rig.name, rig.joint_names())) for f in worst
    ]
    render_gallery(rows, rig, path, mount="free")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rigs", nargs="*", default=RIGS)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    parser.add_argument("--picture", type=Path, help="where to draw the worst of the first rig, .png")
    asked = parser.parse_args()
    folder = Path(os.environ.get(DATA, "")).expanduser()
    if DATA not in os.environ or not folder.is_dir():
        print(f"{DATA} should name a folder of .bvh files, one folder for each data set", file=sys.stderr)
        return 2
    rigs = here(asked.rigs)
    rows: dict[str, list[Found]] = {rig.name: [] for rig, _ in rigs}
    for path in clips_in(folder, QUICK_CLIPS if asked.quick else CLIPS):
        motion = read_motion(path).resampled(FPS)
        for rig, model in rigs:
            row = found(path.stem, motion, rig, model)
            rows[rig.name] = sorted([*rows[rig.name], row], key=lambda f: -f.position_m)
            print(f"{rig.name:<10} {said(row)}   {path.relative_to(folder)}", flush=True)
    lines = []
    for name, these in rows.items():
        print(f"{name}: {len(these)} clips, {sum(len(f.qpos) for f in these)} frames; farthest from their goals:")
        for f in these[:WORST]:
            print(f"  {1e3 * f.position_m:.1f} mm   {f.name}")
        share = float(np.mean([f.converges for f in these]))
        lines.append(Line(name, f"share of {len(these)} captured clips that converge", share, 1.0, True))
    for line in lines:
        print(text(line))
    if asked.picture:
        draw(rows[rigs[0][0].name][:WORST], rigs[0][0], asked.picture)
    if asked.json:
        print(json.dumps({name: {f.name: f.position_m for f in these} for name, these in rows.items()}))
    return gate(lines, asked.gate)


if __name__ == "__main__":
    sys.exit(main())
