"""Checks on what the servos can take: heat, and the supply that they share."""

from __future__ import annotations

import numpy as np

from sim.electric import ROOM, heat, power, temperature
from sim.evidence import Evidence, not_here, verdict
from sim.report import Check

SHOW = 1800.0  # s: a motion is played in a loop for half an hour


def servo_heat(e: Evidence) -> Check:
    """Hottest servo after half an hour of the motion in a loop, as a share of the rise that it is allowed.

    The rise is from a room of 25 °C to the servo's `max_temperature`; see `sim.electric` for the estimates.
    """
    if not e.rig.servos:
        return not_here(e, "servo_heat", "with a rig that names no servos")
    watts = heat(e.rig, e.rollout)
    warm = np.array([temperature(s.model, w, SHOW) for s, w in zip(e.rig.servos, watts.mean(0), strict=True)])
    share = (warm - ROOM) / (np.array([s.max_temperature for s in e.rig.servos]) - ROOM)
    worst = int(np.argmax(share))
    servo, at = e.rig.servos[worst], e.seconds(int(np.argmax(watts[:, worst])))
    found = (
        f"The servo of {servo.joint} gets {warm[worst]:.0f} °C warm where this is played for half an hour, "
        f"most at {at:.2f} s"
    )
    return verdict(e, "servo_heat", share[worst], at, found, "let it rest between, or unload the limb")


def supply(e: Evidence) -> Check:
    """Highest electric power that all servos draw together while a frame is held, as a share of the supply's."""
    if not e.rig.servos or e.rig.power is None:
        return not_here(e, "supply", "with a rig that tells no supply")
    drawn, most = power(e.rig, e.rollout), e.rig.power.voltage * e.rig.power.current
    frame = int(np.argmax(drawn))
    at = e.seconds(frame)
    found = f"The servos draw up to {drawn[frame]:.0f} of {most:.0f} W at {at:.2f} s"
    return verdict(e, "supply", drawn[frame] / most, at, found, "play the motion slower or use a stronger supply")


DRIVES = (servo_heat, supply)
