"""Retargeting while the motion is still coming: frames in, frames out, a fixed look ahead later.

Each frame is solved with the few after it that are known, from the two before it, which stay; so is the next, and only
the first of them goes out, or as many as the stream was opened for. Everything that is remembered is in a `Progress`,
and nothing depends on how the motion is cut into blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from motiongen.motion import Motion, Skeleton, cut
from motiongen.rotation import Array, quat_conj, quat_mul, quat_rotate, slerp
from retarget.banded import REACH
from retarget.contacts import Flags
from retarget.descent import followed
from retarget.footing import Footing, Ground, footed, standing
from retarget.goals import ROOT, Goal, goals, leg_scale, root_goal
from retarget.incoming import HALF, Incoming, taken
from retarget.kinematics import on_body, poses
from retarget.limits import Limits, limits_of, next_within
from retarget.loops import differences, moved
from retarget.model import load_model
from retarget.rest import Rest, rest_of
from retarget.retarget import checked_mount, lowest, nominal_qpos
from retarget.rig import Mount, Rig
from retarget.timeline import eased
from retarget.tracking import Places, Turns, targets_of
from retarget.whole import SMOOTH, firmed
from retarget.window import Problem, Window, problem_of

LEAD = 1.0  # s in which the goals go over from the nominal pose to the motion
LOOK = 2  # frames, of which one is looked at for bodies that meet
STEPS = 2  # of Gauss-Newton a frame; it starts from the frame before's solution
PREVIEW = 3 / 8  # of the look ahead is seen by the solver, what is left serves to tell when feet stand
GUESSED = 6  # frames after those are guessed, so that what goes out does not run on where it will have to turn back
DECAY = 0.8  # a frame, of the speed at which guessed targets go on


@dataclass(frozen=True)
class Stream:
    """What stays: the rig, its model and problem, where the stream starts (`nominal` (nq,)), the skeleton and rate
    (`motion_fps`) of what comes, the rate `fps` of what goes out, and how the look ahead is shared out: `smooth` the
    motion or not, frames for the feet (`ground`) and for the solver (`preview`). On a stand there is no ground. `each`:
    frames that go out of a solution.
    """

    rig: Rig
    model: mujoco.MjModel
    rest: Rest
    problem: Problem
    nominal: Array
    skeleton: Skeleton
    motion_fps: float
    fps: float
    smooth: bool
    limits: Limits
    ground: Ground | None
    preview: int
    each: int

    @property
    def delay(self) -> int:
        """Frames that go out after the newest one that is sampled from the motion, at most."""
        return HALF * self.smooth + (self.ground.ahead if self.ground else 0) + self.preview + self.each - 1


@dataclass(frozen=True)
class Progress:
    """What a stream remembers. `begun`: how many frames have goals; `first` frame of the motion. `past` (REACH, nq)
    went out last; `ahead` is how it was solved, its last frame and those (preview + GUESSED, nq) after it.
    `planted` (n, feet) is of n frames that wait to be solved, `places` and `turns` of the past and of these.
    """

    incoming: Incoming
    first: Motion | None
    footing: Footing
    begun: int
    places: Places
    turns: Turns
    planted: Flags
    past: Array
    ahead: Array

    @property
    def done(self) -> int:
        """Frames that have gone out."""
        return self.begun - len(self.planted)


@dataclass(frozen=True)
class Streamed:
    """Frames that are done: `qpos` (n, 7 + nj) as a Trajectory has it, and by name which foot stands, (n,) each."""

    qpos: Array
    contacts: dict[str, Flags]


def open_stream(
    rig: Rig,
    skeleton: Skeleton,
    motion_fps: float,
    *,
    mount: Mount | None = None,
    fps: float = 50.0,
    look_ahead: float = 0.2,
    floor: float = 0.0,
    each: int = 1,
) -> tuple[Stream, Progress]:
    """A stream of `rig` doing what a motion of `skeleton` at `motion_fps` frames a second shows, and its beginning.

    It starts in the nominal pose, over the origin and facing +x, and goes over to the motion in LEAD s. A frame goes
    out `look_ahead` s after it came in, and as many more as it waits for the next one of the motion. `floor`: height of
    the floor in the motion's world, in metres. With `each` above 1, that many frames go out of each solution: it costs
    as much less, and the first of them waits for the last. The rest is as in `retarget`, but for easing out, since
    nobody knows when it ends. Raises RigError and ValueError as that does, and ValueError where `look_ahead` is below
    0 or `each` below 1.
    """
    mount = checked_mount(rig, mount)
    if not (np.isfinite(fps) and fps > 0 and np.isfinite(motion_fps) and motion_fps > 0):
        raise ValueError(f"fps must be above 0, not {fps:g} and {motion_fps:g}")
    if not (np.isfinite(look_ahead) and look_ahead >= 0):
        raise ValueError(f"look_ahead must be at least 0 s, not {look_ahead:g}")
    model = load_model(rig)
    rest, nominal = rest_of(rig, model), nominal_qpos(rig, mount)
    if each < 1:
        raise ValueError(f"each must be at least 1 frame, not {each}")
    ahead = round(look_ahead * fps)
    smooth = ahead >= 2 * HALF
    ahead -= HALF * smooth
    preview = round(PREVIEW * ahead) if mount != "stand" else ahead
    still = Motion(np.zeros((1, 3)), np.tile([1.0, 0, 0, 0], (1, len(skeleton.names), 1)), fps, skeleton)
    ground = None
    if mount != "stand":
        ground = Ground(rest, floor, fps, rig.nominal.height, leg_scale(still, rest), ahead - preview)
    problem = problem_of(rig, model, nominal, fixed_root=mount == "stand", grounded=mount != "stand")
    stream = Stream(
        rig,
        model,
        rest,
        problem,
        nominal,
        skeleton,
        motion_fps,
        fps,
        smooth,
        limits_of(rig, fps),
        ground,
        preview,
        each,
    )
    asked = _asked(stream, still, still)
    places, turns = targets_of(list(asked.values()), rig, model)
    places, turns = _led_in(stream, places.at([0] * REACH), turns.at([0] * REACH), np.zeros(REACH))
    none = np.zeros((0, len(rig.feet)), bool)
    past, plan = (np.tile(nominal, (count, 1)) for count in (REACH, preview + GUESSED + 1))
    return stream, Progress(Incoming(), None, standing(asked, rest), 0, places, turns, none, past, plan)


def advance(stream: Stream, progress: Progress, motion: Motion) -> tuple[Progress, Streamed]:
    """The progress after the frames of `motion`, and what is done by them: none, some, or many.

    Raises ValueError where `motion` has another skeleton or rate than the stream was opened for.
    """
    return _gone_out(stream, _come_in(stream, progress, motion))


def turned(stream: Stream, progress: Progress, earlier: Progress, motion: Motion) -> tuple[Progress, Streamed]:
    """`advance` where `motion` does not follow the frames that `progress` knows, but those that `earlier` did: what was
    to come has changed its mind, and what has gone out since stays.

    Raises ValueError as `advance` does, where `earlier` is not before `progress` in the same stream, and where `motion`
    ends before what has gone out.
    """
    gone = progress.done - earlier.done
    wanted = _come_in(stream, earlier, motion)
    if not 0 <= gone <= len(wanted.planted):
        raise ValueError(f"of {gone} frames that went out since, {len(wanted.planted)} are known anew")
    rest = slice(gone, None)
    places, turns, planted = wanted.places.at(rest), wanted.turns.at(rest), wanted.planted[rest]
    past, ahead = progress.past, progress.ahead
    return _gone_out(stream, replace(wanted, places=places, turns=turns, planted=planted, past=past, ahead=ahead))


def _come_in(stream: Stream, progress: Progress, motion: Motion) -> Progress:
    """The progress with the frames of `motion`, none solved."""
    if motion.fps != stream.motion_fps or motion.skeleton.names != stream.skeleton.names:
        raise ValueError(
            f"the stream was opened for {len(stream.skeleton.names)} joints at {stream.motion_fps:g} fps, "
            f"not {len(motion.skeleton.names)} at {motion.fps:g}"
        )
    incoming, new = taken(progress.incoming, motion, stream.fps, smooth=stream.smooth)
    progress = replace(progress, incoming=incoming)
    return progress if new is None else _wanted(stream, progress, new)


def _gone_out(stream: Stream, progress: Progress) -> tuple[Progress, Streamed]:
    """The progress after all frames that can be solved, and these."""
    out, stand = [progress.past[:0]], [progress.planted[:0]]
    while len(progress.planted) >= stream.preview + stream.each:
        stand.append(progress.planted[: stream.each])
        progress, done = _solved(stream, progress)
        out.append(done)
    qpos, flags = np.concatenate(out), np.concatenate(stand)
    contacts = {foot.name: flags[:, i] for i, foot in enumerate(stream.rig.feet)}
    return progress, Streamed(_above_floor(stream, qpos), contacts)


def drained(stream: Stream, progress: Progress) -> Streamed:
    """What is still to go out where the motion has ended: its last frame is held for as long as the stream is late."""
    last, left = progress.incoming.last, progress.incoming.sampled - progress.done
    count = int(np.ceil((stream.delay + stream.each) * stream.motion_fps / stream.fps)) if left else 0
    if last is None or count == 0:
        return Streamed(progress.past[:0], {foot.name: np.zeros(0, bool) for foot in stream.rig.feet})
    held = last.sampled(np.zeros(count), last.fps)
    rest = advance(stream, progress, held)[1]
    return Streamed(rest.qpos[:left], {foot: flags[:left] for foot, flags in rest.contacts.items()})


def _wanted(stream: Stream, progress: Progress, new: Motion) -> Progress:
    """The progress with what the frames `new` ask for, and those before them that only now are decided."""
    first = cut(new, 0, 1) if progress.first is None else progress.first
    progress = replace(progress, first=first)
    asked = _asked(stream, new, first)
    planted: dict[str, Flags] = {}
    if stream.ground is not None:
        footing, asked, planted = footed(stream.ground, progress.footing, new, asked)
        progress = replace(progress, footing=footing)
    count = len(next(iter(asked.values())).pos)
    if count == 0:
        return progress
    rig = stream.rig
    places, turns = targets_of(firmed(asked, planted), rig, stream.model)
    share = eased((progress.begun + np.arange(count)) / (LEAD * stream.fps))
    places, turns = _led_in(stream, places, turns, share)
    flags = np.zeros((count, len(rig.feet)), bool)
    for i, foot in enumerate(rig.feet):
        flags[:, i] = planted.get(foot.human, flags[:, i]) & (share == 1)
    return replace(
        progress,
        places=progress.places.then(places),
        turns=progress.turns.then(turns),
        planted=np.concatenate([progress.planted, flags]),
        begun=progress.begun + count,
    )


def _asked(stream: Stream, motion: Motion, first: Motion) -> dict[str, Goal]:
    """Goals of a root at the nominal pose on a stand; else of one at height 0 on its path from the frame `first` on."""
    rig, rest, count = stream.rig, stream.rest, len(motion)
    if stream.ground is None:
        root_pos, root_quat = (np.tile(part, (count, 1)) for part in (stream.nominal[:3], stream.nominal[3:7]))
        return goals(motion, rig, rest, root_pos, root_quat)
    root_pos, root_quat = root_goal(motion, rest, first)
    root = next(follow for follow in rig.follow if follow.human == ROOT)
    of_root = {ROOT: Goal(root, "", root_pos, root_quat, np.ones(count))}
    return goals(motion, rig, rest, root_pos, root_quat) | of_root


def _led_in(stream: Stream, places: Places, turns: Turns, share: Array) -> tuple[Places, Turns]:
    """The targets that go over from where the nominal pose has the followers as `share` (T,) goes from 0 to 1."""
    if (share == 1).all():
        return places, turns
    at = poses(stream.problem.tree, stream.nominal[None])
    back = quat_conj(at.turn[:, places.base])
    there = quat_rotate(back, on_body(at, places.body, places.spot) - at.place[:, places.base])
    facing = quat_mul(quat_conj(at.turn[:, turns.base]), at.turn[:, turns.body])
    u = share[:, None]
    place = there + u[..., None] * (places.place - there)
    return replace(places, place=place), replace(turns, turn=slerp(facing, turns.turn, u))


def _solved(stream: Stream, progress: Progress) -> tuple[Progress, Array]:
    """The progress `each` frames on, and these frames (each, nq)."""
    each = stream.each
    seen, rest = slice(REACH + stream.preview + each), slice(each, None)
    places, turns = _guessed(progress.places.at(seen), progress.turns.at(seen))
    window = Window(places, turns, REACH, 1 / stream.fps, SMOOTH, LOOK)
    guess = np.concatenate([progress.past, progress.ahead[1:]])
    for _ in range(each):  # the newest frames, each as fast as the one before it
        guess = np.concatenate([guess, moved(guess[-1:], differences(guess[-2:]))])
    ahead = followed(stream.problem, window, guess, STEPS)[REACH - 1 :]
    past = progress.past
    for now in ahead[1 : 1 + each].copy():
        before = past[-1]
        now[7:] = next_within(past[-2:, 7:], now[7:], now[7:] - before[7:], stream.limits)
        now[3:7] *= np.copysign(1.0, now[3:7] @ before[3:7])
        past = np.concatenate([past, now[None]])
    return replace(
        progress,
        places=progress.places.at(rest),
        turns=progress.turns.at(rest),
        planted=progress.planted[rest],
        past=past[-REACH:],
        ahead=ahead[each:],
    ), past[REACH:]


def _guessed(places: Places, turns: Turns) -> tuple[Places, Turns]:
    """The targets and GUESSED more, which go on ever more slowly."""
    share = 1 + np.cumsum(DECAY ** np.arange(1, GUESSED + 1))[:, None]
    before, last = places.place[-2:]
    turned = slerp(turns.turn[-2], turns.turn[-1], share)
    newest = [-1] * GUESSED
    place = before + share[..., None] * (last - before)
    return places.then(replace(places.at(newest), place=place)), turns.then(replace(turns.at(newest), turn=turned))


def _above_floor(stream: Stream, qpos: Array) -> Array:
    """`qpos` (n, nq), the root raised where it takes that to keep soles and bodies above the floor."""
    if stream.ground is None or not len(qpos):
        return qpos
    low = lowest(qpos, stream.rig, stream.problem.tree)
    return qpos + np.maximum(-low, 0.0)[:, None] * np.eye(len(qpos[0]))[2]
