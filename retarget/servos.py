"""Servos as their makers publish them, read from `servos.toml`, and the protocols that a servo bus may speak."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from retarget.table import Table, read_toml

PROTOCOLS = ("dynamixel1", "dynamixel2", "feetech", "lx16a", "maestro", "ssc32")
PWM, BOARDS = "pwm", ("maestro", "ssc32")  # What a servo without a bus speaks, and the boards that speak it.

# Estimates, since makers publish neither: hobby gears have 0.3 to 1 degree of play, and what a gear of this size loses
# to dry friction is some hundredths of what its motor gives.
TYPICAL_PLAY = 0.5  # degrees
TYPICAL_FRICTION = 0.02  # of the stall torque
STANDARD_MASS = 0.055  # kg, of the size called standard


@dataclass(frozen=True)
class ServoModel:
    """A servo as its maker publishes it: N·m, rad/s and A at `voltage`; `ticks`: its lowest and highest position.

    `mass` kg. `play` rad between the stops of the gears, `friction` N·m of dry friction in them.
    """

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
    mass: float = STANDARD_MASS
    play: float = 0.0
    friction: float = 0.0

    def at_supply(self, voltage: float) -> float:
        """Stall torque and no-load speed at `voltage` over those published: both rise with it."""
        return voltage / self.voltage


@cache
def servo_models() -> dict[str, ServoModel]:
    """Every servo in `servos.toml` by name; speeds converted to rad/s."""
    table = read_toml(Path(__file__).parent / "servos.toml")
    return {name: table.table(name, partial(_servo_model, name)) for name in table.data}


def _servo_model(name: str, t: Table) -> ServoModel:
    lowest, highest = t.span("ticks")
    stall_torque = t.number("stall_torque", positive=True)
    return ServoModel(
        name=name,
        protocol=t.choice("protocol", (*PROTOCOLS, PWM)),
        model_number=t.integer("model_number", 0, 65535),
        stall_torque=stall_torque,
        no_load_speed=t.number("no_load_rpm", positive=True) * 2 * math.pi / 60,
        stall_current=t.number("stall_current", positive=True),
        voltage=t.number("voltage", positive=True),
        ticks_per_turn=t.number("ticks_per_turn", positive=True),
        ticks=(round(lowest), round(highest)),
        datasheet=t.text("datasheet"),
        mass=t.number("mass", STANDARD_MASS, positive=True),
        play=math.radians(t.number("play_deg", TYPICAL_PLAY)),
        friction=t.number("friction", TYPICAL_FRICTION * stall_torque),
    )
