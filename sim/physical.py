"""Checks on what physics made of the frames: falling, sliding feet, tired servos, lost poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retarget.contacts import runs
from sim.evidence import Array, Evidence, not_here, peak, verdict
from sim.report import Check
from sim.support import NEAR
from sim.thresholds import limit_for, rig_size

CLEAR = 0.02  # m at human size: a sole that is to be higher is clear of the floor; swinging toes pass at 2 cm
SLIDING_SPEED = 0.2  # m/s at human size: a contact that is faster counts as skating (Kimodo's foot skate ratio)


def stable(e: Evidence) -> Check:
    """Breakdowns of the simulation: 0, or 1 where it flew apart."""
    broken = e.rollout.breakdown
    if broken is None:
        return verdict(e, "stable", 0, None, "The simulation ran to the end", "")
    found = f"The simulation flew apart at {broken.body}, {broken.at_s:.2f} s"
    return verdict(e, "stable", 1, broken.at_s, found, "check the gains, masses and starting pose of the rig")


def self_contact(e: Evidence) -> Check:
    """Share of time for which two parts of the rig that are not neighbours touch."""
    touching = e.done.self_depth > 0
    if not touching.any():
        return verdict(e, "self_contact", 0.0, None, "No two parts touch", "")
    frame = int(np.argmax(e.done.self_depth))
    (one, other), at = e.done.self_pair[frame], e.seconds(frame)
    found = f"{one} and {other} press on one another hardest at {at:.2f} s"
    return verdict(e, "self_contact", touching.mean(), at, found, "keep the two apart there")


def skate_speed(e: Evidence) -> Check:
    """Mean planar speed (m/s) of the feet while they touch the floor, at each foot's lowest sole point."""
    if e.mount == "stand" or not e.done.soles:
        return not_here(e, "skate_speed")
    speed, contact = _steps_on_floor(e)
    worst = peak(np.where(contact, speed, 0.0))
    at, foot = e.seconds(worst.frame), tuple(e.done.soles)[worst.column]
    found = f"{foot} slides on the floor with up to {worst.value:.2f} m/s at {at:.2f} s"
    mean = float(speed[contact].mean()) if contact.any() else 0.0
    return verdict(e, "skate_speed", mean, at, found, "hold the planted foot still or lift it")


def skate_ratio(e: Evidence) -> Check:
    """Share of contact frames in which a foot moves faster than 0.2 m/s at human size, the speed of Kimodo's ratio.

    Kimodo takes a sole that is low for one in contact, since a motion file holds no forces; physics knows better. A
    swinging foot passes low over the floor, and that is walking, not skating.
    """
    if e.mount == "stand" or not e.done.soles:
        return not_here(e, "skate_ratio")
    speed, contact = _steps_on_floor(e)
    sliding = contact & (speed > SLIDING_SPEED * rig_size(e.rig))
    worst = int(np.argmax(sliding.sum(0)))
    share = sliding.sum() / max(contact.sum(), 1)
    foot = tuple(e.done.soles)[worst]
    found = f"{foot} skates most, in {sliding[:, worst].sum()} of {contact[:, worst].sum()} contact frames"
    at = e.seconds(int(np.argmax(sliding[:, worst]))) if share else None
    return verdict(e, "skate_ratio", share, at, found, "hold the planted foot still or lift it")


def contact_timing(e: Evidence) -> Check:
    """Longest time (s) for which a foot misses, by 5 mm × size, the floor that it should stand on, or the reverse.

    The reverse is a foot that touches while its lowest point is asked to be clear of the floor; in between, where a
    heel lifts or a toe comes down, either may be.
    """
    if e.mount == "stand" or not e.done.soles:
        return not_here(e, "contact_timing")
    longest = (0.0, 0, "", "")
    for name, sole in e.asked.soles.items():
        touches, missed = e.done.touching[name], e.done.soles[name][..., 2].min(1) > NEAR * rig_size(e.rig)
        stands = e.trajectory.contacts.get(name, np.zeros(len(touches), bool))
        clear = ~stands & (sole[..., 2].min(1) > CLEAR * rig_size(e.rig))
        for wrong, says in (
            (stands & ~touches & missed, "is in the air where it should stand"),
            (clear & touches, "drags"),
        ):
            for start, end in runs(wrong):
                longest = max(longest, ((end - start) / e.trajectory.fps, start, name, says))
    length, start, foot, says = longest
    if length == 0:
        return verdict(e, "contact_timing", 0.0, None, "Every foot touches the floor when it should", "")
    at = e.seconds(start)
    found = f"{foot} {says} for {length:.2f} s from {at:.2f} s"
    return verdict(e, "contact_timing", length, at, found, "lift the foot higher, or move slower")


def _steps_on_floor(e: Evidence) -> tuple[Array, NDArray[np.bool_]]:
    """(T − 1, feet): planar speed in m/s of every foot, and whether it touches the floor in both frames."""
    speed = [_planted_speed(sole, e.trajectory.fps) for sole in e.done.soles.values()]
    contact = [e.done.touching[name][1:] & e.done.touching[name][:-1] for name in e.done.soles]
    return np.stack(speed, axis=1), np.stack(contact, axis=1)


def _planted_speed(sole: Array, fps: float) -> Array:
    """Planar speed (T − 1,) in m/s of the site that is lowest at the start of each interval; `sole` is (T, S, 3)."""
    if len(sole) < 2:
        return np.zeros(0)
    lowest = np.argmin(sole[:-1, :, 2], axis=1)
    speed = np.linalg.norm(np.diff(sole[..., :2], axis=0), axis=2) * fps
    return np.take_along_axis(speed, lowest[:, None], axis=1)[:, 0]


def fall_tilt(e: Evidence) -> Check:
    """Largest angle (rad) between the root's up axis in physics and in the motion."""
    if e.mount != "free":
        return not_here(e, "fall_tilt")
    angle = np.arccos(np.clip(np.sum(e.asked.root_up * e.done.root_up, axis=1), -1, 1))
    at, worst = _passed(e, "fall_tilt", angle)
    found = f"{e.rig.root} leans up to {worst:.2f} rad away from the motion, at {at:.2f} s"
    return verdict(
        e, "fall_tilt", worst, at, found, "it falls, so use a stand or a harness, or keep the weight over the feet"
    )


def fall_drop(e: Evidence) -> Check:
    """Largest height (m) by which the root is lower in physics than in the motion."""
    if e.mount != "free":
        return not_here(e, "fall_drop")
    drop = np.maximum(e.trajectory.root_pos[:, 2] - e.rollout.qpos[:, 2], 0.0)
    at, worst = _passed(e, "fall_drop", drop)
    found = f"{e.rig.root} is up to {worst:.3f} m lower than the motion has it, at {at:.2f} s"
    return verdict(e, "fall_drop", worst, at, found, "the legs give way, so crouch less or use a stand or a harness")


def _passed(e: Evidence, name: str, values: Array) -> tuple[float, float]:
    """When (s) `values` (T,) first went above the limit of check `name`, or else peaked; and how high they went."""
    over = values > limit_for(name, e.rig)
    frame = int(np.argmax(over)) if over.any() else int(np.argmax(values))
    return e.seconds(frame), float(values.max())


def torque_saturation(e: Evidence) -> Check:
    """Share of time that the worst servo spends at the torque that is left to it at its present speed."""
    share = e.rollout.saturated.mean(0)
    column = int(np.argmax(share))
    if share[column] == 0:
        return verdict(e, "torque_saturation", 0.0, None, "No servo is at its torque limit", "")
    at, name = e.seconds(int(np.argmax(e.rollout.saturated[:, column]))), e.rig.joints[column].name
    found = f"The servo of {name} is at its limit for {share[column]:.0%} of the time, first at {at:.2f} s"
    remedy = "play the motion slower, make it smaller or lighten the limb"
    return verdict(e, "torque_saturation", share[column], at, found, remedy)


def tracking_joint(e: Evidence) -> Check:
    """Rms over time of the angle (rad) between the worst joint and where it should be at the end of each hold."""
    error = np.abs(e.rollout.qpos[:, 7:] - e.trajectory.joint_pos)
    rms = np.sqrt(np.mean(error**2, axis=0))
    column = int(np.argmax(rms))
    at, name = e.seconds(int(np.argmax(error[:, column]))), e.rig.joints[column].name
    found = f"{name} follows worst, {rms[column]:.3f} rad rms, most at {at:.2f} s"
    return verdict(e, "tracking_joint", rms[column], at, found, "play the motion slower or make it smaller")


def tracking_body(e: Evidence) -> Check:
    """Rms over time of the distance (m), in the world, between the worst hand or foot and where it should be."""
    if not e.asked.end_names:
        return not_here(e, "tracking_body")
    error = np.linalg.norm(e.done.ends - e.asked.ends, axis=2)
    rms = np.sqrt(np.mean(error**2, axis=0))
    column = int(np.argmax(rms))
    at, name = e.seconds(int(np.argmax(error[:, column]))), e.asked.end_names[column]
    found = f"{name} is {rms[column] * 1000:.0f} mm rms from its place, most at {at:.2f} s"
    remedy = "play the motion slower, or hold the base by a stand or a harness"
    return verdict(e, "tracking_body", rms[column], at, found, remedy)


def harness(e: Evidence) -> Check:
    """95th percentile over time of the harness force, in weights of the rig."""
    if e.mount != "hung":
        return not_here(e, "harness")
    force = np.linalg.norm(e.rollout.harness, axis=1) / e.rollout.weight
    at = e.seconds(int(np.argmax(force)))
    found = f"The harness pulls with up to {force.max():.2f} weights at {at:.2f} s"
    return verdict(
        e, "harness", np.percentile(force, 95), at, found, "the root moves as no strap can carry it, so smooth it"
    )


PHYSICAL = (
    stable,
    fall_tilt,
    fall_drop,
    skate_speed,
    skate_ratio,
    contact_timing,
    self_contact,
    torque_saturation,
    tracking_joint,
    tracking_body,
    harness,
)
