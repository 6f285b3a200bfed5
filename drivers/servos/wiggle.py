"""The sign test: each joint of a rig in turn moves a little, with little torque, and somebody says which way it went.

The servos say that the right joint moved, and as far as it was told; that "forwards" is what the rig's model calls so
nobody but a person can see.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from drivers.bus import Array, BusError, ServoBus
from drivers.clock import Ticker
from retarget.rig import Rig

NS = 1_000_000_000
TURN = 0.15  # rad
SPEED = 0.3  # rad/s
LEAST = 0.5  # of the turn, that is measured; the rest is what a weak torque and backlash leave
STRAY = 0.05  # rad that any other joint may move meanwhile
CYCLE_S = 0.02
SETTLE_S = 0.3

Answer = Callable[[], bool | None]  # None until somebody has said it
Ask = Callable[[str, int], Answer]


def wiggle(rig: Rig, bus: ServoBus, joints: Sequence[str], ask: Ask, clock: Ticker) -> tuple[str, ...]:
    """Move each of `joints` on the open `bus` to and fro; those of which `ask` says that they went the wrong way.

    `ask` gets the joint and which way it went by the rig's signs, +1 or -1 where its limit is near; what it gives back
    is asked until it answers, the joint being held meanwhile. The torque comes on for all joints and goes off in the
    end. Raises BusError where a joint does not move, moves the wrong way by its own
    measure, or another one moves with it, and ValueError for a joint without a servo.
    """
    for joint in joints:
        if joint not in bus.joints:
            raise ValueError(f"no joint {joint!r} with a servo in rig {rig.name!r}; it has {', '.join(bus.joints)}")
    limits = {j.name: (j.lower, j.upper) for j in rig.joints}
    wrong = []
    bus.torque(True)
    try:
        rest = bus.read().position
        for joint in joints:
            n = bus.joints.index(joint)
            way = 1 if rest[n] + TURN <= limits[joint][1] else -1
            goal = rest.copy()
            goal[n] += way * TURN
            there = _go(bus, rest, goal, clock)
            _check(bus.joints, n, there - rest, way)
            right = _hold(bus, goal, ask(joint, way), clock)
            _go(bus, goal, rest, clock)
            if not right:
                wrong.append(joint)
    finally:
        bus.torque(False)
    return tuple(wrong)


def _go(bus: ServoBus, start: Array, goal: Array, clock: Ticker) -> Array:
    """Command from `start` to `goal` at SPEED, and wait; where the joints are then, rad."""
    moving = float(np.abs(goal - start).max()) / SPEED
    began = clock.now_ns()
    for k in range(round((moving + SETTLE_S) / CYCLE_S)):
        share = min(1.0, k * CYCLE_S / moving) if moving else 1.0
        bus.write(start + share * (goal - start))
        clock.sleep_until_ns(began + round((k + 1) * CYCLE_S * NS))
        position = bus.read().position
    return position


def _hold(bus: ServoBus, goal: Array, answer: Answer, clock: Ticker) -> bool:
    """Stay at `goal` until there is an answer: a bus that falls silent is let go by its guard."""
    cycle = round(CYCLE_S * NS)
    while (said := answer()) is None:
        bus.write(goal)
        clock.sleep_until_ns(clock.now_ns() + cycle)
        bus.read()
    return said


def _check(joints: Sequence[str], n: int, moved: Array, way: int) -> None:
    if moved[n] * way < LEAST * TURN:
        raise BusError(f"{joints[n]} was told to turn by {way * TURN:+.2f} rad and turned by {moved[n]:+.3f}")
    others = np.abs(np.delete(moved, n))
    if len(others) and others.max() > STRAY:
        stray = [j for k, j in enumerate(joints) if k != n][int(others.argmax())]
        raise BusError(
            f"{stray} moved by {others.max():.3f} rad while {joints[n]} was told to: is something in the way?"
        )
