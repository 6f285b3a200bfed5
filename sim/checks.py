"""The gate: a trajectory goes through physics, and out comes a report that says pass, or why not."""

from __future__ import annotations

import hashlib

from retarget.rig import Mount, Rig
from retarget.trajectory import Trajectory
from sim.balance import balance
from sim.commanded import COMMANDED
from sim.drives import DRIVES
from sim.evidence import Evidence
from sim.geometry import measure
from sim.physical import PHYSICAL
from sim.pinch import pinch
from sim.report import Controller, Report
from sim.scene import build_scene
from sim.simulate import Rollout, require_fit, run
from sim.standing import STANDING
from sim.thresholds import PASS_RATE, THRESHOLDS
from sim.trials import run_trials

CHECKS = (*COMMANDED, *STANDING, *PHYSICAL, *DRIVES, pinch)


def judge(
    trajectory: Trajectory,
    rig: Rig,
    *,
    mount: Mount | None = None,
    controller: Controller = "open_loop",
    trials: int = 0,
    seed: int = 0,
    threads: int = 1,
) -> tuple[Report, Rollout]:
    """The report on `trajectory`, and the nominal rollout that it rests on; `mount` defaults to the rig's own.

    With `trials` the motion is also run that often on disturbed rigs, drawn from `seed`, `threads` at a time, and
    passes only if nine in ten do; see `sim.trials`. Raises ValueError where the trajectory is not for this rig, the
    mount is unknown, it lacks what the controller takes, trials are negative or threads less than 1.
    """
    require_fit(trajectory, rig)
    held = rig.mount if mount is None else mount
    scene = build_scene(rig, held, trajectory.qpos[0])
    asked = measure(scene, trajectory.qpos)
    rollout = run(scene, trajectory, controller=controller)
    stands = balance(scene, trajectory) if held == "free" and rig.feet else None
    evidence = Evidence(trajectory, scene, rollout, asked, measure(scene, rollout.qpos), stands)
    checks = tuple(check(evidence) for check in CHECKS)
    tried = None
    if trials:
        tried = run_trials(trajectory, scene, asked, trials, seed=seed, threads=threads, controller=controller)
    report = Report(
        ok=all(c.ok for c in checks) and (tried is None or tried.rate >= PASS_RATE),
        report_id=report_id(trajectory, rig, held, controller),
        rig=rig.name,
        mount=held,
        controller=controller,
        duration_s=trajectory.duration,
        checks=checks,
        trials=tried,
    )
    return report, rollout


def check(trajectory: Trajectory, rig: Rig, *, mount: Mount | None = None) -> Report:
    """The report on `trajectory`; see `judge`."""
    return judge(trajectory, rig, mount=mount)[0]


def report_id(trajectory: Trajectory, rig: Rig, mount: Mount, controller: Controller = "open_loop") -> str:
    """16 hex digits over everything that the verdict depends on: frames, rate, rig, servos, mount and thresholds."""
    digest = hashlib.sha256(trajectory.qpos.astype("<f8").tobytes())
    digest.update(trajectory.targets.astype("<f8").tobytes())
    told = f"{rig.joints!r};{rig.servos!r};{rig.power!r};{rig.sensors!r};{rig.feet!r}"
    digest.update(f"{trajectory.fps!r};{told};{mount};{controller};{THRESHOLDS!r}".encode())
    return digest.hexdigest()[:16]
