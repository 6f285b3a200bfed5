"""The gate of a motion that is still being made: stretch by stretch, each from where physics has the rig by then, and
each together with a way to rest from its end. What has passed can be played: it can always be stopped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retarget.rig import Mount, Rig
from retarget.timeline import PEAK, SHORTEST_EASE
from retarget.trajectory import Trajectory
from sim.checks import CHECKS
from sim.drives import servo_heat
from sim.electric import ROOM, heat, temperature
from sim.evidence import Evidence, not_here, verdict
from sim.geometry import Geometry, measure
from sim.report import Check
from sim.scene import build_scene
from sim.simulate import run_on, settled

Array = NDArray[np.float64]
Pairs = frozenset[tuple[str, str]]
SEEN = 3  # frames before a stretch that are run with it, so that its first ones have speeds and jerks too
HELD = 0.2  # s at rest at the end of a way
BRAKE = 0.3  # s in which a way takes off the speed there is
CALM = 0.9  # of a joint's speed that a way uses
LONGEST = 5.0  # s of a way; the gate refuses what is still too fast then


@dataclass(frozen=True)
class Moment:
    """Where things are once the servos have done `asked` (SEEN, 7 + nj), the last frames that they were sent.

    `physics`: MuJoCo's state before those. `warm` (servos,): °C. `near`: parts that have been less than a finger apart
    all the time.
    """

    physics: Array
    asked: Array
    warm: Array
    near: Pairs


@dataclass(frozen=True)
class Verdict:
    """Whether a stretch may be played, and why not; the `moments` in it that were asked for and at its end (`after`);
    `way` (m, 7 + nj): to rest from there; `rested`: the moment at the way's end."""

    ok: bool
    failures: tuple[Check, ...]
    moments: tuple[Moment, ...]
    after: Moment
    way: Array
    rested: Moment


class Gate:
    """Judges what `rig` on a stand is to do next, at `fps` frames a second.

    Raises ValueError for another mount: what else carries the rig would have to be led back to rest too.
    """

    def __init__(self, rig: Rig, rest: Array, fps: float, mount: Mount | None = None) -> None:
        """`rest` (7 + nj,): the pose in which the rig begins and to which every way leads."""
        held = rig.mount if mount is None else mount
        if held != "stand":
            raise ValueError(f"live motion is for rigs on a stand, not {held}; --mount stand")
        self._rig, self._rest, self._fps = rig, rest, fps
        self._scene = build_scene(rig, held, rest)
        self._speed = np.array([j.velocity for j in rig.joints])
        self._reach = np.array([[j.lower for j in rig.joints], [j.upper for j in rig.joints]])

    def begin(self) -> Moment:
        """At rest, with the servos settled and as warm as the room."""
        near = frozenset(measure(self._scene, self._rest[None]).gaps)
        cool = np.full(len(self._rig.servos), ROOM)
        return Moment(settled(self._scene, self._rest), np.tile(self._rest, (SEEN, 1)), cool, near)

    def judge(self, moment: Moment, qpos: Array, marks: Sequence[int] = ()) -> Verdict:
        """What physics says of `qpos` (n, 7 + nj) after `moment`, n above 0, and of going to rest from there; with the
        moments after the first 1 to n frames that `marks` counts.

        The checks are those of a whole trajectory, but that servos are as warm as all that was done before has left
        them, and a gap that was ever open can close on a finger.
        """
        rig, count = self._rig, len(qpos)
        way = way_to_rest(np.concatenate([moment.asked, qpos])[-2:], self._rest, self._speed, self._reach, self._fps)
        rows = np.concatenate([moment.asked, qpos, way])
        trajectory = Trajectory(rows, self._fps, rig.name, rig.joint_names())
        rollout, states = run_on(self._scene, trajectory, moment.physics)
        asked, done = measure(self._scene, rows), _opened(measure(self._scene, rollout.qpos), moment.near)
        evidence = Evidence(trajectory, self._scene, rollout, asked, done, None)
        watts = heat(rig, rollout)[SEEN:]
        *moments, after = (
            Moment(
                states[mark - 1],
                rows[mark : mark + SEEN],
                self._warmed(moment.warm, watts[:mark]),
                _still_near(done, moment.near, SEEN + mark),
            )
            for mark in (*marks, count)
        )
        rested = Moment(
            states[-1 - SEEN], rows[-SEEN:], self._warmed(after.warm, watts[count:]), _still_near(done, after.near)
        )
        checks = [check(evidence) for check in CHECKS if check is not servo_heat]
        checks.append(_heat(evidence, np.maximum(after.warm, rested.warm)))
        failures = tuple(c for c in checks if not c.ok)
        return Verdict(not failures, failures, tuple(moments), after, way, rested)

    def _warmed(self, warm: Array, watts: Array) -> Array:
        """°C of the servos that were `warm` once they have turned `watts` (T, servos) into heat."""
        seconds = len(watts) / self._fps
        servos = zip(self._rig.servos, watts.mean(0), warm, strict=True)
        return np.array([temperature(servo.model, mean, seconds, begun) for servo, mean, begun in servos])


def _opened(done: Geometry, near: Pairs) -> Geometry:
    """`done`, whose first frame was judged before, with all gaps open in it but the `near` ones."""
    gaps = {pair: gap if pair in near else np.append(np.inf, gap[1:]) for pair, gap in done.gaps.items()}
    return replace(done, gaps=gaps)


def _still_near(done: Geometry, near: Pairs, frames: int | None = None) -> Pairs:
    """Those of the `near` parts that are so in the first `frames` too; by default in all."""
    return frozenset(p for p in near if p in done.gaps and np.isfinite(done.gaps[p][:frames]).all())


def _heat(e: Evidence, warm: Array) -> Check:
    """The warmest servo as a share of the rise that it is allowed; see `sim.drives.servo_heat`."""
    if not e.rig.servos:
        return not_here(e, "servo_heat", "with a rig that names no servos")
    share = (warm - ROOM) / (np.array([s.max_temperature for s in e.rig.servos]) - ROOM)
    worst = int(np.argmax(share))
    found = f"The servo of {e.rig.servos[worst].joint} gets {warm[worst]:.0f} °C warm"
    return verdict(e, "servo_heat", share[worst], None, found, "let it rest for some minutes, or unload the limb")


def way_to_rest(asked: Array, rest: Array, speed: Array, reach: Array, fps: float) -> Array:
    """(m, 7 + nj) from the last two frames `asked` (2, 7 + nj) to `rest` and held there.

    The speed there is dies away within BRAKE s, and what is off by a minimum jerk that takes as long as keeps joints
    below `speed` (nj,) rad/s, or below what they had; each within `reach` (2, nj).
    """
    start, rate = asked[1, 7:], np.diff(asked[:, 7:], axis=0)[0] * fps
    off = start - rest[7:]
    most = np.maximum(CALM * speed, np.abs(rate)) / fps
    count = round(max(SHORTEST_EASE, PEAK * float(np.max(np.abs(off) / (CALM * speed), initial=0.0))) * fps)
    while True:
        frames = np.arange(1, count + 1 + round(HELD * fps))[:, None]
        u, v = np.minimum(frames / count, 1.0), np.minimum(frames / (BRAKE * fps), 1.0)
        joints = rest[7:] + off * (1 - u**3 * (10 - 15 * u + 6 * u**2))
        joints = np.clip(joints + rate * BRAKE * (v - v**3 * (6 - 8 * v + 3 * v**2)), *reach)
        fastest = np.abs(np.diff(joints, axis=0, prepend=start[None])).max(0)
        if (fastest <= most).all() or count > LONGEST * fps:
            return np.concatenate([np.tile(rest[:7], (len(joints), 1)), joints], axis=1)
        count = round(1.2 * count)
