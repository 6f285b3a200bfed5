"""The driver for a rig's bus, by the protocol that its rig.toml names."""

from __future__ import annotations

from drivers.bus import BusError, ServoBus
from drivers.calibration import Calibration
from drivers.servos.packet_bus import PacketBus
from drivers.servos.port import Wire
from drivers.servos.pwm_bus import PwmBus
from retarget.rig import Rig
from retarget.servos import BOARDS


def connect(rig: Rig, port: str | Wire, *, calibration: Calibration | None = None) -> ServoBus:
    """The servo bus of `rig` on the serial `port`, not yet opened. Raises BusError where the rig cannot be driven."""
    if not rig.buses:
        raise BusError(f"rig {rig.name!r} has no servo bus")
    if rig.buses[0].protocol in BOARDS:
        return PwmBus(rig, port, calibration=calibration)
    return PacketBus(rig, port, calibration=calibration)
