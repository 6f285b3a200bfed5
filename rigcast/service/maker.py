"""The process that makes motions for a service: `python -m rigcast.service.maker`.

Generating takes seconds in which a stream must not stutter, so it happens here, with a gate of its own. It reads a
`Setup` and then jobs from stdin, a line each, and answers on stdout; it ends with its stdin.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from rigcast import threads  # noqa: F401  (first: before numpy)

import msgspec  # isort: skip
import numpy as np  # isort: skip

from drivers.control import Figure
from drivers.messages import OPEN_LOOP
from motiongen.candidates import choose
from motiongen.generator import Generator, load_generator
from motiongen.motion import Source
from retarget.cut import cut_short
from retarget.files import load_trajectory, save_trajectory
from retarget.rig import Rig, load_rig
from retarget.trajectory import Trajectory
from rigcast.service.making import Cut, Idle, Job, Made, Make, Setup

if TYPE_CHECKING:
    from sim.report import Report

IDLE_TEXT, IDLE_SECONDS = "stand idle", 16.0
STILL_SECONDS, STILL_FPS = 4.0, 50.0


class Maker:
    """Does one job after the other. Raises what loading the rig and the generator raises."""

    def __init__(self, setup: Setup) -> None:
        from retarget.retarget import retarget
        from sim.fix import judge_mended

        self._setup = setup
        self._rig: Rig = load_rig(setup.rig, Path(setup.model) if setup.model else None)
        self._generator: Generator | None = load_generator(setup.generator) if setup.generator else None
        self._retarget, self._judge = retarget, judge_mended

    def do(self, job: Job) -> Made:
        """What came of `job`; a motion that cannot be made is told, not raised."""
        do: dict[type, Callable[..., Made]] = {Make: self._make, Idle: self._idle, Cut: self._cut}
        try:
            return do[type(job)](job)
        except (ValueError, RuntimeError, OSError) as error:
            return Made(job.number, ok=False, detail=" ".join(str(error).split()))

    def _make(self, job: Make) -> Made:
        if self._generator is None:
            raise ValueError("this maker has no generator")
        familiarity = self._generator.familiarity(job.text)
        notes = [] if familiarity.known else [f"unfamiliar; nearest: {', '.join(familiarity.nearest)}"]
        kept = choose(
            self._generator,
            job.text,
            candidates=self._setup.candidates,
            seconds=job.seconds,
            seed=job.seed,
            guidance=job.guidance,
        )
        if kept.drawn > 1:
            notes.append(str(kept))
        trajectory = self._retarget(kept.motion, self._rig, mount=self._setup.mount)
        return self._judged(job.number, trajectory, "; ".join(notes))

    def _idle(self, job: Idle) -> Made:
        motion = load_generator("gestures").generate(IDLE_TEXT, seconds=IDLE_SECONDS)
        made = self._judged(job.number, self._retarget(motion, self._rig, mount=self._setup.mount), "")
        return made if made.ok else self._judged(job.number, self._still(), "it stands still")

    def _cut(self, job: Cut) -> Made:
        return self._judged(job.number, cut_short(load_trajectory(job.path), job.frame, self._rig), "", fix=False)

    def _judged(self, number: int, trajectory: Trajectory, detail: str, *, fix: bool = True) -> Made:
        trajectory, report, _ = self._judge(trajectory, self._rig, mount=self._setup.mount, fix=fix)
        ok = report.ok and report.controller == OPEN_LOOP
        path = f"{self._setup.folder}/{number}.npz" if ok else ""
        if ok:
            save_trajectory(trajectory, path)
        elif report.ok:
            detail = f"it needs the controller {report.controller}, which nothing on a stream runs"
        else:
            detail = "; ".join(check.advice for check in report.failures())
        return Made(number, ok, detail, path, trajectory.duration, report.report_id, _figures(report))

    def _still(self) -> Trajectory:
        """The nominal pose, at the height at which the rig's idle motion begins."""
        motion = load_generator("gestures").generate(IDLE_TEXT, seconds=IDLE_SECONDS)
        first = self._retarget(motion, self._rig, mount=self._setup.mount)
        count = round(STILL_SECONDS * STILL_FPS) + 1
        contacts = {foot: np.full(count, down[0]) for foot, down in first.contacts.items()}
        qpos = np.tile(first.qpos[0], (count, 1))
        return Trajectory(qpos, STILL_FPS, self._rig.name, first.joints, contacts, source=Source("still"))


def _figures(report: Report) -> tuple[Figure, ...]:
    """The checks that apply, as plain numbers: what physics found may be numpy's."""
    return tuple(
        Figure(c.name, float(c.value), float(c.limit), c.unit, bool(c.ok), c.advice[:1000])
        for c in report.checks
        if c.applies
    )


def main() -> int:
    """Set up, then do jobs until stdin ends; 1 where the setup cannot be had."""
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what a library prints is no answer

    def tell(made: Made) -> None:
        answers.write(msgspec.json.encode(made) + b"\n")

    if not (line := sys.stdin.buffer.readline()):
        return 0
    setup = msgspec.json.decode(line, type=Setup)
    try:
        maker = Maker(setup)
    except (ValueError, RuntimeError, OSError, ModuleNotFoundError) as error:
        tell(Made(0, ok=False, detail=" ".join(str(error).split())))
        return 1
    tell(Made(0, ok=True, detail=setup.generator))
    for line in sys.stdin.buffer:
        tell(maker.do(msgspec.json.decode(line, type=Job)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
