"""What each joint of a built rig really does: its top speed, its delay and its friction, found by moving it.

A step of the goal shows how long the servo takes to begin and how fast it gets. A slow way there and back shows the
friction: a proportional servo lags by what it needs to turn, more on the way against it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from drivers.bus import Array, BusError, ServoBus
from drivers.clock import Ticker
from drivers.measured import Measured
from drivers.servos.table import model_of
from retarget.rig import Rig

NS = 1_000_000_000
STEP = 0.6  # rad
STEP_S = 0.5
SLOW = 0.2  # rad/s: a cycle of it is little beside the error that friction takes
SWEEP = 0.15  # rad to either side
BEGUN = 0.01  # rad: it has moved
WINDOW_S = 0.04
CYCLE_S = 0.02
LEAST_SHARE = 0.2  # of the published speed: less is no measurement but a joint that is stuck


def unlimited(rig: Rig) -> Rig:
    """`rig` whose servos may go as fast as they can, for the measurement."""
    return replace(rig, joints=tuple(replace(j, velocity=1.5 * j.no_load_speed) for j in rig.joints))


def identify(rig: Rig, bus: ServoBus, joints: Sequence[str], clock: Ticker) -> dict[str, Measured]:
    """Measure `joints` one after the other on the open `bus`, all others held; the torque goes off in the end.

    `bus` is that of `unlimited(rig)`. Raises BusError where the bus fails, or a joint moves too little to measure.
    """
    limits = {j.name: (j.lower, j.upper) for j in rig.joints}
    servos = {s.joint: s for s in rig.servos}
    if unknown := [j for j in joints if j not in servos]:
        raise ValueError(f"no joint {unknown[0]!r} with a servo in rig {rig.name!r}; it has {', '.join(servos)}")
    bus.torque(True)
    try:
        rest = bus.read().position
        found = {}
        for joint in joints:
            n, made = bus.joints.index(joint), servos[joint].model
            model = model_of(made.name)
            if model is None:
                raise BusError(f"{joint}: a hobby servo cannot be felt, so nothing of it can be measured")
            low, high = limits[joint]
            way = 1.0 if high - rest[n] > rest[n] - low else -1.0
            reach = min(STEP, abs((high if way > 0 else low) - rest[n]) - BEGUN)
            delay, speed = _step(bus, rest, n, way * reach, clock)
            if speed < LEAST_SHARE * made.no_load_speed:
                raise BusError(f"{joint}: got up to {speed:.2f} rad/s only, of {made.no_load_speed:.2f} that it has")
            middle = rest.copy()
            middle[n] += way * min(reach / 2, SWEEP)
            lag = _sweep(bus, middle, n, min(reach / 2, SWEEP), clock)
            friction = made.stall_torque * max(0.0, lag / model.full_error - SLOW / speed)
            found[joint] = Measured(speed, delay, friction)
            _follow(bus, middle, rest, clock)
        return found
    finally:
        bus.torque(False)


def _step(bus: ServoBus, rest: Array, n: int, turn: float, clock: Ticker) -> tuple[float, float]:
    """Delay in s and top speed in rad/s of joint `n` for a goal that is `turn` rad away; it stays there."""
    goal = rest.copy()
    goal[n] += turn
    began = clock.now_ns()
    times: list[float] = []
    moved: list[float] = []
    while not times or times[-1] < STEP_S:
        bus.write(goal)
        clock.sleep_until_ns(began + round((len(times) + 1) * CYCLE_S * NS))
        times.append((clock.now_ns() - began) / NS)
        moved.append(abs(bus.read().position[n] - rest[n]))
    t, way = np.array(times), np.array(moved)
    if not (way > BEGUN).any():
        raise BusError(f"{bus.joints[n]}: did not move by {BEGUN} rad when it was told to by {turn:+.2f}")
    late = np.searchsorted(t, t + WINDOW_S)
    pairs = [(i, j) for i, j in enumerate(late) if j < len(t)]
    speed = max((way[j] - way[i]) / (t[j] - t[i]) for i, j in pairs)
    first = int(np.argmax(way > BEGUN))
    return max(0.0, float(t[first] - way[first] / speed)), float(speed)


def _sweep(bus: ServoBus, middle: Array, n: int, reach: float, clock: Ticker) -> float:
    """Mean lag in rad of joint `n` behind its goal, on a slow way up and down about `middle`: gravity cancels out."""
    start, low, high = bus.read().position, middle.copy(), middle.copy()
    low[n] -= reach
    high[n] += reach
    _follow(bus, start, low, clock)
    up = _follow(bus, low, high, clock)
    down = _follow(bus, high, low, clock)
    _follow(bus, low, middle, clock)
    inner = [rows[len(rows) // 4 : -len(rows) // 4, n] for rows in (up, down)]
    return float(inner[0].mean() - inner[1].mean()) / 2


def _follow(bus: ServoBus, start: Array, goal: Array, clock: Ticker) -> Array:
    """Go from `start` to `goal` slowly; the lag (k, n) rad of each cycle, goal less measured."""
    cycles = max(1, math.ceil(float(np.abs(goal - start).max()) / SLOW / CYCLE_S))
    began, lags = clock.now_ns(), []
    for k in range(cycles):
        told = start + (k + 1) / cycles * (goal - start)
        bus.write(told)
        clock.sleep_until_ns(began + round((k + 1) * CYCLE_S * NS))
        lags.append(told - bus.read().position)
    return np.array(lags)
