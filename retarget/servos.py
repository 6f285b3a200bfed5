"""Servos as their makers publish them, read from `servos.toml`, and the protocols that a servo bus may speak."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from retarget.table import Table, read_toml

PROTOCOLS = ("dynamixel1", "dynamixel2", "feetech", "lx16a", "maestro", "ssc32")
PWM, BOARDS = "pwm", ("maestro", "ssc32")  # What a servo without a bus speaks, and the boards that speak it.


@dataclass(frozen=True)
class ServoModel:
    """A servo as its maker publishes it: N·m, rad/s and A at `voltage`; `ticks`: its lowest and highest position."""

    name: str
    protocol: str
    model_number: int
    stall_torque: float
    no_load_speed: float
    stall_current: float
    voltage: float
    ticks_per_turn: float
    ticks: tuple[int, int]
    datasheet: str


@cache
def servo_models() -> dict[str, ServoModel]:
    """Every servo in `servos.toml` by name; speeds converted to rad/s."""
    table = read_toml(Path(__file__).parent / "servos.toml")
    return {name: table.table(name, partial(_servo_model, name)) for name in table.data}


def _servo_model(name: str, t: Table) -> ServoModel:
    lowest, highest = t.span("ticks")
    return ServoModel(
        name=name,
        protocol=t.choice("protocol", (*PROTOCOLS, PWM)),
        model_number=t.integer("model_number", 0, 65535),
        stall_torque=t.number("stall_torque", positive=True),
        no_load_speed=t.number("no_load_rpm", positive=True) * 2 * math.pi / 60,
        stall_current=t.number("stall_current", positive=True),
        voltage=t.number("voltage", positive=True),
        ticks_per_turn=t.number("ticks_per_turn", positive=True),
        ticks=(round(lowest), round(highest)),
        datasheet=t.text("datasheet"),
    )
