"""Exactness: an analytic periodic motion through an auto-encoder fitted to it; repetition; blending."""

from __future__ import annotations

import numpy as np
import torch
from lines import Line
from parts import Part
from phase_options import Options

from motiongen.diffusion.configs import PhaseAutoencoderConfig
from motiongen.phase.autoencoder import PhaseAutoencoder, margin
from motiongen.phase.phases import Course, Layout, Timing, course, readings
from motiongen.phase.phrases import Phrase, blended, lasting, phrase_signals

SIZES = PhaseAutoencoderConfig(features=6, highest=6, phases=32, narrow=8, hidden=16, width=12)
PERIOD, MOTIONS, ROUNDS = 60, 8, 12


def exact(options: Options) -> Part:
    """Largest errors. Of the motions, which have deviation 1: in the period that was fitted, and in the next four."""
    within, beyond = _analytic()
    turns = _turns()
    a, b = np.random.default_rng(0).normal(size=(2, 50, 7)).astype(np.float32)
    ends = max(np.abs(blended(a, b, w) - y).max() for w, y in ((0, a), (1, b)))
    lines = (
        Line("exact", "analytic periodic motion, the period that was fitted", within, 1e-3, False),
        Line("exact", "the same, the next four periods", beyond, 1e-3, False),
        Line("exact", "repetition: difference of one period from the next", turns, 0.0, False),
        Line("exact", "blending at weights 0 and 1: difference from either", float(ends), 0.0, False),
    )
    return Part((("what", "largest error"), *((line.name, f"{line.found:.2g}") for line in lines)), lines)


def _analytic() -> tuple[float, float]:
    """Fits all weights of an auto-encoder, by L-BFGS, to sums of sines of its frequencies."""
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    model, layout = PhaseAutoencoder(SIZES).double().eval(), Layout(SIZES.highest, SIZES.phases)
    shape = (MOTIONS, 1, SIZES.features, len(layout.frequencies))
    amplitude, shift = rng.normal(size=shape) / np.sqrt(len(layout.frequencies) / 2), rng.uniform(size=shape)

    def motion(frame: np.ndarray) -> torch.Tensor:
        angle = 2 * np.pi * (frame[:, None, None] / PERIOD * np.array(layout.frequencies) - shift)
        return torch.from_numpy((amplitude * np.sin(angle)).sum(-1))

    when = Timing(*(np.full(MOTIONS, n) for n in (0, PERIOD, 0)))
    x, none = motion(np.arange(PERIOD + 1)), torch.zeros(MOTIONS, 2).double()
    read = torch.from_numpy(readings(when, PERIOD + 1, SIZES.highest)).double()
    once, later = _course(when, 0, PERIOD + 1), _course(when, PERIOD, 5 * PERIOD)
    optimizer = torch.optim.LBFGS(
        model.parameters(), max_iter=60, tolerance_grad=0, tolerance_change=0, line_search_fn="strong_wolfe"
    )

    def error() -> torch.Tensor:
        optimizer.zero_grad()
        off = (model(x, read, none, once)[0] - x).square().mean()
        off.backward()
        return off

    for _ in range(ROUNDS):
        optimizer.step(error)
    with torch.no_grad():
        code = model.encoder(x, read, none)
        within = (model.decode(code, once) - x).abs().max()
        beyond = (model.decode(code, later) - motion(np.arange(PERIOD, 5 * PERIOD))).abs().max()
    return float(within), float(beyond)


def _course(when: Timing, start: int, stop: int) -> Course:
    edge = margin(SIZES.kernel)
    at = course(when, np.arange(start - edge, stop + edge))
    return Course(*(torch.from_numpy(y).double() for y in (at.k, at.head, at.tail)))


def _turns() -> float:
    layout = Layout()
    code = np.random.default_rng(1).normal(size=layout.width).astype(np.float32)
    long = lasting(Phrase(code, 10, 47, 12, 47), 10 + 5 * 47 + 12 + 1)
    made = phrase_signals(long, layout, np.arange(long.frames))[10 : 10 + 5 * 47].reshape(5, 47, -1)
    return float(np.abs(made - made[0]).max())
