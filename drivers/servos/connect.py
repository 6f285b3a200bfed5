"""The driver for a rig's bus, by the protocol that its rig.toml names."""

from __future__ import annotations

from drivers.bus import BusError, ServoBus
from drivers.calibration import Calibration
from drivers.servos.guard import SILENCE_S, GuardedWire
from drivers.servos.packet_bus import PacketBus
from drivers.servos.port import Wire
from drivers.servos.pwm_bus import BOARDS, PwmBus
from drivers.servos.table import family_of
from retarget.rig import Rig


def connect(
    rig: Rig,
    port: str | Wire,
    *,
    calibration: Calibration | None = None,
    torque_share: float = 1.0,
    guarded: bool = False,
    silence_s: float = SILENCE_S,
) -> ServoBus:
    """The servo bus of `rig` on the serial `port`, not yet opened; `torque_share` as of `PacketBus`, which boards lack.

    `guarded`: the port is opened by a process of its own, which switches all servos off where this one dies, or
    says nothing for `silence_s` (an SSC-32U it leaves in peace: it is asked nothing while its pulses are off). Raises
    BusError where the rig cannot be driven.
    """
    if not rig.buses:
        raise BusError(f"rig {rig.name!r} has no servo bus")
    if guarded and isinstance(port, str):
        port = GuardedWire(port, off_bytes(rig), None if rig.buses[0].protocol == "ssc32" else silence_s)
    if rig.buses[0].protocol in BOARDS:
        return PwmBus(rig, port, calibration=calibration)
    return PacketBus(rig, port, calibration=calibration, torque_share=torque_share)


def off_bytes(rig: Rig) -> bytes:
    """What to send so that every servo of `rig` lets go."""
    if rig.buses[0].protocol in BOARDS:
        return BOARDS[rig.buses[0].protocol].pulses({s.id: 0 for s in rig.servos}, {s.id: 0 for s in rig.servos})
    family = family_of(rig)
    rows: dict[int, list[tuple[int, bytes]]] = {}
    for servo in rig.servos:
        register = family.models[servo.model.name].by_name["torque_enable"]
        rows.setdefault(register.address, []).append((servo.id, register.encode(0)))
    return b"".join(family.codec.write(address, some) for address, some in rows.items())
