"""What every servo bus can do. `drive` needs no more than this, so another make of servo is one more file."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, TypeAlias

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Array: TypeAlias = "NDArray[np.float64]"  # a string, so that the guard, which needs none of it, starts without numpy


class BusError(RuntimeError):
    """A servo bus that failed; one line names the port, the servo and its joint."""


class ServoError(BusError):
    """A servo that failed, the one of `joint`, on a bus that goes on."""

    def __init__(self, message: str, joint: str) -> None:
        super().__init__(message)
        self.joint = joint


@dataclass(frozen=True)
class Reading:
    """Measured at one moment, all (n,) in the order of the bus's `joints`; (0,) where the servos cannot measure it.

    `position` rad in the joint's own direction and zero, or what servos that cannot be felt were told; `current` A,
    signed; `temperature` °C; `voltage` V.
    """

    position: Array
    current: Array
    temperature: Array
    voltage: Array


class ServoBus(Protocol):
    """Servos on one wire, seen as joints. A context manager: leaving it, in whatever way, switches the torque off.

    Every method raises BusError where a servo does not answer, reports a hardware error or the port is lost.
    """

    joints: tuple[str, ...]

    def __enter__(self) -> ServoBus:
        """Open the port and check that every servo is there and is the model that the rig names; nothing moves."""
        ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Torque off, then close."""
        ...

    def read(self) -> Reading:
        """What all servos measured last."""
        ...

    def write(self, goal: Array) -> None:
        """Goal angles (n,) in rad for all servos at once; the torque must be on."""
        ...

    def leave_out(self, joint: str) -> None:
        """Let the servo of `joint` go and do without it; what is read of it is where it was last."""
        ...

    def torque(self, on: bool) -> None:
        """Switch all servos on at the pose that they are in, so that none jumps (those that cannot be felt at the rig's
        safe pose), or off."""
        ...
