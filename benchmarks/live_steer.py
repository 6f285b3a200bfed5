"""How well the live generator goes where it is told: as it is, and where the network only hears the numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from motiongen.live import chunk as chunks
from motiongen.live.generator import LiveGenerator
from motiongen.live.steering import WRISTS, Steer

SETTLE_S, WATCH_S = 1.5, 3.0
HANDS = ((0.35, -0.25, 1.3), (0.25, -0.35, 1.5), (0.30, -0.10, 1.1))


def steered(weights: Path, seeds: int) -> dict[str, dict[str, float]]:
    """Mean error of heading in degrees, speed in m/s, place beside a path and a wrist in m; by way of steering."""
    out = {}
    for way in ("as it is", "heard alone", "not told"):
        live = LiveGenerator(weights)
        with _heard_alone() if way == "heard alone" else _as_it_is():
            out[way] = {name: round(value, 3) for name, value in _errors(live, seeds, told=way != "not told").items()}
    return out


def _errors(live: LiveGenerator, seeds: int, *, told: bool) -> dict[str, float]:
    heading, speed, beside, hand = [], [], [], []
    for seed in range(seeds):
        wanted = (-1.0, 1.0, 0.5)[seed % 3]
        _walk(live, seed, Steer(heading=wanted, speed=0.8) if told else Steer())
        heading.append(abs(math.degrees(math.remainder(live.state.heading - wanted, math.tau))))
        speed.append(abs(live.state.cruise - 0.8))
        path = tuple((0.5 * k, 0.4 * math.sin(0.5 * k)) for k in range(1, 20))
        roots = _walk(live, seed, Steer(path=path, speed=0.8) if told else Steer())
        line = np.array(path)
        beside.append(float(np.mean([np.linalg.norm(line - place[:2], axis=1).min() for place in roots])))
        hand.append(_reach(live, seed, HANDS[seed % 3], told))
    return {
        "heading_deg": float(np.mean(heading)),
        "speed_m_s": float(np.mean(speed)),
        "beside_path_m": float(np.mean(beside)),
        "wrist_m": float(np.mean(hand)),
    }


def _walk(live: LiveGenerator, seed: int, steer: Steer) -> np.ndarray:
    """Places of the pelvis while it walks, after a second and a half."""
    live.restart(seed)
    live.say("walk forward")
    live.steer(steer)
    return _motions(live)


def _motions(live: LiveGenerator) -> np.ndarray:
    roots = []
    while live.frame < (SETTLE_S + WATCH_S) * 30:
        roots.append(live.next_chunk().root_pos)
    return np.concatenate(roots)[round(SETTLE_S * 30) :]


def _reach(live: LiveGenerator, seed: int, place: tuple[float, float, float], told: bool) -> float:
    """Metres from where the right wrist is to be, on average once it should be there."""
    live.restart(seed)
    live.steer(Steer(right_hand=place) if told else Steer())
    off = []
    while live.frame < (SETTLE_S + WATCH_S) * 30:
        start = live.state
        motion = live.next_chunk()
        at = motion.positions()
        cos, sin = math.cos(start.heading), math.sin(start.heading)
        from_root = at[:, WRISTS[1], :2] - at[:, 0, :2]
        ahead = np.stack([from_root @ [cos, sin], from_root @ [-sin, cos], at[:, WRISTS[1], 2]], axis=1)
        off.append(np.linalg.norm(ahead - place, axis=1))
    return float(np.concatenate(off)[round(SETTLE_S * 30) :].mean())


@contextmanager
def _as_it_is() -> Iterator[None]:
    yield


@contextmanager
def _heard_alone() -> Iterator[None]:
    """The network hears the numbers, and what it makes of them stays."""
    overwritten, reached = chunks.overwritten, chunks.reached
    chunks.overwritten, chunks.reached = lambda made, _: made, lambda features, *_: features
    try:
        yield
    finally:
        chunks.overwritten, chunks.reached = overwritten, reached
