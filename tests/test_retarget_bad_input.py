"""Human motion that no rig can follow, or that is hardly one: a trajectory within limits, or one line that says why."""

from __future__ import annotations

from dataclasses import replace

import motions
import numpy as np
import pytest

from motiongen.motion import Motion
from motiongen.rotation import axis_angle_to_quat, quat_mul
from retarget.retarget import retarget
from retarget.rig import load_rig


def tipped(angle: float) -> Motion:
    """Waving, all of it turned forward by `angle` about the left axis, with the pelvis 1 m up."""
    clip = motions.wave(seconds=1.5)
    quat = clip.joint_quat.copy()
    quat[:, 0] = quat_mul(axis_angle_to_quat(motions.LEFT, angle), quat[:, 0])
    return replace(clip, root_pos=clip.root_pos * [1, 1, 0] + [0, 0, 1.0], joint_quat=quat)


def at_rate(fps: float) -> Motion:
    return replace(motions.wave(seconds=max(1.0, 4 / fps), fps=fps), contacts=None)


def first(frames: int) -> Motion:
    clip = motions.walk()
    return replace(clip, root_pos=clip.root_pos[:frames], joint_quat=clip.joint_quat[:frames], labels=())


STRANGE = {
    "lying": lambda: tipped(np.pi / 2),
    "upside down": lambda: tipped(np.pi),
    "underground": lambda: replace(motions.walk(), root_pos=motions.walk().root_pos - [0, 0, 3]),
    "5 frames": lambda: first(5),
    "1 fps": lambda: at_rate(1),
    "240 fps": lambda: at_rate(240),
}


@pytest.mark.parametrize("rig", ["puppet", "humanoid"])
@pytest.mark.parametrize("clip", STRANGE)
def test_strange_motions_stay_within_limits_and_above_the_floor(rig: str, clip: str) -> None:
    body = load_rig(rig)
    trajectory = retarget(STRANGE[clip](), body, mount="free")  # checks limits and speeds itself
    assert np.isfinite(trajectory.qpos).all()
    assert np.linalg.norm(trajectory.qpos[:, 3:7], axis=1) == pytest.approx(1)
    assert trajectory.root_pos[:, 2].min() > 0


def test_underground_is_where_the_floor_is() -> None:
    """A clip's floor is where its feet stand: 3 m down is the same walk, for another floor."""
    above, below = (
        retarget(clip, load_rig("puppet"), mount="free") for clip in (motions.walk(), STRANGE["underground"]())
    )
    assert below.qpos == pytest.approx(above.qpos, abs=1e-6)


def test_numbers_that_are_none_are_refused() -> None:
    clip = motions.stand()
    root = clip.root_pos.copy()
    root[3, 1] = np.nan
    with pytest.raises(ValueError, match="frame 3 is not finite"):
        retarget(replace(clip, root_pos=root), load_rig("puppet"))
