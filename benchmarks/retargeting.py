"""Retargeting: the whole trajectory at once beside the per-frame method, on the same goals, in one run.

    python benchmarks/retargeting.py [--quick] [--json] [--gate] [RIG ...]

Clips are gestures, which need no data. Times are of the solving alone, in seconds of processor time, but for those of
the stream, which are of all that it does from a human frame to one of the rig.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from functools import partial

import mujoco
import numpy as np
from lines import Line, gate, text
from per_frame import per_frame

from motiongen.gestures.catalogue import gestures, perform
from motiongen.motion import Motion, cut
from motiongen.rotation import Array
from retarget.contacts import Flags, planted
from retarget.goals import Goal
from retarget.kinematics import Tree, meetings, on_body, poses, tree_of
from retarget.model import load_model
from retarget.rest import rest_of
from retarget.retarget import floor_goals
from retarget.rig import Rig, RigError, load_rig
from retarget.streaming import advance, drained, open_stream
from retarget.tracking import angles, reached, targets_of
from retarget.whole import solve

RIGS = ("puppet", "humanoid", "unitree_g1", "robotis_op3")  # those that are here
CLIPS, QUICK_CLIPS = 20, 3
LENGTHS, QUICK_LENGTHS = (10, 60, 600), (10, 30)  # s
SOUND = 1e-3  # m that a planted foot may move where the solution has converged
FPS = 50.0
ROUNDING = 1e-6  # rad


@dataclass(frozen=True)
class Figures:
    """Means over all frames of all clips."""

    frames_per_s: float
    position_m: float
    rotation_rad: float
    skate_m_per_s: float
    planted_moves_m: float
    penetration_m: float
    overlap_m: float
    jerk_rad_per_s3: float
    over_range: float
    over_speed: float
    over_acceleration: float


@dataclass(frozen=True)
class Clip:
    """What both methods are given."""

    goals: dict[str, Goal]
    stance: dict[str, Flags]


def clips_of(rig: Rig, model: mujoco.MjModel, count: int) -> list[Clip]:
    names = list(gestures())
    chosen = [names[i] for i in np.linspace(0, len(names) - 1, count).round().astype(int)]
    return [clip_of(perform(name, seed=i).resampled(FPS), rig, model) for i, name in enumerate(chosen)]


def clip_of(motion: Motion, rig: Rig, model: mujoco.MjModel) -> Clip:
    stance = planted(motion)
    return Clip(floor_goals(motion, rig, rest_of(rig, model), stance), stance)


def long(clip: Clip, seconds: float) -> Clip:
    """`clip` to and fro for `seconds`."""
    count = round(seconds * FPS)

    def tiled(values: Array) -> Array:
        both = np.concatenate([values, values[::-1]])
        return both[np.arange(count) % len(both)]

    goals = {
        name: replace(g, pos=tiled(g.pos), quat=tiled(g.quat), firm=tiled(g.firm)) for name, g in clip.goals.items()
    }
    return Clip(goals, {foot: tiled(flags) for foot, flags in clip.stance.items()})


def timed(method: Callable[[Clip], Array], clips: list[Clip]) -> tuple[list[Array], float]:
    method(clips[0])  # imports and caches
    start = time.process_time()
    solved = [method(clip) for clip in clips]
    return solved, sum(map(len, solved)) / (time.process_time() - start)


def figures(rig: Rig, tree: Tree, clips: list[Clip], solved: list[Array], frames_per_s: float) -> Figures:
    rows = [measured(rig, tree, clip, qpos) for clip, qpos in zip(clips, solved, strict=True)]
    weights = [len(qpos) for qpos in solved]
    mean = {key: float(np.average([row[key] for row in rows], weights=weights)) for key in rows[0]}
    mean["planted_moves_m"] = max(row["planted_moves_m"] for row in rows)
    return Figures(frames_per_s=frames_per_s, **mean)


def measured(rig: Rig, tree: Tree, clip: Clip, qpos: Array) -> dict[str, float]:
    at = poses(tree, qpos)
    places, turns = targets_of(list(clip.goals.values()), rig, tree.model)
    joints = qpos[:, 7:]
    speed = np.abs(np.diff(joints, axis=0)) * FPS
    acceleration = np.abs(np.diff(joints, n=2, axis=0)) * FPS**2
    skate, moves, low = [], [0.0], []
    for foot in rig.feet:
        sites = [tree.model.site(s) for s in foot.sites]
        sole = on_body(at, np.array([s.bodyid[0] for s in sites]), np.array([s.pos for s in sites]))
        low.append(np.maximum(-sole[..., 2], 0).max(1))
        both = clip.stance[foot.human][1:] & clip.stance[foot.human][:-1]
        step = np.linalg.norm(np.diff(sole, axis=0), axis=-1)[both]
        skate += (step * FPS).ravel().tolist()
        moves.append(float(step.sum(0).max(initial=0.0)))
    limits = rig.joints
    return {
        "position_m": float(np.linalg.norm(reached(places, at)[1], axis=-1).mean()),
        "rotation_rad": float(np.linalg.norm(angles(turns, at), axis=-1).mean()),
        "skate_m_per_s": float(np.mean(skate)) if skate else 0.0,
        "planted_moves_m": max(moves),
        "penetration_m": float(np.max(low, axis=0).mean()),
        "overlap_m": float(overlap(rig, tree.model, qpos).mean()),
        "jerk_rad_per_s3": float(np.abs(np.diff(joints, n=3, axis=0)).mean() * FPS**3),
        "over_range": float(
            ((joints < [j.lower - ROUNDING for j in limits]) | (joints > [j.upper + ROUNDING for j in limits])).mean()
        ),
        "over_speed": float((speed > [j.velocity + ROUNDING * FPS for j in limits]).mean()),
        "over_acceleration": float((acceleration > [j.acceleration + ROUNDING * FPS**2 for j in limits]).mean()),
    }


def overlap(rig: Rig, model: mujoco.MjModel, qpos: Array) -> Array:
    """(T,) metres by which two bodies are inside each other, at most, or more so than in the nominal pose."""
    usual, out = np.zeros((model.nbody, model.nbody)), np.zeros(len(qpos))
    for where, poses_of in ((usual, nominal(rig)[None]), (out, qpos)):
        met = meetings(model, poses_of)
        deeper = -met.apart - (usual[*met.bodies.T] if where is out else 0.0)
        np.maximum.at(where, met.frame if where is out else tuple(met.bodies.T), deeper)
    return out


def compared(rig: Rig, model: mujoco.MjModel, clips: list[Clip]) -> tuple[dict[str, Figures], list[Line]]:
    """Both methods on one rig, and what is held to a target."""
    tree, calls = tree_of(model), []

    def frame_by_frame(clip: Clip) -> Array:
        out = per_frame(rig, model, clip.goals, nominal(rig))
        calls.append(out.calls)
        return out.qpos

    slow = figures(rig, tree, clips, *timed(frame_by_frame, clips))
    fast = figures(rig, tree, clips, *timed(partial(at_once, rig, model), clips))
    frames = sum(len(clip.goals["pelvis"].pos) for clip in clips)
    per_call = sum(calls[1:]) / frames * slow.frames_per_s  # mink.solve_ik calls a second
    held, beyond = bound(slow), fast.over_range + fast.over_speed + fast.over_acceleration
    lines = [
        Line(rig.name, "frames/s over per-frame", fast.frames_per_s / slow.frames_per_s, 5.0, True),
        Line(rig.name, "time of a frame over one mink.solve_ik", per_call / fast.frames_per_s, 2.0, False),
        Line(rig.name, "position error over per-frame's × 1.1 + 5 mm", fast.position_m / held, 1.0, False),
        Line(rig.name, "skate over per-frame's", ratio(fast.skate_m_per_s, slow.skate_m_per_s), 0.1, False),
        Line(rig.name, "jerk over per-frame's", ratio(fast.jerk_rad_per_s3, slow.jerk_rad_per_s3), 1 / 3, False),
        Line(rig.name, "a planted foot moves by, m", fast.planted_moves_m, SOUND, False),
        Line(rig.name, "samples beyond a joint's range, speed or acceleration", beyond, 0.0, False),
    ]
    print(f"{rig.name}: {len(clips)} clips, {frames} frames, {sum(calls[1:]) / frames:.1f} mink.solve_ik a frame")
    return {"per frame": slow, "whole": fast}, lines


def by_length(rig: Rig, model: mujoco.MjModel, clip: Clip, lengths: tuple[int, ...]) -> list[Line]:
    """Cost and memory against length: prints the table."""
    costs = []
    for seconds in lengths:
        asked = long(clip, seconds)
        _, rate = timed(partial(at_once, rig, model), [asked])
        tracemalloc.start()
        at_once(rig, model, asked)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        costs.append(1 / rate)
        print(f"  {seconds:>5} s   {1e3 / rate:.3f} ms a frame   {most / 2**20:.0f} MiB at most")
    grown = costs[-1] / costs[0]
    return [
        Line(rig.name, f"time of a frame of {lengths[-1]} s over that of {lengths[0]} s", grown, 1.25, False),
        Line(rig.name, f"memory for {lengths[-1]} s, MiB", most / 2**20, 1024.0, False),
    ]


def streamed(rig: Rig, model: mujoco.MjModel) -> list[Line]:
    """What a live stream costs and how near it comes to the whole trajectory: prints a line for each look ahead."""
    motion = perform("wave", seed=0).resampled(FPS)
    whole = at_once(rig, model, clip_of(motion, rig, model))[:, 7:]
    inside = slice(round(1.2 * FPS), len(whole) - round(0.3 * FPS))
    lines = []
    for look_ahead in (0.2, 0.0):
        stream, progress = open_stream(rig, motion.skeleton, FPS, mount="free", look_ahead=look_ahead)
        advance(stream, progress, cut(motion, 0, 20))  # imports and caches
        start, out = time.process_time(), []
        for frame in range(len(motion)):
            progress, done = advance(stream, progress, cut(motion, frame, frame + 1))
            out.append(done.qpos)
        share = (time.process_time() - start) / len(motion) * FPS
        angles = np.concatenate([*out, drained(stream, progress).qpos])[:, 7:]
        off = float(np.sqrt(((angles - whole)[inside] ** 2).mean()))
        jerk = [float(np.abs(np.diff(a[inside], n=3, axis=0)).mean()) for a in (angles, whole)]
        print(
            f"  streamed, {look_ahead} s ahead: {1e3 * share / FPS:.1f} ms a frame, "
            f"{off:.4f} rad from the whole, jerk {jerk[0] / jerk[1]:.2f} times its"
        )
        lines.append(Line(rig.name, f"streamed {look_ahead} s ahead: share of real time", share, 0.5, False))
    return lines


def at_once(rig: Rig, model: mujoco.MjModel, clip: Clip) -> Array:
    return solve(rig, model, clip.goals, nominal(rig), FPS, fixed_root=False, planted=clip.stance)


def nominal(rig: Rig) -> Array:
    return np.array([0, 0, rig.nominal.height, 1, 0, 0, 0, *rig.pose_vector(rig.nominal)], float)


def here(names: list[str]) -> list[tuple[Rig, mujoco.MjModel]]:
    """The rigs of `names` whose models are on this machine; says which are not."""
    out = []
    for name in names:
        try:
            rig = load_rig(name)
            out.append((rig, load_model(rig)))
        except RigError as problem:
            print(f"{name} is left out: {problem}")
    return out


def bound(slow: Figures) -> float:
    return 1.1 * slow.position_m + 0.005


def ratio(a: float, b: float) -> float:
    return a / max(b, 1e-12)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rigs", nargs="*", default=RIGS)
    parser.add_argument("--quick", action="store_true", help="under a minute on one core")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--gate", action="store_true", help="exit 1 where a target is missed")
    asked = parser.parse_args()
    lines: list[Line] = []
    tables: dict[str, dict[str, Figures]] = {}
    for rig, model in here(asked.rigs):
        clips = clips_of(rig, model, QUICK_CLIPS if asked.quick else CLIPS)
        tables[rig.name], held = compared(rig, model, clips)
        lines += held
        for figure in fields(Figures):
            row = [f"{getattr(found, figure.name):>12.4g}" for found in tables[rig.name].values()]
            print(f"  {figure.name:<18}{''.join(row)}")
        lines += streamed(rig, model)
        lines += by_length(rig, model, clips[1], QUICK_LENGTHS if asked.quick else LENGTHS)
    for line in lines:
        print(text(line))
    if asked.json:
        print(json.dumps({name: {k: asdict(v) for k, v in found.items()} for name, found in tables.items()}))
    return gate(lines, asked.gate)


if __name__ == "__main__":
    sys.exit(main())
