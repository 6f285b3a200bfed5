"""How much of what is said a rig can do on its own feet: before mending, after it, and disturbed.

    python benchmarks/free_standing.py [RIG ...] [--quick] [--json] [--gate] [--table] [--trials N] [--folder DIR]
                                       [--judge FILE] [--threads N]

Motions are generated once and kept in the folder, as is what was found of each: a run that was cut off goes on there,
and `--table` prints what there is so far. With RIGCAST_MOTION_DATA set, 100 real clips of Bandai-Namco's data set come
beside the 100 generated ones. What counts as running free is in `standing_tries.py`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from lines import Line, gate, text
from standing_prompts import CLIPS, KINDS, REAL
from standing_tries import Judge, Try, asked_for, found_of, is_free, judge_in, short_of

from motiongen.candidates import DEFAULT_CANDIDATES, choose
from motiongen.files import load_motion, replacing, save_motion
from motiongen.formats.reading import read_motion
from motiongen.generator import Generator, load_generator
from motiongen.motion import Motion
from retarget.rig import Rig, load_rig
from sim.report import Controller

RIGS = ["puppet", "humanoid"]
TARGETS = {"gesture": 0.95, "step": 0.6, "walk": 0.6, "turn": 0.6}
QUICK = 0.01, 3  # share of the motions, so the first of each kind, and trials


def motions(folder: Path, share: float) -> Iterator[tuple[str, str, int, str, Motion]]:
    """Source, kind, number, name and motion of the first `share` of everything that is tried, kinds in turn."""
    drawing: Generator | None = None
    data = os.environ.get("RIGCAST_MOTION_DATA")
    clips = {} if data is None else {kind: real_clips(Path(data).expanduser(), kind) for kind in REAL}
    for i in range(max(*map(len, KINDS.values()), *REAL.values())):
        for kind, prompts in KINDS.items():
            if i >= np.ceil(share * len(prompts)):
                continue
            file = folder / f"{kind}-{i:02d}.npz"
            if not file.is_file():
                drawing = drawing or load_generator("mdm")
                save_motion(choose(drawing, prompts[i], candidates=DEFAULT_CANDIDATES, seed=i).motion, file)
            yield "generated", kind, i, prompts[i], load_motion(file)
        for kind, files in clips.items():
            if i < np.ceil(share * len(files)):
                yield "real", kind, i, files[i].stem, read_motion(files[i])


def real_clips(data: Path, kind: str) -> list[Path]:
    """As many clips of `kind` as are tried, evenly out of all styles and contents."""
    found = [sorted(data.rglob(pattern)) for pattern in CLIPS[kind]]
    rows = list(zip(*found, strict=False))
    each = -(-REAL[kind] // len(found))
    spread = [rows[i] for i in np.linspace(0, len(rows) - 1, min(each, len(rows))).astype(int)]
    return [file for row in spread for file in row][: REAL[kind]]


def measured(rig: Rig, asked: argparse.Namespace, share: float, trials: int) -> list[dict]:
    """One row per motion; what is known already is read from the folder."""
    rows = []
    sees: Judge | None = None
    for source, kind, number, name, motion in motions(asked.folder, share):
        file = asked.folder / f"{rig.name}-{source}-{kind}-{number:02d}-{trials}.json"
        if not file.is_file():
            if asked.table:
                continue
            sees = sees or judge_in(asked.judge)
            row = {"rig": rig.name, "source": source, "kind": kind, "name": name}
            row |= found_of(asked_for(motion, words_of(name), rig, sees), trials, asked.threads, sees)
            with replacing(file) as temporary:
                temporary.write_text(json.dumps(row), encoding="utf-8")
            print(f"  {rig.name} {source} {kind} {name}: {verdict(row)}", file=sys.stderr, flush=True)
        rows.append(json.loads(file.read_text(encoding="utf-8")))
    return rows


def words_of(name: str) -> str:
    """What is said of a motion: its prompt, or the content in the name of a file of Bandai-Namco's."""
    return name.split("_")[1].replace("-", " ") if name.startswith("dataset-") else name


def tries_of(row: dict) -> list[Try]:
    """What was tried, read from plain data."""
    return [
        Try(**{**found, "trials": tuple(found["trials"]), "fell_to": tuple(map(tuple, found["fell_to"]))})
        for found in row["tries"]
    ]


def runs_free(row: dict, *controllers: Controller) -> bool:
    """Whether it does under one of `controllers`; under any, where none is named."""
    return any(is_free(found) for found in tries_of(row) if not controllers or found.controller in controllers)


def verdict(row: dict) -> str:
    """In a few words: under which controller it runs free, or what came of the last try."""
    last = tries_of(row)[-1]
    if is_free(last):
        return f"free, {last.controller}{'' if last.mended else ', as it is'}"
    return ", ".join(last.failed) or short_of(last)


def report(rows: list[dict]) -> list[Line]:
    """Print the table and the failures; the lines that have targets."""
    lines = []
    print(
        f"{'rig':<9} {'source':<9} {'kind':<7}   n  before   after  free: open loop  IMU  full state  classifier alone"
    )
    for rig, source, kind in dict.fromkeys((r["rig"], r["source"], r["kind"]) for r in rows):
        mine = [r for r in rows if (r["rig"], r["source"], r["kind"]) == (rig, source, kind)]
        before, after, alone, felt, whole, seen = (
            float(np.mean(column))
            for column in zip(
                *(
                    (
                        row["before"],
                        any(not found.failed for found in tries_of(row)),
                        runs_free(row, "open_loop"),
                        runs_free(row, "open_loop", "imu"),
                        runs_free(row),
                        tries_of(row)[-1].shows,
                    )
                    for row in mine
                ),
                strict=True,
            )
        )
        print(
            f"{rig:<9} {source:<9} {kind:<7} {len(mine):>3} {before:>7.0%} {after:>7.0%} {alone:>16.0%} {felt:>4.0%} "
            f"{whole:>11.0%} {seen:>17.0%}"
        )
        if kind in TARGETS:
            lines.append(Line(rig, f"{source} {kind}s that run free, of {len(mine)}", whole, TARGETS[kind], True))
    for row in rows:
        if not runs_free(row):
            print(f"  not free: {row['rig']}, {row['source']} {row['kind']}: {row['name']}: {verdict(row)}")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rigs", nargs="*", default=RIGS)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core, but for generating")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    parser.add_argument("--table", action="store_true", help="of what is known so far; nothing is run")
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--folder", type=Path, default=Path("runs/free_standing"))
    parser.add_argument("--judge", type=Path, default=Path("runs/evaluators/contents.safetensors"))
    asked = parser.parse_args()
    share, trials = QUICK if asked.quick else (1.0, asked.trials)
    asked.folder.mkdir(parents=True, exist_ok=True)
    rows = [row for name in asked.rigs for row in measured(load_rig(name), asked, share, trials)]
    lines = report(rows)
    for line in lines:
        print(text(line))
    if asked.json:
        print(json.dumps(rows))
    return gate(lines, asked.gate)


if __name__ == "__main__":
    sys.exit(main())
