"""A count that a text asks for is made right in what was drawn: cycles of the movement are repeated, or left out.

The drawn movement is measured. Where it is done too seldom or too often, its frames are put together anew, cut where
two of them go on alike, as motion graphs are (Kovar et al. 2002), and what is left of a step there is blended.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from motiongen.features import FPS
from motiongen.measure.clip import SIDES, Event, Seen
from motiongen.nn import Floats
from motiongen.text.claims import Claim

MOST = 20  # times: more of anything than this is not put together
SHORTEST_S = 0.2  # of a cycle: a quick clap takes twice as long
HALF = 0.45  # share of an event's seconds, before its middle and after, that is not cut into
AT_LEAST_S = 0.2  # the same in seconds: nothing tells how long a jump or a raised hand takes
SPEED = 3.0  # how much more than the pose the change from frame to frame counts where frames are to go on alike
BLEND_S = 0.2  # before and after a cut


def repeated(x: Floats, claim: Claim, seen: Seen) -> Floats:
    """Features `x` (T, F), of whose motion `seen` is what was measured, with as many cycles as `claim` counts.

    As they are where nothing is counted, where it is done as often already, or not at all, or more than MOST times, or
    where no cycle can be cut out.
    """
    if claim.count is None or claim.count > MOST:
        return x
    order = _order(x, claim, claim.count, seen)
    return x if order is None else _blended(x, order)


def _order(x: Floats, claim: Claim, count: int, seen: Seen) -> NDArray[np.int_] | None:
    """The frames of `x` in an order that does `claim` `count` times."""
    wanted = 2 * count - 1 if claim.action == "shake" else count  # shakes are measured by the swing
    counted = _counted(claim, seen)
    missing = {wanted - len(events) for events in counted}
    if missing == {0} or len(missing) > 1 or not all(counted):
        return None
    (more,) = missing
    cost = _joining(x)
    for events in counted:
        cut = np.zeros(len(x), bool)
        for event in events:
            half = max(HALF * event.seconds, AT_LEAST_S if event.seconds == 0 else 0.0)
            cut[max(0, round((event.at_s - half) * FPS)) : round((event.at_s + half) * FPS) + 1] = True
        cost[cut] = cost[:, cut] = np.inf
    inside = [_between(events, len(x)) for events in counted]
    cycles = [-more] if more < 0 else [n for n in range(1, more + 1) if more % n == 0]
    fits = np.any([np.all([each == n for each in inside], axis=0) for n in cycles], axis=0)
    cost[~fits] = np.inf
    first, last = divmod(int(np.argmin(cost)), len(x))
    if not np.isfinite(cost[first, last]):
        return None
    if more < 0:
        return np.r_[:first, last : len(x)]
    times = more // int(inside[0][first, last])
    return np.r_[:last, np.tile(np.arange(first, last), times), last : len(x)]


def _counted(claim: Claim, seen: Seen) -> list[list[Event]]:
    """The events of `claim`, of each side that is counted by itself."""
    events = [event for event in seen.events if event.action == claim.action]
    by_side = {side: [event for event in events if event.side == side] for side in SIDES}
    if claim.side == "both":
        return list(by_side.values())
    if claim.side in SIDES and any(event.side for event in events):
        return [by_side[claim.side]]
    return [max(by_side.values(), key=len)] if claim.action in ("wave", "raise") else [events]


def _between(events: list[Event], count: int) -> NDArray[np.int_]:
    """How many of `events` are in the frames from the first (row) up to, but without, the last (column)."""
    before = np.searchsorted([event.at_s * FPS for event in events], np.arange(count) - 0.5)
    return before[None, :] - before[:, None]


def _joining(x: Floats) -> NDArray[np.float64]:
    """How unlike the frame `last` (column) is to `first` (row), for all pairs; inf where they are too near."""
    frames = np.concatenate([x, np.gradient(x.astype(float), axis=0) * SPEED], axis=1)
    square = (frames**2).sum(1)
    cost = np.maximum(square[:, None] + square[None, :] - 2 * frames @ frames.T, 0.0)
    at = np.arange(len(x))
    cost[at[None, :] - at[:, None] < SHORTEST_S * FPS] = np.inf
    return cost


def _blended(x: Floats, order: NDArray[np.int_]) -> Floats:
    """The frames `order` of `x`; at every cut each side gives half of the step, which dies away from there."""
    out = x[order]
    reach = round(BLEND_S * FPS)
    fade = (1 + np.cos(np.pi * (np.arange(reach) + 0.5) / reach)) / 4  # from a half to nothing
    for cut in (i for i in range(1, len(order)) if order[i] != order[i - 1] + 1):
        step = x[order[cut - 1] + 1] - x[order[cut]]  # what would have followed, and what does
        before, after = min(reach, cut), min(reach, len(out) - cut)
        out[cut : cut + after] += fade[:after, None] * step
        out[cut - before : cut] -= fade[:before][::-1, None] * step
    return out
