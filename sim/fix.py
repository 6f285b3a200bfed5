"""The gate with mending before it: a motion that passes is left alone, one that fails is mended and judged again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from retarget.rig import Mount, Rig
from retarget.timeline import normalised
from retarget.trajectory import Trajectory
from sim.checks import judge
from sim.feedback import controllers
from sim.mending.feet import between
from sim.mending.mend import LONGEST, mend
from sim.mending.tidy import Mended, tidy
from sim.report import Change, Controller, Report
from sim.simulate import Rollout

PACES = (1.25, 1.5, 2.0)  # that are tried where servos are too slow or too weak
TIRED = {"speed_saturation", "torque_saturation", "tracking_joint", "tracking_body", "jerk", "servo_heat", "supply"}


def judge_mended(
    trajectory: Trajectory,
    rig: Rig,
    *,
    mount: Mount | None = None,
    fix: bool = True,
    trials: int = 0,
    seed: int = 0,
    threads: int = 1,
) -> tuple[Trajectory, Report, Rollout]:
    """The trajectory that `judge` passes, or the one that comes nearest, with its report and rollout.

    It is the given one where that passes, or without `fix`. Else, on its own feet, the mended one, first without a
    controller and then with what the rig has: its IMU, its full state; and where a stand or a harness holds it, a tidy
    one, then a slower one. The report tells what was changed. Raises what `judge` raises.
    """
    held = rig.mount if mount is None else mount

    def judged(what: Trajectory, controller: Controller = "open_loop") -> tuple[Trajectory, Report, Rollout]:
        return what, *judge(what, rig, mount=held, controller=controller, trials=trials, seed=seed, threads=threads)

    best = judged(trajectory)
    if best[1].ok or not fix:
        return best
    if held == "free" and rig.feet:
        mended = mend(trajectory, rig)
        tried = [(mended, controller) for controller in controllers(rig)]
    else:
        tired = {c.name for c in best[1].failures()} & TIRED
        tidied = tidy(trajectory, rig, held)
        paces = (1.0, *PACES) if tidied.changes else PACES
        tried = [(slowed(tidied, factor), "open_loop") for factor in paces] if tired or tidied.changes else []
    for mended, controller in tried:
        now = judged(mended.trajectory, controller)
        now = now[0], replace(now[1], changes=mended.changes), now[2]
        if now[1].ok:
            return now
        if len(now[1].failures()) < len(best[1].failures()):
            best = now
    return best


def slowed(tidied: Mended, factor: float) -> Mended:
    """`tidied` drawn out `factor` times. Raises ValueError for a factor below 1 or above LONGEST."""
    if not 1 <= factor <= LONGEST:
        raise ValueError(f"a motion can be slowed 1 to {LONGEST:g} times, not {factor}")
    if factor == 1:
        return tidied
    trajectory = tidied.trajectory
    last = len(trajectory) - 1
    at = np.linspace(0, last, round(last * factor) + 1)
    nearest = np.rint(at).astype(int)
    out = replace(
        trajectory,
        qpos=normalised(between(normalised(trajectory.qpos), at)),
        aim=None if trajectory.aim is None else between(trajectory.aim, at),
        contacts={name: flags[nearest] for name, flags in trajectory.contacts.items()},
        labels=tuple(replace(x, start_s=x.start_s * factor, end_s=x.end_s * factor) for x in trajectory.labels),
    )
    pace = Change("pace", factor, "times as long", f"It takes {factor:.2f} times as long.")
    return Mended(out, (*tidied.changes, pace))
