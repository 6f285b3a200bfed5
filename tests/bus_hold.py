"""Small things that the tests of the servo buses share."""

from __future__ import annotations

from drivers.bus import Array, Reading, ServoBus
from drivers.emulation.in_process import InProcess


def hold(wire: InProcess, bus: ServoBus, goal: Array, seconds: float) -> Reading:
    """Command `goal` (n,) rad at 50 Hz on the emulated clock; the last reading."""
    for _ in range(max(1, round(seconds / 0.02))):
        bus.write(goal)
        wire.wait(0.02)
        reading = bus.read()
    return reading
