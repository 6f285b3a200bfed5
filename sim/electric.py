"""What servos draw and how hot they get: a DC motor's current, and a body that warms in still air.

`τ = K i` with K the stall torque over the stall current, resistance R the rated voltage over the stall current. A servo
draws `τ ω + R i²`; of that R i² stays in it as heat.
"""

from __future__ import annotations

import numpy as np

from retarget.rig import Rig
from retarget.servos import ServoModel
from sim.simulate import Array, Rollout

# Estimates, as no maker publishes thermal constants: a compact body of plastic, metal and air, in still air, heat given
# off by convection and radiation. For an XM430 that makes 13 K/W and 12 minutes.
DENSITY = 1700.0  # kg/m³, of whole servos: 1400 to 1900 for those in servos.toml
COOLING = 10.0  # W/m²K, handbooks give 5 to 15 for small bodies in a room
HEAT_CAPACITY = 700.0  # J/kgK, between steel and plastic
ROOM = 25.0  # °C


def heat_resistance(model: ServoModel) -> float:
    """K/W from a servo to the room: a cube of its mass, all sides free."""
    return 1.0 / (COOLING * 6.0 * (model.mass / DENSITY) ** (2 / 3))


def heat_time(model: ServoModel) -> float:
    """Seconds in which a servo gets within 1/e of its final temperature."""
    return model.mass * HEAT_CAPACITY * heat_resistance(model)


def heat(rig: Rig, rollout: Rollout) -> Array:
    """(T, servos) W that stay in each servo as heat while a frame is held."""
    i = [rig.joint_names().index(s.joint) for s in rig.servos]
    watts = np.array([s.model.voltage * s.model.stall_current / s.model.stall_torque**2 for s in rig.servos])
    return rollout.torque_squared[:, i] * watts


def power(rig: Rig, rollout: Rollout) -> Array:
    """(T,) W that all servos together draw while a frame is held; what braking joints give back is not counted."""
    i = [rig.joint_names().index(s.joint) for s in rig.servos]
    return (heat(rig, rollout) + rollout.drive[:, i]).sum(1)


def temperature(model: ServoModel, watts: float, seconds: float, begun: float = ROOM) -> float:
    """°C of a servo that was `begun` °C warm and then turns `watts` into heat for `seconds`."""
    final = ROOM + watts * heat_resistance(model)
    return float(final + (begun - final) * np.exp(-seconds / heat_time(model)))
