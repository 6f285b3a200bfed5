"""Whether a rig runs a motion free, and what is tried for it.

A motion runs free where nothing but its servos moves it, at least 9 in 10 disturbed trials pass every check, its root
goes at least 70 % as far as that of the motion that was asked for, it takes at most twice as long, and it is still
recognised. For that the nominal run is read back as human motion (`read_back.py`): what is labelled, without the way
in and out, and at the pace of what was asked for. Either the classifier of contents that `rigcast eval` trains must say
of it what it says of the person's own motion, or of that on the rig before any physics, as some rigs cannot show some
contents at all. Or, where the text says something that can be measured (`motiongen/measure`: steps, turns, distance,
sides, counts) and one of those two does it, it must do it too; a step that mending adds to bring the feet together does
not count.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from read_back import read_back

from motiongen.measure.clip import observe
from motiongen.motion import Motion
from motiongen.text.asking import asked_of
from motiongen.text.claims import Asked as Said
from motiongen.text.claims import holds
from retarget.retarget import retarget
from retarget.rig import Rig
from retarget.trajectory import Trajectory
from sim.checks import judge
from sim.feedback import controllers
from sim.geometry import measure
from sim.mending.mend import LONGEST, mend
from sim.mending.tidy import Mended
from sim.report import Controller
from sim.scene import build_scene
from sim.thresholds import PASS_RATE
from sim.trials import run_trials

FAR = 0.7  # of the way that was asked for
GOES = 0.5  # root heights: who goes less far does not go anywhere
CALM = 1.0  # s over which swaying from foot to foot is smoothed away, as it is no way made
BATCHES = (3, 6, 1)  # trials that are run before it is asked whether more of them could change anything

Judge = Callable[[Motion], str]  # the content that a motion shows


@dataclass(frozen=True)
class Try:
    """One way to run a motion: whether it was `mended` and under which `controller`; what `failed` without any
    disturbance, `trials` as (passed, run) and what most of them `fell_to`; `longer` and `far` as shares of what was
    asked for; and whether it is still recognised, by the content that it `shows` or by what it measurably `does`.
    """

    mended: bool
    controller: Controller
    failed: tuple[str, ...]
    trials: tuple[int, int]
    fell_to: tuple[tuple[str, int], ...]
    longer: float
    far: float
    shows: bool
    does: bool


@dataclass(frozen=True)
class Asked:
    """A motion that is asked for: of a person, on the rig, and the contents that these two show; `says` is what can be
    measured of it and one of the two does, None where there is no such thing.
    """

    motion: Motion
    rig: Rig
    trajectory: Trajectory
    contents: frozenset[str]
    says: Said | None


def way(trajectory: Trajectory) -> float:
    """Metres that the root goes along the floor, its sway smoothed away."""
    width = max(1, min(round(CALM * trajectory.fps), len(trajectory)))
    padded = np.pad(trajectory.root_pos[:, :2], ((width // 2, width // 2), (0, 0)), mode="edge")
    smooth = np.stack([np.convolve(padded[:, i], np.ones(width) / width, mode="valid") for i in range(2)], axis=1)
    return float(np.linalg.norm(np.diff(smooth, axis=0), axis=1).sum())


def asked_for(motion: Motion, words: str, rig: Rig, sees: Judge) -> Asked:
    """What the rig should do, and how to recognise it."""
    trajectory = retarget(motion, rig, mount="free")
    both = motion, read_back(trajectory.qpos[labelled(trajectory)], trajectory.fps, rig, motion.skeleton)
    says = asked_of(words)
    if says is not None and not any(holds(says, observe(each)) for each in both):
        says = None
    return Asked(motion, rig, trajectory, frozenset(map(sees, both)), says)


def found_of(asked: Asked, trials: int, threads: int, sees: Judge) -> dict[str, object]:
    """What becomes of one motion on one rig: all that was tried, up to the first that runs free."""
    before = judge(asked.trajectory, asked.rig, mount="free")[0].ok
    run = partial(tried, asked, count=trials, threads=threads, sees=sees)
    tries = [run(Mended(asked.trajectory, ()), "open_loop")] if before else []
    if not any(map(is_free, tries)):
        mended = mend(asked.trajectory, asked.rig)
        for controller in controllers(asked.rig):
            tries.append(run(mended, controller))
            if is_free(tries[-1]):
                break
    return {"before": before, "tries": [asdict(t) for t in tries]}


def tried(asked: Asked, mended: Mended, controller: Controller, *, count: int, threads: int, sees: Judge) -> Try:
    """`mended` without disturbance and, if that passes, in up to `count` trials: fewer where the verdict is clear."""
    what = mended.trajectory
    report, rollout = judge(what, asked.rig, mount="free", controller=controller)
    scene = build_scene(asked.rig, "free", what.qpos[0])
    passed, done, fell = 0, 0, Counter[str]()
    for batch in BATCHES if report.ok else ():
        many = min(batch, count - done)
        if many <= 0 or passed >= PASS_RATE * count or passed + count - done < PASS_RATE * count:
            break
        geometry = measure(scene, what.qpos)
        found = run_trials(what, scene, geometry, many, first=done, threads=threads, controller=controller)
        passed, done = passed + found.passed, done + many
        fell.update(dict(found.failures))
    longer = what.duration / asked.trajectory.duration
    far = way(what) / way(asked.trajectory) if way(asked.trajectory) > GOES * asked.rig.nominal.height else 1.0
    part, was = labelled(what), labelled(asked.trajectory)
    slower = (part.stop - part.start) / (was.stop - was.start)
    shown = read_back(rollout.qpos[part], rollout.fps * slower, asked.rig, asked.motion.skeleton)
    return Try(
        mended=bool(mended.changes),
        controller=controller,
        failed=tuple(check.name for check in report.failures()),
        trials=(passed, done),
        fell_to=tuple(fell.most_common(4)),
        longer=longer,
        far=far,
        shows=sees(shown) in asked.contents,
        does=asked.says is not None and does(asked.says, shown, any(c.name == "closing" for c in mended.changes)),
    )


def does(says: Said, shown: Motion, closing: bool) -> bool:
    """Whether a motion does what is said, with one step more where that brings the feet together."""
    claims = tuple(replace(c, count=c.count + 1) if c.action == "step" and c.count else c for c in says.claims)
    seen = observe(shown)
    return holds(says, seen) or (closing and holds(replace(says, claims=claims), seen))


def labelled(trajectory: Trajectory) -> slice:
    """The frames that the labels of a trajectory tell of; all where it has none."""
    if not trajectory.labels:
        return slice(0, len(trajectory))
    start, end = min(x.start_s for x in trajectory.labels), max(x.end_s for x in trajectory.labels)
    return slice(round(start * trajectory.fps), round(end * trajectory.fps) + 1)


def is_free(found: Try) -> bool:
    """Whether it counts as running free."""
    return not found.failed and not short_of(found)


def short_of(found: Try) -> str:
    """What is missing beside what failed without disturbance; nothing where it runs free."""
    passed, done = found.trials
    if found.far < FAR:
        return f"goes {found.far:.0%} of the way"
    if found.longer > LONGEST + 0.02:
        return f"takes {found.longer:.2f} times as long"
    if not (found.shows or found.does):
        return "is not recognised any more"
    if done and passed < PASS_RATE * done:
        return f"{done - passed} of {done} trials fail: {', '.join(name for name, _ in found.fell_to)}"
    return ""


def judge_in(file: Path) -> Judge:
    """The classifier of contents in `file`; where there is none, all motions show the same."""
    if not file.is_file():
        print(f"  no classifier of contents in {file}: contents are not judged", file=sys.stderr)
        return lambda motion: ""
    import torch

    from motiongen.evaluation.language.prompts import family
    from motiongen.evaluation.run.judges import load_contents
    from motiongen.features import FPS

    torch.set_num_threads(1)
    contents = load_contents(file)
    return lambda motion: family(contents.judge_motions([motion.resampled(FPS)])[0])
