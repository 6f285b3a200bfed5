"""Feet on the floor while the motion is still coming: `contacts.py` and `feet.py`, frame by frame.

A foot is planted once its human's has stood for a while, and lets go once that has lifted. Knowing a little of the
future (`ahead`), it sets down where the human's does, when it does; else it is late by as long as it takes to be sure.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from motiongen.motion import FOOT_JOINTS, Motion
from motiongen.rotation import (
    Array,
    quat_conj,
    quat_mul,
    quat_rotate,
    quat_to_rotvec,
    rotvec_to_quat,
    yaw_of_quat,
    yaw_quat,
)
from retarget.contacts import RELEASE, SHORTEST, SUPPORT_HEIGHT, Flags, above_floor, feet, slow_and_low
from retarget.feet import BESIDE, CLEARANCE, FIRMING, PASSING, SWING
from retarget.goals import Goal
from retarget.rest import Rest
from retarget.treads import kept_apart

LET_GO = 0.2  # s in which a foot that lifts forgets where it stood
NO_ROWS = (np.zeros((0, 3)), np.zeros((0, 4)), np.zeros(0), np.zeros(0, bool))
SLIP, SPIN = 0.15, 0.5  # root heights, rad: a human foot that slides or turns farther than that is set down anew


@dataclass(frozen=True)
class Ground:
    """The floor at z = `floor` m of the motion's world; `fps` of the frames; the rig's `rest`, nominal root height
    `size` (m) and leg length over the human's `scale`; how many frames are known `ahead`.
    """

    rest: Rest
    floor: float
    fps: float
    size: float
    scale: float
    ahead: int

    @property
    def settling(self) -> int:
        """Frames in which a foot is set down."""
        return max(round(SHORTEST * self.fps), 1)


@dataclass(frozen=True)
class Foot:
    """One foot: whether it is `planted` and for how many frames not (`away`); for how many newest frames its human's
    has `stood` or been `up` without a break; the `spot` (x, y, yaw) where it stands or is about to, `aside` (2,) of the
    human's so as not to stand on the other one; how its goal is moved, `shift` (3,) m, and `turn` (3,) rad, and where
    it was asked for `before` (2,) all that.
    """

    planted: bool
    away: int
    stood: int
    up: int
    spot: Array
    aside: Array
    shift: Array
    turn: Array
    before: Array | None


@dataclass(frozen=True)
class Footing:
    """`joints` (4, 3) and `touch` (4,): where the human's FOOT_JOINTS were last, and which stood. The root's height is
    the scaled human one plus `lift`; of it, `gap` is what is still to be made good of a landing `landed` frames ago
    (-1 in the air). `goals` of `ahead` frames wait, with `heights` and `held`: scaled pelvis heights, and who stood.
    """

    feet: dict[str, Foot]
    joints: Array | None
    touch: Flags
    lift: float
    gap: float
    landed: int
    goals: dict[str, Goal]
    heights: Array
    held: Flags


def standing(goals: dict[str, Goal], rest: Rest) -> Footing:
    """Before the first frame; `goals` are any of the rig's."""
    foot = Foot(False, 10**6, 0, 0, np.zeros(3), np.zeros(2), np.zeros(3), np.zeros(3), None)
    none = {name: frames(g, 0, 0) for name, g in goals.items()}
    these = {name: foot for name in rest.soles if name in goals}
    return Footing(these, None, np.zeros(4, bool), 0.0, 0.0, 0, none, np.zeros(0), np.zeros(0, bool))


def frames(goal: Goal, start: int, end: int) -> Goal:
    """Frames `start` up to `end` of a goal."""
    return Goal(goal.follow, goal.base, goal.pos[start:end], goal.quat[start:end], goal.firm[start:end])


def following(first: Goal, second: Goal) -> Goal:
    """The frames of the one, then of the other."""
    if not len(first.pos):
        return second
    pos, quat, firm = (
        np.concatenate([getattr(first, part), getattr(second, part)]) for part in ("pos", "quat", "firm")
    )
    return Goal(first.follow, first.base, pos, quat, firm)


def footed(
    ground: Ground, state: Footing, motion: Motion, goals: dict[str, Goal]
) -> tuple[Footing, dict[str, Goal], dict[str, Flags]]:
    """The state after the frames of `motion` whose `goals` these are, and what is decided by now: `ahead` frames fewer.

    `goals` are those of a root at height 0; given back, with the root on its feet, planted feet where they stand and
    the others above the floor. Flags say, by human joint, in which of those frames a foot is planted.
    """
    joints = feet(motion)
    height = above_floor(motion.skeleton, joints, ground.floor)
    all_goals = {name: following(state.goals[name], goal) for name, goal in goals.items()}
    heights = np.concatenate([state.heights, ground.scale * (motion.root_pos[:, 2] - ground.floor)])
    held = np.concatenate([state.held, height.min(1) < SUPPORT_HEIGHT])
    waiting, rises = len(state.heights), []
    rows: dict[str, list[tuple[Array, Array, float, bool]]] = {name: [] for name in state.feet}
    for new in range(len(motion)):
        touch = _touch(ground, state, motion, joints[new], height[new], new)
        state = replace(state, touch=touch, joints=joints[new])
        newest, now = waiting + new, waiting + new - ground.ahead
        stood = {n: _stood(ground, f, touch, n, all_goals[n], newest) for n, f in state.feet.items()}
        state = replace(state, feet=_beside(ground, state.feet, stood))
        if now < 0:
            continue
        state, rise = _set_down(ground, state, all_goals, heights[now], bool(held[now]), newest)
        rises.append(rise)
        for name, row in _asked(ground, state, all_goals, rise, now).items():
            rows[name].append(row)
        state = replace(state, feet={n: replace(f, before=all_goals[n].pos[now, :2]) for n, f in state.feet.items()})
    count = len(rises)
    out = {name: _raised(frames(goal, 0, count), np.array(rises)) for name, goal in all_goals.items()}
    planted = {}
    for name, found in rows.items():
        pos, quat, firm, flags = (np.array(part) for part in zip(*found, strict=True)) if found else NO_ROWS
        out[name] = replace(out[name], pos=pos, quat=quat, firm=firm)
        planted[name] = flags
    state = replace(
        state,
        goals={name: frames(goal, count, len(heights)) for name, goal in all_goals.items()},
        heights=heights[count:],
        held=held[count:],
    )
    return state, out, planted


def _touch(ground: Ground, state: Footing, motion: Motion, joints: Array, height: Array, frame: int) -> Flags:
    """(4,): which of the human's foot joints stand."""
    if motion.contacts is not None:
        return motion.contacts[frame]
    before = joints if state.joints is None else state.joints
    speed = np.linalg.norm(joints - before, axis=1) * ground.fps
    return slow_and_low(speed, height) | (state.touch & slow_and_low(speed, height, RELEASE))


def _stood(ground: Ground, foot: Foot, touch: Flags, name: str, goal: Goal, newest: int) -> Foot:
    """What the newest frame says: planted or not, and where it is set down."""
    heel = FOOT_JOINTS.index(name)
    stands = bool(touch[heel] and touch[heel + 1])
    here = np.array([*goal.pos[newest, :2], yaw_of_quat(_sole(ground, goal, name, newest))])
    off = _apart(here, foot.spot)
    slid = foot.planted and (np.hypot(*off[:2]) > SLIP * ground.size or abs(off[2]) > SPIN)
    stood, up = (1 if slid else foot.stood + 1, 0) if stands else (0, foot.up + 1)
    planted = not slid and (up <= ground.ahead if foot.planted else stood > ground.settling)
    spot = foot.spot
    if stands and not (planted and foot.planted):
        spot = here if stood == 1 else spot + off / stood
    return replace(foot, stood=stood, up=up, planted=planted, away=0 if planted else foot.away + 1, spot=spot)


def _beside(ground: Ground, before: dict[str, Foot], feet: dict[str, Foot]) -> dict[str, Foot]:
    """The `feet` with those that are being set down aside of those that stand; `before` it is the same of the frame
    before. Once a foot stands it stays.
    """
    out = dict(feet)
    for name, foot in feet.items():
        if before[name].planted or not foot.stood:
            continue
        aside = np.zeros(2)
        for other, its in out.items():
            if other != name and its.planted:
                there, treads = its.spot + np.array([*its.aside, 0.0]), ground.rest.treads
                aside = kept_apart(foot.spot, treads[name], there, treads[other], BESIDE * ground.size)
        out[name] = replace(foot, aside=aside)
    return out


def _set_down(
    ground: Ground, state: Footing, goals: dict[str, Goal], height: float, held: bool, newest: int
) -> tuple[Footing, float]:
    """How the goals of the feet are turned and moved in the frame that is decided now, and how far all of them rise."""
    now = newest - ground.ahead
    turned = {n: _turned(ground, f, goals[n], n, now, newest) for n, f in state.feet.items()}
    low = min(goals[n].pos[now, 2] + _lowest(ground, f, goals[n], n, now) for n, f in turned.items())
    lift, gap, landed = state.lift, state.gap, state.landed
    if held:
        landed += 1
        if landed == 0:
            gap = lift + low + height
        lift = gap * (1 - _eased(landed / ground.settling)) - low - height
    else:
        landed = -1
    rise = height + lift
    moved = {n: _moved(ground, f, goals[n], n, rise, now, newest) for n, f in turned.items()}
    return replace(state, feet=moved, lift=lift, gap=gap, landed=landed), rise


def _turned(ground: Ground, foot: Foot, goal: Goal, name: str, now: int, newest: int) -> Foot:
    if not foot.stood and not foot.planted:
        return replace(foot, turn=foot.turn * (1 - _released(ground, foot)))
    at, share = _when(ground, foot, now, newest)
    level = yaw_quat(foot.spot[2])
    wanted = quat_to_rotvec(quat_mul(level, quat_conj(_sole(ground, goal, name, at))))
    return replace(foot, turn=foot.turn + share * (wanted - foot.turn))


def _moved(ground: Ground, foot: Foot, goal: Goal, name: str, rise: float, now: int, newest: int) -> Foot:
    if not foot.stood and not foot.planted:
        return replace(foot, shift=foot.shift * (1 - _released(ground, foot)))
    at, share = _when(ground, foot, now, newest)
    x, y, z = goal.pos[at]
    floor = -_lowest(ground, foot, goal, name, at)
    wanted = np.array([*(foot.spot[:2] + foot.aside - [x, y]), floor - z - rise])
    return replace(foot, shift=foot.shift + share * (wanted - foot.shift))


def _when(ground: Ground, foot: Foot, now: int, newest: int) -> tuple[int, float]:
    """The frame that says how the goal is to be moved, and which share of what is missing is made good now."""
    if foot.planted:
        return now, 1.0
    left = ground.settling + 1 - foot.stood
    return max(newest - foot.stood + 1, now), _share(left, ground.settling)


def _released(ground: Ground, foot: Foot) -> float:
    count = max(round(LET_GO * ground.fps), 1)
    return _share(count + 1 - foot.away, count)


def _asked(
    ground: Ground, state: Footing, goals: dict[str, Goal], rise: float, now: int
) -> dict[str, tuple[Array, Array, float, bool]]:
    """Place, turn and firmness of the feet's goals in the frame `now`, and whether they are planted."""
    speed = {
        n: 0.0 if f.before is None else float(np.hypot(*(goals[n].pos[now, :2] - f.before))) * ground.fps
        for n, f in state.feet.items()
    }
    out = {}
    for name, foot in state.feet.items():
        quat = _level(ground, foot, goals[name], name, now)
        pos = goals[name].pos[now] + foot.shift + [0.0, 0.0, rise]
        left = max(ground.settling + 1 - foot.stood, 0) if foot.stood else foot.away
        swing = min(min(foot.away, left) / (FIRMING * ground.fps), 1.0)
        slowest = min((v for other, v in speed.items() if other != name), default=np.inf)
        passing = np.clip((speed[name] - slowest) / PASSING, 0.0, 1.0)
        clear = CLEARANCE * ground.size * swing * passing
        pos[2] += max(clear - pos[2] - _lowest(ground, foot, goals[name], name, now), 0.0)
        out[name] = (pos, quat, 1 - (1 - SWING) * swing, foot.planted)
    return out


def _sole(ground: Ground, goal: Goal, name: str, frame: int) -> Array:
    """How the sole is asked to be turned: the identity is flat, facing +x."""
    return quat_mul(goal.quat[frame], quat_conj(ground.rest.turn[name]))


def _level(ground: Ground, foot: Foot, goal: Goal, name: str, frame: int) -> Array:
    """(4,) the goal's turn after the foot's."""
    return quat_mul(rotvec_to_quat(foot.turn), goal.quat[frame])


def _lowest(ground: Ground, foot: Foot, goal: Goal, name: str, frame: int) -> float:
    """Metres of the lowest point of the sole over the goal's place (below 0)."""
    return float(quat_rotate(_level(ground, foot, goal, name, frame), ground.rest.soles[name])[:, 2].min())


def _raised(goal: Goal, rise: Array) -> Goal:
    return goal if goal.base else replace(goal, pos=goal.pos + rise[:, None] * [0.0, 0.0, 1.0])


def _apart(here: Array, spot: Array) -> Array:
    """(3,) from `spot` to `here`: x, y, and the yaw the short way."""
    off = here - spot
    off[2] = (off[2] + np.pi) % (2 * np.pi) - np.pi
    return off


def _eased(u: float) -> float:
    u = min(max(u, 0.0), 1.0)
    return u * u * (3 - 2 * u)


def _share(left: int, of: int) -> float:
    """What of the way to go now, to arrive smoothly with the last of the `left` frames out of `of`."""
    if left <= 1:
        return 1.0
    before, after = _eased(1 - left / of), _eased(1 - (left - 1) / of)
    return (after - before) / (1 - before)
