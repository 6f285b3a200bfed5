"""Checks on the balance of the frames themselves: could any servos, however strong, do this on these feet?"""

from __future__ import annotations

import numpy as np

from retarget.contacts import runs
from sim.evidence import Array, Evidence, not_here, verdict
from sim.report import Check
from sim.thresholds import rig_size

AT_REST = 0.05  # m/s at human size: slower than this a centre of mass rests
NOTHING = 1e-6  # weights: what the solver leaves
SUSTAINED = 95  # percentile over time: what is above it is shorter than a servo can follow


def com_outside(e: Evidence) -> Check:
    """How far (m) the centre of mass is outside the support polygon while it rests there, at most.

    It rests where it is slow for as long as an upside-down pendulum of the root's height needs to fall, √(h/g): an
    instant of it is the turning point of a sway.
    """
    if e.balance is None:
        return not_here(e, "com_outside")
    outside = _outside(e.balance.com_margin)
    slow = e.balance.moves.com_speed < AT_REST * rig_size(e.rig)
    falling = np.sqrt(e.rig.nominal.height / np.linalg.norm(e.scene.model.opt.gravity))
    rests = np.zeros(len(slow), bool)
    for start, end in runs(slow & (outside > 0)):
        rests[start:end] = (end - start) / e.trajectory.fps >= falling
    frame = int(np.argmax(np.where(rests, outside, 0.0)))
    if not rests[frame]:
        return verdict(e, "com_outside", 0.0, None, "The centre of mass rests over the feet", "")
    at = e.seconds(frame)
    found = f"The centre of mass rests {outside[frame] * 1000:.0f} mm beside the feet at {at:.2f} s"
    return verdict(e, "com_outside", outside[frame], at, found, "shift the pelvis over the feet, or use a stand")


def zmp_outside(e: Evidence) -> Check:
    """How far (m) the zero-moment point is outside the support polygon: 95th percentile over the supported frames."""
    if e.balance is None:
        return not_here(e, "zmp_outside")
    supported = np.isfinite(e.balance.zmp_margin)
    outside = _outside(e.balance.zmp_margin)
    if not supported.any() or outside.max() == 0:
        return verdict(e, "zmp_outside", 0.0, None, "The zero-moment point stays on the feet", "")
    frame = int(np.argmax(outside))
    at, value = e.seconds(frame), float(np.percentile(outside[supported], SUSTAINED))
    found = f"The zero-moment point leaves the feet by up to {outside[frame] * 1000:.0f} mm at {at:.2f} s"
    return verdict(e, "zmp_outside", value, at, found, "move slower there, or shift the pelvis over the feet")


def residual_wrench(e: Evidence) -> Check:
    """Help (weights of the rig) that the motion needs from outside: 95th percentile over time.

    A moment counts as the force that gives it at the root's height; see `sim.support.residual_wrench`.
    """
    if e.balance is None:
        return not_here(e, "residual_wrench")
    force = np.linalg.norm(e.balance.residual[:, :3], axis=1)
    moment = np.linalg.norm(e.balance.residual[:, 3:], axis=1)
    size = np.hypot(force, moment / e.rig.nominal.height) / e.rollout.weight
    frame = int(np.argmax(size))
    if size[frame] < NOTHING:
        return verdict(e, "residual_wrench", 0.0, None, "The motion needs no help from outside", "")
    at = e.seconds(frame)
    found = f"The motion needs {force[frame]:.1f} N and {moment[frame]:.2f} N·m of help from outside at {at:.2f} s"
    return verdict(
        e, "residual_wrench", np.percentile(size, SUSTAINED), at, found, "keep the weight over the feet and move slower"
    )


def _outside(margin: Array) -> Array:
    return np.maximum(-np.nan_to_num(margin, nan=0.0), 0.0)


STANDING = (com_outside, zmp_outside, residual_wrench)
