"""Where and when the feet of a motion stand: footholds that a rig can tread, one foot in the air at a time.

Human footholds are what the motion says, with four changes. The first and the last are the rig's own stance, since it
begins and ends at rest; a foot that hardly moves or lifts stays where it is; a step longer than the legs take is cut
short, and all that follow come back with it; and a motion that ends in mid-stride gets a step that closes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from motiongen.features import CONTACT_SPEED
from motiongen.rotation import Array, yaw_of_quat
from retarget.contacts import Flags, runs
from retarget.kinematics import ROOT_DOFS, Poses
from retarget.trajectory import Trajectory
from sim.mending.body import Body, Leg, sole_height, sole_turn
from sim.support import NEAR
from sim.thresholds import rig_size

# In heights of the root.
STAYS = 0.06  # a foot that moves less has not stepped …
LIFTS = 0.06  # … unless it was lifted higher
LONGEST = 0.62  # from one foot to the other, along either one's heading
NARROWEST, WIDEST = 0.9, 1.9  # from one foot to the other, across, over the nominal stance
TURNS = 0.2  # rad: a foot that turns less has not stepped
INWARD, OUTWARD = 0.2, 0.5  # rad, that a foot is turned from the other one at most
PIVOT = 0.3  # rad: a foot that turns more while it stands is lifted in between
# In beats, √(height / g): 0.31 s of an adult, 0.16 s of the puppet.
SWING = 2.4  # a foot is in the air no shorter
BOTH = 0.9  # both feet stand between two steps
REST = 2.5  # before the first step, to bring the weight over, and after the last one
UNHURRIED = 3.5  # beats, in which the slowest joint of a leg must be able to swing a foot over two steps
PEAK = 15 / 8  # of the speed of minimum jerk over its mean
EARLY = 0.25  # s: who stands this soon after the start has stood from the start
SHORT = 0.08  # s: no stance is shorter


@dataclass(frozen=True)
class Stance:
    """A foot stands on `spot` (2,), metres, turned by `yaw` rad, from frame `start` to frame `end` (exclusive)."""

    start: int
    end: int
    spot: Array
    yaw: float


@dataclass(frozen=True)
class Swing:
    """Leg number `leg` goes from stance `before` to stance `after`, in the air between the frames `start` and `end`."""

    leg: int
    before: Stance
    after: Stance
    start: int
    end: int


@dataclass(frozen=True)
class Steps:
    """Where each leg stands first, and the swings in the order in which they happen; the motion takes `frames`.

    `closing`: whether the motion does not have the swing that brings the feet together. `turning`: how many swings it
    does not have either, that turn it as far as it should. `shortened` (m): by how much steps were cut.
    """

    first: tuple[Stance, ...]
    swings: tuple[Swing, ...]
    frames: int
    closing: bool
    turning: int
    shortened: float


def find_steps(body: Body, trajectory: Trajectory, at: Poses, longest: float, stride: float = 1.0) -> Steps:
    """The steps of `trajectory`, whose poses are `at`, none longer than `stride` times what the legs take. Added are
    only such as fit into `longest` times its time.
    """
    frames = len(trajectory)
    flags = [
        trajectory.contacts[leg.name]
        if leg.name in trajectory.contacts
        else _low_and_slow(body, leg, at, trajectory.fps)
        for leg in body.legs
    ]
    told = [_stances(leg, at, f, round(SHORT * trajectory.fps)) for leg, f in zip(body.legs, flags, strict=True)]
    begins = min((s[0].start for s in told if s), default=0)
    ends = max((s[-1].end for s in told if s), default=frames)
    early = round(EARLY * trajectory.fps)
    stances = [_merged(body, leg, at, s, begins, begins + early) for leg, s in zip(body.legs, told, strict=True)]
    closing = _close(body, at, stances, ends, early, frames)
    before = sum(map(len, stances))
    lasts = max(trajectory.duration, (2 * REST + (before - len(stances)) * (SWING + BOTH)) * body.beat)
    more = int((longest * trajectory.duration - lasts) / ((SWING + BOTH) * body.beat))
    stances, shortened = _shortened(body, stances, more, stride * _longest(body))
    swings = sorted(
        (
            Swing(i, before, after, before.end, after.start)
            for i, mine in enumerate(stances)
            for before, after in pairwise(mine)
        ),
        key=lambda swing: swing.start + swing.end,
    )
    return Steps(
        tuple(mine[0] for mine in stances), tuple(swings), frames, closing, sum(map(len, stances)) - before, shortened
    )


def _low_and_slow(body: Body, leg: Leg, at: Poses, fps: float) -> Flags:
    """(T,) where a foot seems to stand, in a motion that does not say it."""
    size, place = rig_size(body.rig), at.place[:, leg.body]
    speed = np.linalg.norm(np.gradient(place, 1 / fps, axis=0), axis=1)
    return (sole_height(leg, at) < NEAR * size) & (speed < CONTACT_SPEED * size)


def _stances(leg: Leg, at: Poses, flags: Flags, shortest: int) -> list[Stance]:
    yaw = np.unwrap(yaw_of_quat(sole_turn(leg, at)))
    place = at.place[:, leg.body, :2]
    return [
        Stance(start, end, place[start:end].mean(0), float(yaw[start:end].mean()))
        for start, end in _without_pivots(runs(flags), yaw)
        if end - start >= shortest
    ]


def _without_pivots(stood: Iterable[tuple[int, int]], yaw: Array) -> Iterator[tuple[int, int]]:
    """The stretches of frames in which a foot stood, cut where it has turned by `PIVOT` rad."""
    for start, end in stood:
        for frame in range(start, end):
            if abs(yaw[frame] - yaw[start]) > PIVOT:
                yield start, frame
                start = frame
        yield start, end


def _merged(body: Body, leg: Leg, at: Poses, told: list[Stance], begins: int, early: int) -> list[Stance]:
    """The stances of one leg, the first of them where it is in frame 0."""
    height = sole_height(leg, at)
    out = [Stance(0, begins, at.place[0, leg.body, :2], float(yaw_of_quat(sole_turn(leg, at)[0])))]
    for stance in told:
        last = out[-1]
        gap = height[last.end : stance.start]
        lifted = gap.max(initial=0.0) > LIFTS * body.height
        moved = np.linalg.norm(stance.spot - last.spot) > STAYS * body.height or abs(stance.yaw - last.yaw) > TURNS
        if (len(out) == 1 and stance.start <= early) or not (lifted or moved):
            out[-1] = replace(last, end=stance.end)
        else:
            out.append(stance)
    return out


def _close(body: Body, at: Poses, stances: list[list[Stance]], ends: int, early: int, frames: int) -> bool:
    """Bring the feet together at the end as they are in the last frame; whether that takes another step."""
    leader = max(range(len(stances)), key=lambda i: (stances[i][-1].end > ends - early, stances[i][-1].start))
    lead = stances[leader][-1]
    stances[leader][-1] = replace(lead, end=frames)
    closing = False
    for i, leg in enumerate(body.legs):
        if i == leader:
            continue
        across = at.place[-1, leg.body, :2] - at.place[-1, body.legs[leader].body, :2]
        faces = [float(yaw_of_quat(sole_turn(x, at)[-1])) for x in (body.legs[leader], leg)]
        spot = lead.spot + turned(across, lead.yaw - faces[0])
        yaw = lead.yaw + float(np.angle(np.exp(1j * (faces[1] - faces[0]))))  # the short way round
        last = stances[i][-1]
        near = np.linalg.norm(spot - last.spot) <= STAYS * body.height and abs(yaw - last.yaw) <= TURNS
        if near:
            stances[i][-1] = replace(last, end=frames)
        else:
            landing = max(ends, last.end + 1)
            stances[i].append(Stance(landing, max(frames, landing + 1), spot, yaw))
            closing = True
    return closing


def _shortened(body: Body, stances: list[list[Stance]], more: int, longest: float) -> tuple[list[list[Stance]], float]:
    """No step longer than `longest` (m) or wider, narrower or turned more than legs take, and by how many metres the
    longest was cut.

    Steps that cannot turn as far as they should are followed by `more` of them at most, on the spot, until the feet
    face where they should in the end.
    """
    out = [[mine[0]] for mine in stances]
    if len(stances) != 2:
        return stances, 0.0
    shift, cut = np.zeros(2), 0.0
    landings = sorted(((s.start, i, s) for i, mine in enumerate(stances) for s in mine[1:]), key=lambda x: x[:2])
    for _, i, stance in landings:
        held, back = _held(body, stances, i, replace(stance, spot=stance.spot + shift), out[1 - i][-1], longest)
        shift, cut = shift + back, max(cut, float(np.linalg.norm(back)))
        out[i].append(held)
    if not landings:
        return out, cut
    foot = 1 - landings[-1][1]
    for _ in range(more):
        last, other = out[foot][-1], out[1 - foot][-1]
        if max(abs(mine[-1].yaw - now[-1].yaw) for mine, now in zip(stances, out, strict=True)) < TURNS:
            break
        now = max(last.end, other.end)
        out[foot][-1] = replace(last, end=now)
        aside = turned(np.array([0.0, _side(stances, foot) * _across(stances)]), other.yaw)
        wanted = Stance(now + 1, now + 2, other.spot + aside, stances[foot][-1].yaw)
        out[foot].append(_held(body, stances, foot, wanted, other, longest)[0])
        out[1 - foot][-1] = replace(other, end=now + 2)
        foot = 1 - foot
    return out, cut


def _held(
    body: Body, stances: list[list[Stance]], foot: int, asked: Stance, other: Stance, longest: float
) -> tuple[Stance, Array]:
    """`asked` as near to it as leg number `foot` gets while the other one stands on `other`; and by what it fell short
    along the heading of that, (2,) metres.
    """
    side, across = _side(stances, foot), _across(stances)
    out_turn = float(np.clip(side * (asked.yaw - other.yaw), -INWARD, OUTWARD))
    room = abs(np.sin(out_turn)) * float(np.ptp(body.legs[foot].sole[:, 0])) / 2  # that a turned sole takes more
    way = turned(asked.spot - other.spot, -other.yaw)
    held = np.array(
        [
            np.clip(way[0], -longest, longest),
            side * np.clip(side * way[1], NARROWEST * across + room, WIDEST * across),
        ]
    )
    spot = other.spot + turned(held, other.yaw)
    return replace(asked, spot=spot, yaw=other.yaw + side * out_turn), turned(
        np.array([held[0] - way[0], 0.0]), other.yaw
    )


def _across(stances: list[list[Stance]]) -> float:
    """Metres from one foot to the other in the first stance."""
    return float(np.linalg.norm(stances[0][0].spot - stances[1][0].spot))


def _side(stances: list[list[Stance]], foot: int) -> float:
    """1 for the left foot, -1 for the right one."""
    first = stances[foot][0]
    return float(np.sign(turned(first.spot - stances[1 - foot][0].spot, -stances[1 - foot][0].yaw)[1]))


def _longest(body: Body) -> float:
    """Metres of the longest step that the legs reach, and that their servos are fast enough for."""
    slowest = min(body.rig.joints[dof - ROOT_DOFS].velocity for leg in body.legs for dof in leg.dofs)
    swung = slowest * min(leg.length for leg in body.legs) * UNHURRIED * body.beat / PEAK
    return min(LONGEST * body.height, swung / 2)


def turned(way: Array, yaw: float) -> Array:
    """(2,) turned about z by `yaw` rad."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * way[0] - s * way[1], s * way[0] + c * way[1]])
