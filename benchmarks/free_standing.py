"""How much of what is said a rig can do on its own feet: before mending, after it, and disturbed.

python benchmarks/free_standing.py [RIG ...] [--quick] [--json] [--gate] [--per-kind N] [--trials N] [--folder DIR]

Motions are generated once and kept in the folder, as is what was found of each: a run that was cut off goes on there.
With RIGCAST_MOTION_DATA set, real clips of Bandai-Namco's data set come beside the generated ones.

A motion runs free where nothing but its servos moves it, at least 9 in 10 disturbed trials pass every check, its root
goes at least 70 % as far as that of the motion that was asked for, and it takes at most twice as long.
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
from standing_prompts import CLIPS, KINDS

from motiongen.candidates import DEFAULT_CANDIDATES, choose
from motiongen.files import load_motion, replacing, save_motion
from motiongen.formats.reading import read_motion
from motiongen.generator import Generator, load_generator
from motiongen.motion import Motion
from retarget.retarget import retarget
from retarget.rig import Rig, load_rig
from retarget.trajectory import Trajectory
from sim.checks import judge
from sim.fix import can_feel
from sim.mending.mend import LONGEST, mend
from sim.report import Controller, Report

RIGS = ["puppet", "humanoid"]
FAR = 0.7  # of the way that was asked for
GOES = 0.5  # root heights: who goes less far does not go anywhere
TARGETS = {"gesture": 0.95, "step": 0.6, "walk": 0.6, "turn": 0.6}
QUICK = 1, 3  # motions of a kind, trials
CALM = 1.0  # s over which swaying from foot to foot is smoothed away, as it is no way made


def way(trajectory: Trajectory) -> float:
    """Metres that the root goes along the floor, its sway smoothed away."""
    width = max(1, min(round(CALM * trajectory.fps), len(trajectory)))
    padded = np.pad(trajectory.root_pos[:, :2], ((width // 2, width // 2), (0, 0)), mode="edge")
    smooth = np.stack([np.convolve(padded[:, i], np.ones(width) / width, mode="valid") for i in range(2)], axis=1)
    return float(np.linalg.norm(np.diff(smooth, axis=0), axis=1).sum())


def found_of(motion: Motion, rig: Rig, trials: int) -> dict[str, object]:
    """What becomes of one motion on one rig."""
    asked = retarget(motion, rig, mount="free")
    before = judge(asked, rig, mount="free")[0]
    mended = mend(asked, rig).trajectory
    longer = mended.duration / asked.duration
    far = way(mended) / way(asked) if way(asked) > GOES * rig.nominal.height else 1.0
    counts = far >= FAR and longer <= LONGEST + 1 / len(asked)
    out: dict[str, object] = {"before": before.ok, "longer": longer, "far": far}
    controllers: tuple[Controller, ...] = ("open_loop", "imu") if can_feel(rig) else ("open_loop",)
    for controller in controllers:
        report = judge(mended, rig, mount="free", controller=controller)[0]
        if report.ok and trials:
            report = judge(mended, rig, mount="free", controller=controller, trials=trials)[0]
        out[controller] = {"after": _nominal(report), "free": counts and report.ok, "why": _why(report)}
        if report.ok:
            break
    if not counts:
        out["short"] = f"goes {far:.0%} of the way in {longer:.2f} times the time"
    return out


def _nominal(report: Report) -> bool:
    return not report.failures()


def _why(report: Report) -> list[str]:
    trials = [] if report.trials is None else [f"{name} in {n} trials" for name, n in report.trials.failures]
    return [c.name for c in report.failures()] or (trials if not report.ok else [])


def motions(folder: Path, per_kind: int) -> Iterator[tuple[str, str, str, Motion]]:
    """Source, kind, name and motion of everything that is tried."""
    drawing: Generator | None = None
    for i in range(per_kind):
        for kind, prompts in KINDS.items():
            if i >= len(prompts):
                continue
            file = folder / f"{kind}-{i:02d}.npz"
            if not file.is_file():
                drawing = drawing or load_generator("mdm")
                save_motion(choose(drawing, prompts[i], candidates=DEFAULT_CANDIDATES, seed=i).motion, file)
            yield "generated", kind, prompts[i], load_motion(file)
    data = os.environ.get("RIGCAST_MOTION_DATA")
    if data is not None:
        for kind, patterns in CLIPS.items():
            files = [sorted(Path(data).expanduser().rglob(pattern)) for pattern in patterns]
            for file in [f for row in zip(*files, strict=False) for f in row][:per_kind]:
                yield "real", kind, file.stem, read_motion(file)


def measured(rig: Rig, folder: Path, per_kind: int, trials: int) -> list[dict[str, object]]:
    """One row per motion; what is known already is read from the folder."""
    rows = []
    for source, kind, name, motion in motions(folder, per_kind):
        file = folder / f"{rig.name}-{source}-{kind}-{name.replace(' ', '_').replace(',', '')}-{trials}.json"
        if not file.is_file():
            row = {"rig": rig.name, "source": source, "kind": kind, "name": name, **found_of(motion, rig, trials)}
            with replacing(file) as temporary:
                temporary.write_text(json.dumps(row), encoding="utf-8")
        rows.append(json.loads(file.read_text(encoding="utf-8")))
        print(f"  {rig.name} {source} {kind} {name}: {verdict(rows[-1])}", file=sys.stderr, flush=True)
    return rows


def verdict(row: dict) -> str:
    """In a few words."""
    for controller in ("open_loop", "imu"):
        if row.get(controller, {}).get("free"):
            return f"free, {controller}"
    last = row.get("imu") or row["open_loop"]
    return row.get("short") or ", ".join(last["why"])


def shares(rows: list[dict]) -> dict[str, float]:
    """Shares of `rows`: passing before and after mending (nominal run), and running free without and with an IMU."""

    def share(test) -> float:
        return sum(map(test, rows)) / len(rows)

    def any_of(row: dict, key: str) -> bool:
        return any(row.get(c, {}).get(key) for c in ("open_loop", "imu"))

    return {
        "before": share(lambda r: r["before"]),
        "after": share(lambda r: any_of(r, "after")),
        "open loop": share(lambda r: bool(r["open_loop"]["free"])),
        "with IMU": share(lambda r: any_of(r, "free")),
    }


def report(rows: list[dict]) -> list[Line]:
    """Print the table and the failures; the lines that have targets."""
    lines = []
    print(f"{'rig':<10} {'source':<10} {'kind':<8}   n   before    after  free: open loop  with IMU")
    groups = dict.fromkeys((r["rig"], r["source"], r["kind"]) for r in rows)
    for group in groups:
        mine = [r for r in rows if (r["rig"], r["source"], r["kind"]) == group]
        s = shares(mine)
        print(
            f"{group[0]:<10} {group[1]:<10} {group[2]:<8} {len(mine):>3} {s['before']:>8.0%} {s['after']:>8.0%} "
            f"{s['open loop']:>16.0%} {s['with IMU']:>9.0%}"
        )
        if group[2] in TARGETS:
            name = f"{group[1]} {group[2]}s that run free, of {len(mine)}"
            lines.append(Line(group[0], name, s["with IMU"], TARGETS[group[2]], True))
    for row in rows:
        if not any(row.get(c, {}).get("free") for c in ("open_loop", "imu")):
            print(f"  not free: {row['rig']}, {row['source']}: {row['name']}: {verdict(row)}")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rigs", nargs="*", default=RIGS)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core, but for generating")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    parser.add_argument("--per-kind", type=int, default=50, help="motions of each kind at most")
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--folder", type=Path, default=Path("runs/free_standing"))
    asked = parser.parse_args()
    per_kind, trials = QUICK if asked.quick else (asked.per_kind, asked.trials)
    asked.folder.mkdir(parents=True, exist_ok=True)
    rows = [row for name in asked.rigs for row in measured(load_rig(name), asked.folder, per_kind, trials)]
    lines = report(rows)
    for line in lines:
        print(text(line))
    if asked.json:
        print(json.dumps(rows))
    return gate(lines, asked.gate)


if __name__ == "__main__":
    sys.exit(main())
