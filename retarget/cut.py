"""A trajectory that ends before its time: it slows down, then eases to the rig's nominal pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from motiongen.motion import Label
from motiongen.rotation import Array, quat_mul, quat_rotate, yaw_of_quat, yaw_quat
from retarget.rig import Rig
from retarget.timeline import RAMP, ease, ease_frames, normalised, run_down, stretch
from retarget.trajectory import Trajectory


def cut_short(trajectory: Trajectory, frame: int, rig: Rig) -> Trajectory:
    """`trajectory` up to `frame`, then run down to rest within `RAMP` s and eased to the nominal pose where it stands.

    It never is faster than `trajectory` or the rig's joints, nor outside of their limits; physics has to be asked
    anew. Raises ValueError where `frame` is not one of its frames.
    """
    if not 0 <= frame < len(trajectory):
        raise ValueError(f"cannot cut at frame {frame} of {len(trajectory)}")
    fps = trajectory.fps
    slowing = run_down(frame, len(trajectory) - 1, round(RAMP * fps))
    shown = normalised(stretch(normalised(trajectory.qpos), slowing))
    rest = _at_rest(trajectory, shown[-1], rig)
    velocity = np.array([joint.velocity for joint in rig.joints])
    count = ease_frames(rest[7:] - shown[-1, 7:], velocity, fps)
    back = np.concatenate([ease(shown[-1], rest, count)[1:], rest[None]])
    qpos = normalised(np.concatenate([trajectory.qpos[:frame], shown, back]))
    contacts = {
        foot: np.concatenate([down[:frame], down[slowing.at.astype(int)], np.full(len(back), down[-1])])
        for foot, down in trajectory.contacts.items()
    }
    aim = None
    if trajectory.aim is not None:  # what servos are told beyond where they are to be fades with the motion
        lead = trajectory.aim - trajectory.joint_pos
        slower = stretch(lead, slowing)
        fading = np.linspace(1, 0, len(back) + 1)[1:, None] * slower[-1]
        aim = qpos[:, 7:] + np.concatenate([lead[:frame], slower, fading])
    return replace(trajectory, qpos=qpos, contacts=contacts, labels=_until(trajectory.labels, frame / fps), aim=aim)


def standing_at(trajectory: Trajectory, root: Array) -> Trajectory:
    """`trajectory` moved over the floor: its first frame is where `root` (7,), metres and w x y z, is, and faces as it
    does. Heights and tilts stay, so that physics finds the same.
    """
    first = trajectory.qpos[0]
    turn = yaw_quat(yaw_of_quat(root[3:7]) - yaw_of_quat(first[3:7]))
    qpos = trajectory.qpos.copy()
    qpos[:, :2] -= first[:2]
    qpos[:, :3] = quat_rotate(turn, qpos[:, :3])
    qpos[:, :2] += root[:2]
    qpos[:, 3:7] = quat_mul(turn, qpos[:, 3:7])
    return replace(trajectory, qpos=qpos)


def _at_rest(trajectory: Trajectory, at: Array, rig: Rig) -> Array:
    """(7 + nj,) the nominal pose, as high as where `trajectory` ends in it, standing where `at` (7 + nj,) does."""
    rest = np.array([*at[:2], *trajectory.qpos[-1, 2:7], *rig.pose_vector(rig.nominal)])
    rest[3:7] = yaw_quat(yaw_of_quat(at[3:7]))
    return rest


def _until(labels: tuple[Label, ...], end_s: float) -> tuple[Label, ...]:
    return tuple(replace(each, end_s=min(each.end_s, end_s)) for each in labels if each.start_s < end_s)
