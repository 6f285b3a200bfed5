"""Checks on the frames themselves, before any physics: limits, speeds, the floor, parts that overlap."""

from __future__ import annotations

import numpy as np

from sim.evidence import Array, Evidence, not_here, peak, verdict
from sim.report import Check

SUSTAINED = 99  # percentile over time: one bad frame is what joint_speed is for
SOLVER_SLACK = 1.01  # inverse kinematics keeps a velocity limit to about a percent


def joint_limit(e: Evidence) -> Check:
    """Largest excursion (rad) of any joint beyond its range."""
    q = e.trajectory.targets
    lower, upper = (np.array([getattr(j, side) for j in e.rig.joints]) for side in ("lower", "upper"))
    worst = peak(np.maximum(np.maximum(lower - q, q - upper), 0.0))
    at, joint = e.seconds(worst.frame), e.rig.joints[worst.column]
    if worst.value == 0:
        return verdict(e, "joint_limit", 0.0, None, "Every joint stays in its range", "")
    found = f"{joint.name} goes {worst.value:.3f} rad beyond [{joint.lower:.2f}, {joint.upper:.2f}] rad at {at:.2f} s"
    return verdict(e, "joint_limit", worst.value, at, found, "retarget with the limits of this rig")


def joint_speed(e: Evidence) -> Check:
    """Largest joint speed (rad/s) between two frames."""
    worst = peak(np.abs(np.diff(e.trajectory.targets, axis=0)) * e.trajectory.fps)
    at, name = e.seconds(worst.frame), e.rig.joints[worst.column].name
    found = f"The fastest joint is {name} with {worst.value:.1f} rad/s at {at:.2f} s"
    return verdict(e, "joint_speed", worst.value, at, found, "the clip jumps there, so cut or smooth it")


def jerk(e: Evidence) -> Check:
    """Largest jerk (rad/s³) of any joint, from third differences: 99th percentile over time."""
    if len(e.trajectory) < 4:
        return verdict(e, "jerk", 0.0, None, "The motion is too short to jerk", "")
    change = np.abs(np.diff(e.trajectory.joint_pos, n=3, axis=0))
    sustained = sustained_jerk(e.trajectory.joint_pos, e.trajectory.fps)
    column = int(np.argmax(sustained))
    at, name = e.seconds(int(np.argmax(change[:, column]))), e.rig.joints[column].name
    found = f"{name} jerks most, with {sustained[column]:.0f} rad/s³, above all at {at:.2f} s"
    return verdict(e, "jerk", sustained[column], at, found, "smooth the motion")


def sustained_jerk(angles: Array, fps: float) -> Array:
    """(nj,) rad/s³ of `angles` (T, nj) in rad, T at least 4: 99th percentile of their third differences."""
    return np.percentile(np.abs(np.diff(angles, n=3, axis=0)) * fps**3, SUSTAINED, axis=0)


def body_speed(e: Evidence) -> Check:
    """Largest speed (m/s) of any body between two frames."""
    worst = peak(np.linalg.norm(np.diff(e.asked.bodies, axis=0), axis=2) * e.trajectory.fps)
    at, name = e.seconds(worst.frame), e.asked.body_names[worst.column]
    found = f"The fastest body is {name} with {worst.value:.2f} m/s at {at:.2f} s"
    return verdict(e, "body_speed", worst.value, at, found, "the clip jumps there, so cut or smooth it")


def speed_saturation(e: Evidence) -> Check:
    """Share of time for which the worst joint is asked for more than the speed its servo is allowed."""
    speed = np.abs(np.diff(e.trajectory.targets, axis=0)) * e.trajectory.fps
    allowed = np.array([j.velocity for j in e.rig.joints])
    share = (speed > SOLVER_SLACK * allowed).mean(0) if len(speed) else np.zeros(len(allowed))
    column = int(np.argmax(share))
    if share[column] == 0:
        return verdict(e, "speed_saturation", 0.0, None, "No joint is asked for more than its servo's speed", "")
    at, joint = e.seconds(int(np.argmax(speed[:, column]))), e.rig.joints[column]
    found = (
        f"{joint.name} is asked for up to {speed[:, column].max():.1f} rad/s at {at:.2f} s, above {joint.velocity:.1f}"
    )
    return verdict(e, "speed_saturation", share[column], at, found, "play the motion slower or make it smaller")


def penetration(e: Evidence) -> Check:
    """Mean over frames of the depth (m) of the deepest part below the floor."""
    if e.mount == "stand":
        return not_here(e, "penetration")
    frame = int(np.argmax(e.asked.floor_depth))
    depth, at = e.asked.floor_depth[frame], e.seconds(frame)
    if depth == 0:
        return verdict(e, "penetration", 0.0, None, "Nothing goes below the floor", "")
    found = f"{e.asked.floor_body[frame]} is up to {depth * 1000:.0f} mm below the floor at {at:.2f} s"
    return verdict(e, "penetration", e.asked.floor_depth.mean(), at, found, "raise the root or bend the legs more")


def floating(e: Evidence) -> Check:
    """Mean height (m) of the lowest point of all soles above the floor, while the motion says that a foot stands.

    A flight phase is not a fault; a motion that never says so is judged in every frame.
    """
    if e.mount == "stand" or not e.asked.soles:
        return not_here(e, "floating")
    lowest = np.maximum(np.concatenate([s[..., 2] for s in e.asked.soles.values()], axis=1).min(1), 0.0)
    stands = np.any([np.zeros(len(lowest), bool), *e.trajectory.contacts.values()], axis=0)
    stands = stands if stands.any() else ~stands
    frame = int(np.argmax(np.where(stands, lowest, -1.0)))
    at = e.seconds(frame)
    found = f"The lowest sole is up to {lowest[frame] * 1000:.0f} mm above the floor at {at:.2f} s"
    return verdict(e, "floating", lowest[stands].mean(), at, found, "lower the root until a foot stands")


def self_collision(e: Evidence) -> Check:
    """Deepest overlap (m) of two parts of the rig that are not neighbours, in the pose that is asked for."""
    frame = int(np.argmax(e.asked.self_depth))
    depth, at = e.asked.self_depth[frame], e.seconds(frame)
    if depth == 0:
        return verdict(e, "self_collision", 0.0, None, "No two parts are asked to overlap", "")
    one, other = e.asked.self_pair[frame]
    found = f"{one} and {other} would overlap by {depth * 1000:.0f} mm at {at:.2f} s"
    return verdict(e, "self_collision", depth, at, found, "keep the two apart there")


COMMANDED = (joint_limit, joint_speed, body_speed, jerk, speed_saturation, penetration, floating, self_collision)
