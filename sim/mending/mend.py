"""Mend a motion so that its rig can do it on its own feet, and say what was changed.

Footholds that the rig can tread, at a pace at which it can, a root that keeps the zero-moment point within the soles,
legs that fit both, and targets from which servos under load come to just that. Arms, head and trunk keep their angles,
but where they jerk or go through one another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from motiongen.motion import Label
from motiongen.rotation import Array
from retarget.kinematics import Poses, poses
from retarget.rig import Rig
from retarget.trajectory import Trajectory
from sim.mending.apart import pushed_apart
from sim.mending.body import Body, body_of
from sim.mending.feet import Feet, find_feet
from sim.mending.lead import led
from sim.mending.legs import stand
from sim.mending.pace import Pace, find_pace, hurried, segments
from sim.mending.root import follow, height, shown
from sim.mending.steps import Steps, find_steps
from sim.mending.tidy import SHORTEST, Mended, leg_joints, tidy
from sim.mending.weight import shift
from sim.report import Change

MARGIN = 0.6  # of half the breadth of a sole, that the zero-moment point keeps from its edge
ROUNDS = 6  # of balance at most; each leaves about a quarter of what was amiss
BALANCED = 0.008  # of the root's height: less amiss is well within the margin
PACES = 8  # tried at most
# Shares of the longest step, and of the time, that are tried until servos are fast enough for them.
STRIDES = ((1.0, 0.93), (0.9, 0.93), (0.8, 0.93), (0.7, 0.93), (1.0, 1.0))
LONGEST = 2.0  # times as long as it was, at most
SLACK = 1.05  # slower than a servo's speed takes


@dataclass(frozen=True)
class _Draft:
    """A motion at one pace: `moved` (T, 2) m is what balance added to the root, `aside` rad how far arms gave way to
    legs, `amiss` m what balance left to do, `speed` (T,) that of the fastest joint over its servo's.
    """

    pace: Pace
    feet: Feet
    qpos: Array
    moved: Array
    aside: float
    amiss: float
    speed: Array


def mend(trajectory: Trajectory, rig: Rig) -> Mended:
    """`trajectory`, as its rig can do it on its own feet; it may take twice as long.

    Raises ValueError where the rig has no feet, or one without a sole.
    """
    if not rig.feet:
        raise ValueError(f"rig {rig.name!r} has no feet to stand on")
    if len(trajectory) < SHORTEST:
        return Mended(trajectory, ())
    was, tidied = trajectory, tidy(trajectory, rig, "free")
    trajectory, body = tidied.trajectory, body_of(rig)
    at = poses(body.tree, trajectory.qpos)
    tried: list[tuple[Steps, _Draft]] = []
    for stride, share in STRIDES:
        steps = find_steps(body, trajectory, at, LONGEST, stride)
        tried.append((steps, _paced(body, trajectory, steps, at, share)))
        if tried[-1][1].speed.max() <= SLACK:
            break
    steps, draft = min(tried, key=lambda each: each[1].speed.max())
    contacts = {leg.name: draft.feet.stands[:, i] for i, leg in enumerate(body.legs)}
    aim = led(body, draft.qpos, draft.feet, trajectory.fps)
    labels = _shifted(trajectory.labels, draft.pace, trajectory.fps)
    mended = replace(trajectory, qpos=draft.qpos, contacts=contacts, aim=aim, labels=labels)
    return Mended(mended, (*tidied.changes, *_changes(was, mended, steps, draft)))


def _paced(body: Body, trajectory: Trajectory, steps: Steps, at: Poses, share: float) -> _Draft:
    """`steps` at a pace at which servos are fast enough, as far as `share` of the time allows."""
    longest = LONGEST * (len(trajectory) - 1)
    drawn = np.full(2 * len(steps.swings) + 1, hurried(steps, body.beat, trajectory.fps, longest))
    for _ in range(PACES):
        draft = _draft(body, trajectory, steps, at, drawn)
        lasts = np.diff(draft.pace.marks)
        spare = share * longest - lasts.sum()
        if draft.speed.max() <= 1 or spare < 1:
            break
        need = np.ones(len(drawn))
        np.maximum.at(need, segments(draft.pace), SLACK * draft.speed)
        drawn = drawn * (1 + (need - 1) * min(1.0, spare / ((need - 1) @ lasts)))
    return draft


def _draft(body: Body, trajectory: Trajectory, steps: Steps, at: Poses, drawn: Array) -> _Draft:
    """`steps` at the pace of `drawn`, in as many rounds of balance as it takes."""
    fps = trajectory.fps
    pace = find_pace(steps, drawn, body.beat, fps)
    feet = find_feet(body, steps, pace, at)
    base = follow(body, shown(trajectory.qpos, pace), at, pace, feet, fps)
    allowed = np.array([j.velocity for j in body.rig.joints])
    margin = MARGIN * float(np.ptp(body.legs[0].sole[:, 1])) / 2
    moved, aside, rounds = np.zeros((len(base), 2)), 0.0, 0
    arms = ~leg_joints(body.rig)
    while True:
        qpos = base.copy()
        qpos[:, :2] += moved
        qpos[:, 2] = height(body, qpos, feet, fps)
        qpos = stand(body, qpos, feet)
        clear = pushed_apart(body.rig, qpos, fps, arms).qpos
        aside, qpos = max(aside, float(np.abs(clear - qpos).max())), clear
        base[:, 7:] = qpos[:, 7:]  # legs start from there next time
        more, amiss = shift(body, qpos, feet, fps, margin)
        rounds += 1
        if amiss < BALANCED * body.height or rounds == ROUNDS:
            break
        moved += more
    speed = (np.abs(np.diff(qpos[:, 7:], axis=0)) * fps / allowed).max(1, initial=0.0)
    return _Draft(pace, feet, qpos, moved, aside, amiss, np.concatenate([[0.0], speed]))


def _shifted(labels: tuple[Label, ...], pace: Pace, fps: float) -> tuple[Label, ...]:
    """The labels at the times where their stretch of the motion now is."""
    frames = np.arange(len(pace.at))
    times = [np.interp([label.start_s * fps, label.end_s * fps], pace.at, frames) / fps for label in labels]
    return tuple(replace(x, start_s=float(s), end_s=float(e)) for x, (s, e) in zip(labels, times, strict=True))


def _changes(was: Trajectory, now: Trajectory, steps: Steps, draft: _Draft) -> tuple[Change, ...]:
    longer = now.duration / max(was.duration, 1e-9)
    moved = float(np.linalg.norm(draft.moved, axis=1).max())
    lead = float(np.abs(now.targets - now.joint_pos).max())
    said = (
        Change("pace", longer, "times as long", f"It takes {longer:.2f} times as long."),
        Change("balance", moved, "m", f"The root moves up to {moved * 1000:.0f} mm, to keep the weight on the soles."),
        Change("steps", len(steps.swings), "steps", f"{len(steps.swings)} steps, one at a time and soles level."),
        Change("shortened", steps.shortened, "m", f"A step was cut by {steps.shortened * 1000:.0f} mm."),
        Change("closing", float(steps.closing), "steps", "A step was added that brings the feet together."),
        Change("aside", draft.aside, "rad", f"Arms move up to {draft.aside:.2f} rad out of the way of the legs."),
        Change("turning", steps.turning, "steps", f"{steps.turning} steps were added to turn as far as asked for."),
        Change("lead", lead, "rad", f"Servos are told up to {lead:.3f} rad more, as far as loads bend them."),
    )
    return tuple(c for c in said if abs(c.amount - (c.name == "pace")) > 1e-3)
