"""What physics found about a trajectory, in figures with units and sentences a person can act on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

Controller = Literal["open_loop", "imu", "full_state"]


@dataclass(frozen=True)
class Check:
    """One figure held against its threshold.

    `value` and `limit` are in `unit`; `ok` says whether it held; `advice` is one sentence on what was found and what
    to do. `applies` is False where the rig cannot have the fault (no floor contact on a stand): `value` is then 0.
    `at_s`: where in time it was worst, or None.
    """

    name: str
    value: float
    limit: float
    unit: str
    ok: bool
    advice: str
    applies: bool = True
    at_s: float | None = None

    @property
    def found(self) -> str:
        """The figure in words, without the digits that are only rounding."""
        return f"{round(self.value, 6):.4g}" if self.applies else "–"


@dataclass(frozen=True)
class Change:
    """What mending did to a motion: `amount` in `unit`, and `text` in a sentence."""

    name: str
    amount: float
    unit: str
    text: str


@dataclass(frozen=True)
class Trials:
    """How many of `count` disturbed trials `passed`; `failures`: how many each check failed, most first."""

    count: int
    passed: int
    seed: int
    failures: tuple[tuple[str, int], ...]

    @property
    def rate(self) -> float:
        """Share of the trials that passed."""
        return self.passed / self.count

    @property
    def text(self) -> str:
        """How many passed, and what the others failed, in one line."""
        why = ", ".join(f"{name} {count}" for name, count in self.failures)
        return f"{self.passed} of {self.count} trials passed (seed {self.seed})" + (f"; failed: {why}" if why else "")


@dataclass(frozen=True)
class Report:
    """The verdict on the very frames that will be streamed.

    `report_id`: 16 hex digits, a hash over the frames, the rig and the thresholds, so that a changed trajectory has
    no valid report; streams carry it and anything that moves refuses frames without it. `controller`: what had to run
    for the verdict to hold. `mount`: how the base was held while it was checked. `trials`: how it went on rigs a little
    other than thought, where that was asked for. `changes`: what mending did to the motion before.
    """

    ok: bool
    report_id: str
    rig: str
    mount: str
    controller: Controller
    duration_s: float
    checks: tuple[Check, ...]
    trials: Trials | None = None
    changes: tuple[Change, ...] = ()

    def failures(self) -> tuple[Check, ...]:
        """The checks that did not hold."""
        return tuple(c for c in self.checks if not c.ok)

    def to_dict(self) -> dict[str, Any]:
        """The same as plain data, ready for JSON."""
        return asdict(self)
