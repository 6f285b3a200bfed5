"""What each joint of a built rig really does: its top speed, delay, friction and backlash, found by moving it.

A step of the goal shows how long the servo takes to begin and how fast it gets. A slow way there and back shows the
friction: a proportional servo lags by what it needs to turn, more on the way against it. Where a creeping goal turns
back, the motor crosses the play of the gears before the joint begins to move: the encoder, on the shaft, does not see
it, but the error that drives the motor meanwhile tells how far it turned.
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
CREEP, CREEP_WAY = 0.03, 0.05  # rad/s, and rad to either side: slow, so that the rotor's inertia does not count
FOLLOWS = 0.01  # rad: after a turn back the joint goes along again
REVERSALS = 4
SMOOTH = 5  # cycles
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
            # Both ways torque = stall · (duty − speed / no-load speed) = friction: at top speed the duty is 1.
            friction = max(0.0, (lag / model.full_error - SLOW / speed) / (1 - SLOW / speed))
            backlash = _backlash(bus, middle, n, min(reach / 2, CREEP_WAY), speed / model.full_error, clock)
            found[joint] = Measured(speed / (1 - friction), delay, friction * made.stall_torque, backlash)
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
        moved.append(abs(bus.read().position[n] - rest[n]))
        times.append((clock.now_ns() - began) / NS)
        clock.sleep_until_ns(began + round(len(times) * CYCLE_S * NS))
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


def _backlash(bus: ServoBus, middle: Array, n: int, reach: float, gain: float, clock: Ticker) -> float:
    """Play in rad of the gears of joint `n`, the mean of REVERSALS `reach` rad to either side of `middle`.

    `gain`: rad/s of the motor for a rad of error. There is play to be felt only where something holds the joint, as
    its bearings do, but not gravity, which keeps the gears to one side.
    """
    ends = [middle.copy(), middle.copy()]
    for end, side in zip(ends, (-1, 1), strict=True):
        end[n] += side * reach
    _follow(bus, middle, ends[0], clock)
    _follow(bus, ends[0], ends[1], clock, CREEP)
    plays = []
    for k in range(REVERSALS):
        start, goal = ends[(k + 1) % 2], ends[k % 2]
        lags = _follow(bus, start, goal, clock, CREEP)[:, n]
        plays.append(_crossed(lags * math.copysign(1.0, goal[n] - start[n]), gain, bus.joints[n]))
    _follow(bus, ends[(REVERSALS + 1) % 2], middle, clock)
    return max(0.0, float(np.mean(plays)))


def _crossed(lag: Array, gain: float, joint: str) -> float:
    """How much farther than the joint the motor turned after a reversal, rad; `lag` (k,) rad behind a goal at CREEP.

    The motor turns by `gain` · lag, less what friction and load take of it; while it keeps up, at CREEP.
    """
    moved = CREEP * CYCLE_S * np.arange(len(lag)) - (lag - lag[0])
    if not (moved > FOLLOWS).any():
        raise BusError(
            f"{joint}: does not follow a goal that turns back and creeps: too much friction, or too near its limit"
        )
    follows = int(np.argmax(moved > FOLLOWS))
    kept_up = lag[-len(lag) // 3 :].mean()
    even = np.convolve(np.pad(lag, SMOOTH // 2, mode="edge"), np.ones(SMOOTH) / SMOOTH, mode="valid")  # of its ticks
    rate = np.maximum(0.0, CREEP + gain * (even[: follows + 1] - kept_up))
    return float(np.trapezoid(rate, dx=CYCLE_S) - moved[follows])


def _follow(bus: ServoBus, start: Array, goal: Array, clock: Ticker, speed: float = SLOW) -> Array:
    """Go from `start` to `goal` at `speed` rad/s; the lag (k, n) rad of each cycle, goal less measured.

    A goal that goes in steps is, over a cycle, where it would have been half a cycle ago had it gone evenly.
    """
    cycles = max(1, math.ceil(float(np.abs(goal - start).max()) / speed / CYCLE_S))
    began, lags, step = clock.now_ns(), [], (goal - start) / cycles
    for k in range(cycles):
        bus.write(start + (k + 1) * step)
        lags.append(start + (k + 0.5) * step - bus.read().position)
        clock.sleep_until_ns(began + round((k + 1) * CYCLE_S * NS))
    return np.array(lags)
