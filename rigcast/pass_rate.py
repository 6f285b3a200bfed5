"""How many of some motions a rig could do: each retargeted and judged in physics, as `say` does it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from motiongen.motion import Motion
from retarget.rig import Mount, load_rig
from rigcast.pipeline import take
from rigcast.times import Times


@dataclass(frozen=True)
class PassRate:
    """Of `motions` on one rig and mount, `passed` passed the gate and `rate` is their share.

    `failures`: how many motions each check failed, most first; a motion may fail several. `unreadable`: motions that
    could not be retargeted, by their place in the list, and why; they count as not passed.
    """

    rig: str
    mount: str
    motions: int
    passed: int
    failures: tuple[tuple[str, int], ...]
    unreadable: tuple[tuple[int, str], ...]

    @property
    def rate(self) -> float:
        return self.passed / self.motions


def pass_rate(
    motions: Sequence[Motion],
    rig: str,
    *,
    mount: Mount | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PassRate:
    """Share of `motions` that pass the gate on the rig named `rig`, held as `mount` says, or as the rig is by default.

    Another check of `sim.checks` is counted as soon as it is there. Raises ValueError where there are no motions,
    RigError (a ValueError) for an unknown rig.
    """
    if not motions:
        raise ValueError("no motions to judge")
    body = load_rig(rig)
    failed: Counter[str] = Counter()
    unreadable = []
    passed = 0
    for i, motion in enumerate(motions):
        try:
            report = take(motion, body, mount, Times()).report
        except ValueError as error:
            unreadable.append((i, str(error)))
        else:
            passed += report.ok
            failed.update(check.name for check in report.failures())
        if progress is not None:
            progress(i + 1, len(motions))
    held = body.mount if mount is None else mount
    return PassRate(body.name, held, len(motions), passed, tuple(failed.most_common()), tuple(unreadable))
