"""Every threshold of the gate, in one table: what a figure may be at most, its unit, and why."""

from __future__ import annotations

from dataclasses import dataclass

from retarget.rig import Rig

PASS_RATE = 0.9  # of disturbed trials: one in ten may be the push that nobody withstands
HUMAN_ROOT_HEIGHT = 0.93  # m, pelvis of a standing adult: a rig of this size has size 1


@dataclass(frozen=True)
class Threshold:
    """`limit` in `unit`; where `scaled`, it is for a human-sized rig and shrinks or grows with the rig."""

    limit: float
    unit: str
    scaled: bool
    reason: str


THRESHOLDS: dict[str, Threshold] = {
    "stable": Threshold(0, "breakdowns", False, "a simulation that blows up says nothing about the rig"),
    "joint_limit": Threshold(0.002, "rad", False, "one tick of a 4096-tick servo is 0.0015 rad"),
    "joint_speed": Threshold(40, "rad/s", False, "no human joint is faster: the clip jumps"),
    "body_speed": Threshold(15, "m/s", True, "no human limb is faster: the clip jumps"),
    "jerk": Threshold(
        12500, "rad/s³", False, "0.1 rad in a third difference at 50 Hz: servos would rattle at full torque"
    ),
    "speed_saturation": Threshold(0.05, "share of time", False, "more than a rare peak is cut off by the servo"),
    "torque_saturation": Threshold(
        0.25, "share of time", False, "bursts are how limbs speed up; lasting, they sag, heat and trip"
    ),
    "penetration": Threshold(0.010, "m", True, "a sole 5 mm deep is the labelling noise of motion capture; twice that"),
    "floating": Threshold(0.025, "m", True, "heel lift and noise of capture stay under it; a lifted clip does not"),
    "self_collision": Threshold(0.020, "m", True, "more than what soft covers and play in the joints give way to"),
    "self_contact": Threshold(0.33, "share of time", False, "a touch is a gesture; leaning on oneself stalls servos"),
    "skate_speed": Threshold(0.15, "m/s", True, "above the speed at which a foot counts as planted"),
    "skate_ratio": Threshold(0.30, "share of contact", False, "a planted foot that slides in a third of its frames"),
    "contact_timing": Threshold(
        0.2, "s", False, "servo lag stays well under it; a foot that does not come down does not"
    ),
    "fall_tilt": Threshold(0.5, "rad", False, "29 degrees off the motion: past the tipping point of a narrow stance"),
    "fall_drop": Threshold(0.25, "m", True, "the root sank by a quarter of a leg: the legs gave way"),
    "tracking_joint": Threshold(0.15, "rad", False, "9 degrees rms: the gesture is still the same gesture"),
    "tracking_body": Threshold(0.15, "m", True, "servo lag of a fast wave stays under it; a lost step does not"),
    "com_outside": Threshold(0.005, "m", True, "what a sole's outline is known to; farther out nothing rests"),
    "zmp_outside": Threshold(0.010, "m", True, "soft soles and play take up so much; beyond, the foot tips"),
    "residual_wrench": Threshold(0.10, "weights", False, "the rest would have to come from a hand or a string"),
    "servo_heat": Threshold(1.0, "share of allowed rise", False, "hotter, a drive lets go"),
    "supply": Threshold(
        1.0, "share of supply", False, "beyond what it gives its voltage breaks down and servos restart"
    ),
    "pinch": Threshold(140, "N", False, "what ISO/TS 15066 lets a robot press on a finger"),
    "harness": Threshold(2.0, "weights", False, "the strap carries the rig and as much again, not a throw"),
}


def rig_size(rig: Rig) -> float:
    """Root height of the rig's nominal pose over a human's (1)."""
    return rig.nominal.height / HUMAN_ROOT_HEIGHT


def limit_for(name: str, rig: Rig) -> float:
    """The threshold of check `name` for this rig, in the unit of the table."""
    threshold = THRESHOLDS[name]
    return threshold.limit * (rig_size(rig) if threshold.scaled else 1.0)
