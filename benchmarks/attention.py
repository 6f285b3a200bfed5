"""Efficient attention (MotionDiffuse, Eq. 8): is it what the equation says, and does its cost grow as the frames do?

Both kinds run in turn in one process, as `rigcast say` runs them, so that a busy machine slows both.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from math import exp

import numpy as np
from lines import Line
from numpy.typing import NDArray
from parts import Options, Part

from motiongen.diffusion.motiondiffuse_run import efficient_attention
from motiongen.nn import attention as quadratic_attention

Array = NDArray[np.floating]

FRAMES = (196, 392, 784, 1568)  # the first is the longest clip of HumanML3D
WIDTH, HEADS = 512, 8  # the paper's
REPEATS, QUICK_REPEATS = 15, 5
KINDS: dict[str, Callable[..., Array]] = {"efficient": efficient_attention, "quadratic": quadratic_attention}


def attention(options: Options) -> Part:
    """Time and memory by frames, each kind against itself at the fewest and the two against each other."""
    rows = [("frames", "efficient", "grew", "quadratic", "grew", "quadratic / efficient", "the same of memory")]
    costs = [cost(frames, QUICK_REPEATS if options.quick else REPEATS) for frames in FRAMES]
    for frames, found in zip(FRAMES, costs, strict=True):
        (fast, small), (slow, large) = found["efficient"], found["quadratic"]
        cells = (f"{y * 1e3:.2f} ms, {m / 2**20:.1f} MiB" for y, m in ((fast, small), (slow, large)))
        grew = (f"{found[kind][0] / costs[0][kind][0]:.1f} times" for kind in KINDS)
        (a, b), (x, y) = cells, grew
        rows.append((str(frames), a, x, b, y, f"{slow / fast:.1f} times", f"{large / small:.1f} times"))
    longer = FRAMES[-1] / FRAMES[0]
    by_time, by_memory = ((costs[-1]["efficient"][i] / costs[0]["efficient"][i]) / longer for i in (0, 1))
    gain = costs[-1]["quadratic"][0] / costs[-1]["efficient"][0]
    name = f"{FRAMES[-1]} frames, efficient:"
    return Part(
        tuple(rows),
        (
            Line("attention", "largest difference from Eq. 8 written out", off_by(), 1e-10, False),
            Line("attention", f"{name} time a frame, over that at {FRAMES[0]}", by_time, 2.0, False),
            Line("attention", f"{name} memory a frame, over that at {FRAMES[0]}", by_memory, 1.1, False),
            Line("attention", f"{name} times as fast as quadratic", gain, 3.0, True),
        ),
    )


def cost(frames: int, repeats: int) -> dict[str, tuple[float, float]]:
    """Seconds, the least of some runs, and bytes at the most, of each kind for one clip of so many frames."""
    random = np.random.default_rng(frames)
    q, k, v = random.standard_normal((3, 1, frames, WIDTH), np.float32)
    mask = np.ones((1, frames), bool)
    spent: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for _ in range(repeats):
        for kind, run in KINDS.items():
            began = time.process_time()
            run(q, k, v, mask, HEADS)
            spent[kind].append(time.process_time() - began)
    return {kind: (min(spent[kind]), most_memory(run, q, k, v, mask)) for kind, run in KINDS.items()}


def most_memory(run: Callable[..., Array], q: Array, k: Array, v: Array, mask: NDArray[np.bool_]) -> float:
    """Bytes allocated at once while it runs, over what its input takes."""
    tracemalloc.start()
    run(q, k, v, mask, HEADS)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return float(most)


def off_by() -> float:
    """The largest difference from `written_out` in float64, as self-attention and as attention to a shorter source."""
    random, worst = np.random.default_rng(0), 0.0
    for source in (7, 4):
        q = 3 * random.standard_normal((2, 7, 8))
        k, v = 3 * random.standard_normal((2, 2, source, 8))
        mask = random.random((2, source)) < 0.7
        mask[:, 0] = True
        off = efficient_attention(q, k, v, mask, 2) - written_out(q, k, v, mask, 2)
        worst = max(worst, float(np.abs(off).max()))
    return worst


def written_out(q: Array, k: Array, v: Array, mask: NDArray[np.bool_], heads: int) -> Array:
    """Eq. 8 number by number: F_g = softmax(Kᵀ)·V over the source, Y = softmax(Q)·F_g over a head's features."""
    out = np.zeros_like(q)
    size = q.shape[-1] // heads
    for b, head in np.ndindex(len(q), heads):
        own = range(head * size, (head + 1) * size)
        heard = np.flatnonzero(mask[b])
        for i in own:
            over_source = sum(exp(k[b, m, i]) for m in heard)
            for j in own:
                overview = sum(exp(k[b, m, i]) / over_source * v[b, m, j] for m in heard)
                for n in range(q.shape[1]):
                    out[b, n, j] += exp(q[b, n, i]) / sum(exp(q[b, n, c]) for c in own) * overview
    return out
